"""MassSpring: with Hertz's law of a ball, with and without a surface, and calibrated to ReducedFE with its stiffness
map."""

from functools import lru_cache
from typing import Any

import numpy as np

from palpate.nodes.deformation import MassSpring
from palpate.studies.accuracy import chain
from palpate.studies.accuracy.bodies import reduced_fe
from palpate.studies.accuracy.cases import TOUCHES, BenchCase
from palpate.studies.accuracy.fidelities import MESHES, NODULE, REACHES, SECOND_ORDER, STEPS, of_body, only_slab
from palpate.studies.accuracy.outcome import Fidelity, Method
from palpate.studies.accuracy.reference import HERTZ
from palpate.studies.fit_body import power_law


class _SpringLaw(MassSpring):
    """Computes the terminal law, not the surface."""

    wanted = chain.LAW


def methods() -> list[Method]:
    forms = [Fidelity(kernel, settings={"spread": {"kernel": kernel}}) for kernel in ("wendland", "cosine")]
    finer = (*STEPS, *MESHES, *REACHES, *forms)
    return [
        Method("series", "laws in series, no surface", of_body(_SpringLaw, _slab), STEPS, _no_nodule, law=True),
        Method("MassSpring", "MassSpring, law of a ball", of_body(MassSpring, _slab), finer, only_slab),
        Method(
            "MassSpring-calibrated",
            "MassSpring, calibrated",
            of_body(MassSpring, _calibrate_springs),
            (SECOND_ORDER, *finer),
            only_slab,
        ),
    ]


def _slab(touch: BenchCase) -> dict[str, Any]:
    """Hertz's law of the ball; the default damping if the slab is viscous, else none."""
    law: dict[str, Any] = {"stiffness": HERTZ, "exponent": 1.5}
    if touch.retardation == 0.0:
        law["damping"] = 0.0
    return law | (NODULE if touch.nodule else {})


def _calibrate_springs(touch: BenchCase) -> dict[str, Any]:
    """As `palpate fit body` with a stiffness map: K, n, c and tau from ReducedFE on one test case, used for all."""
    elastic = {"damping": 0.0, "retardation": 0.0} if touch.retardation == 0.0 else {}
    return _constants() | elastic | (NODULE if touch.nodule else {})


@lru_cache(maxsize=1)
def _constants() -> dict[str, Any]:
    """Power law fitted to indentation and force of ReducedFE on `hold`."""
    compute = next(m.compute for m in reduced_fe.methods() if m.name == "ReducedFE")
    pressed = compute(TOUCHES["hold"], Fidelity("1000 Hz"), 1)
    depth, force = pressed.values["indentation"], pressed.values["force"]
    rate = np.diff(depth, prepend=0.0) / np.diff(pressed.times, prepend=-pressed.times[1])
    touching = (force > 0.0) & (depth > 0.0)
    mapped = {"stiffness_map": "basis"}
    relative = MassSpring(**chain.surface_of(TOUCHES["hold"]), **mapped).relative_stiffness([(0.0, 0.0, 0.0)])
    return power_law(depth[touching], rate[touching], force[touching], relative) | mapped


def _no_nodule(touch: BenchCase) -> str:
    if touch.body == "organs":
        return "a contact law has no surface that another organ touches"
    return only_slab(touch) or ("a contact law has no nodule" if touch.nodule else "")
