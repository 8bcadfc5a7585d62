"""Changes of a scene that change nothing: what is switched off, far away, later or only observed."""

from __future__ import annotations

from functools import partial

import numpy as np

from palpate.studies.organs.score import Score
from palpate.studies.organs.touches import Finger
from palpate.studies.relations.relation import Case, Claim, Relation, same_bytes, same_force
from palpate.studies.relations.runs import LENGTH, Run, Trace

ROUNDING = 1e-9  # [1] of the peak
SMALL = 1e-9  # [1] a coefficient of friction, which may not be zero
COEFFICIENTS = "scene.sliding.mu_slide", "scene.sliding.mu_static"
AWAY = 0.3  # [m] between a finger and one that touches nothing
LATER = 0.7  # [s] until which two motions agree


def _bytes(*runs: Run) -> Claim:
    return Claim(runs, same_bytes)


def _nearly(one: Run, two: Run, near: Run) -> Claim:
    return Claim((one, two, near), partial(same_force, share=ROUNDING))


def every(case: Case, rng: np.random.Generator) -> Claim:
    node = str(rng.choice(["contact", "spread", "tissue", "controller", "statics"]))
    return _bytes(case.run, case.run.but({f"{node}.every": 1}))


def observed(case: Case, rng: np.random.Generator) -> Claim:
    change = {"scene.finger.band": True} if rng.uniform() < 0.5 else {"scene.energy.ledger": True,
                                                                      "scene.energy.bound": 1e3}  # fmt: skip
    return _bytes(case.run, case.run.but(change))


def without_friction(case: Case, rng: np.random.Generator) -> Claim | None:
    if case.touch.setting.friction not in ("LuGre", "Coulomb"):
        return None
    exact = case.but(exact=True)
    gone = exact.run.but({"scene.tissue.friction": False}).without("friction.use", *COEFFICIENTS)
    damping = "viscous" if case.touch.setting.friction == "Coulomb" else "bristle_damping"
    none = dict.fromkeys(COEFFICIENTS, SMALL) | {"scene.sliding.viscous": 0.0, f"scene.sliding.{damping}": 0.0}
    return _nearly(gone, exact.run.but(none), exact.near)


def nodule(case: Case, rng: np.random.Generator) -> Claim | None:
    """A nodule of the modulus of the tissue."""
    if case.touch.setting.body != "MassSpring":
        return None
    case = case.but(exact=True)
    place = [float(x) for x in case.touch.fingers[0].path[1]["to"]]
    change = {
        "tissue.nodule_radius": 0.004, "tissue.nodule_position": place, "tissue.nodule_depth": 0.006,
        "tissue.nodule_ratio": 1.0,
    }  # fmt: skip
    return _nearly(case.run, case.run.but(change), case.near)


def capsule(case: Case, rng: np.random.Generator) -> Claim | None:
    """A capsule without thickness, of any modulus."""
    if case.touch.setting.body != "ReducedFE":
        return None
    return _bytes(case.run, case.run.but({"tissue.capsule_ratio": float(rng.uniform(1.0, 100.0))}))


def far_finger(case: Case, rng: np.random.Generator) -> Claim | None:
    """A second finger that touches nothing: a `Joint` of two solves what a `Series` does."""
    if case.touch.setting.body == "Rigid":
        return None
    case = case.but(exact=True)
    touch = case.touch
    one = touch.fingers[0]

    def move(point: list[float] | tuple[float, float, float]) -> tuple[float, float, float]:
        return (point[0] + AWAY, point[1], point[2])

    other = Finger(move(one.begin), move(one.origin), ({"hold": LENGTH},))
    two = case.but(touch=type(touch)(touch.setting, (one, other)), fingers=2)
    return _nearly(case.run, two.run, case.near)


def causal(case: Case, rng: np.random.Generator) -> Claim:
    """Motion after a time does not change what was before."""
    path, past = [], 0.0
    for segment in case.touch.fingers[0].path:
        begins, past = past, past + segment.get("time", 0.0) + segment.get("hold", 0.0)
        path.append({"hold": LENGTH} if begins >= LATER else segment)
    path.append({"hold": 0.1})
    scene = "scene.hand.path"

    def judge(one: Trace, two: Trace) -> Score:
        until = round(LATER / one.step)
        return same_bytes(one.between(0, until), two.between(0, until))

    return Claim((case.run, case.run.but({scene: path})), judge)


def texture(case: Case, rng: np.random.Generator) -> Claim | None:
    """A texture without roughness."""
    given = case.touch.setting
    if given.friction != "LuGre" or not given.count:
        return None
    rough = {"scene.energy.ledger": False, "texture.roughness": 0.0}
    return Claim(
        (case.run, case.run.but(rough, graph="texture")),
        lambda one, two: same_bytes(one, two, "contact.force", "finger.position"),
    )


EXACT = "1e-9 of the peak, or what 3 µm change"
RELATIONS = (
    Relation("every", "`every: 1` of a node changes nothing", "bytes", every),
    Relation("observed", "a ledger or a band of the force changes nothing", "bytes", observed),
    Relation("no-friction", f"a coefficient of friction of {SMALL:g} is no friction", EXACT, without_friction),
    Relation("nodule", "a nodule as stiff as the tissue changes nothing", EXACT, nodule),
    Relation("capsule", "a capsule without thickness changes nothing", "bytes", capsule),
    Relation("far-finger", "a second finger that touches nothing changes nothing", EXACT, far_finger),
    Relation("causal", f"motion after {LATER} s changes nothing before", "bytes", causal),
    Relation("texture", "a texture without roughness changes nothing", "bytes", texture),
)
