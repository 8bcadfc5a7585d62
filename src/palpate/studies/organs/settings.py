"""Settings of batches of touches, at random: surface, body, friction, rate, width, device, mass, arm and fingertip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.studies.organs.gaps import MM, layers_of
from palpate.studies.organs.touches import ORIENTATIONS, Setting
from palpate.studies.organs.zoo import COARSE, USUAL, Specimen

BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
WITH_BASIS = ("ReducedFE",)
"""Bodies that need a basis of the surface; only the bases that ship are used."""
RATES = {250.0: 0.1, 500.0: 0.1, 1000.0: 0.45, 2000.0: 0.15, 5000.0: 0.12, 10000.0: 0.08}  # [Hz] and their shares
FRICTION = {"LuGre": 0.5, "ElastoPlastic": 0.15, "Coulomb": 0.15, "": 0.2}
TWO = 0.1  # share of batches with two fingers
ROUGH = 0.3  # share of batches on a coarse mesh
POINT, EXACT = 0.2, 0.2  # share of batches with a stylus, and with positions without encoder steps
WIDTH = 16 * MM  # [m] of a finger
VARIED: tuple[tuple[str, ...], ...] = (
    (), ("device.mass=0.1",), ("device.mass=0.4",), ("device.hand_stiffness=250",), ("device.hand_stiffness=1000",),
    ("contact.finger_law=hertz",), ("contact.finger_law=power",), ("spread.radius=0.006",), ("spread.radius=0.01",),
)  # fmt: skip
"""Values of `--set` of which a setting has one; the radius of the patch gives the width."""


def varied(setting: Setting, rng: np.random.Generator) -> Setting:
    """The setting with one of `VARIED`, the width of its patch, and layers that fit into the surface."""
    more = VARIED[rng.integers(len(VARIED))]
    radius = next((float(one.split("=")[1]) for one in more if one.startswith("spread.radius")), 0.5 * WIDTH)
    return replace(setting, more=(*more, *layers_of(setting.body, setting.surface)), width=2.0 * radius)


def draw_settings(
    surfaces: Sequence[Specimen],
    bodies: Sequence[str],
    rng: np.random.Generator,
    rate: float | None = None,
    rough: float = ROUGH,
    fingers: int | None = None,
) -> Iterator[Setting]:
    """Settings of batches without end: each surface with each body in turn, the rest at random.

    rate     [Hz]; None: at random
    rough    [1] share of coarse meshes
    fingers  None: one or two, at random
    """
    pairs = paired(surfaces, bodies)
    while pairs:
        for index in rng.permutation(len(pairs)):
            specimen, body = pairs[index]
            coarse, two, turn = rng.uniform() < rough, rng.uniform() < TWO, rng.integers(len(ORIENTATIONS))
            drawn = Setting(
                specimen.name, 0 if specimen.patch else COARSE if coarse else USUAL, body,
                str(rng.choice(list(FRICTION), p=list(FRICTION.values()))),
                rate or float(rng.choice(list(RATES), p=list(RATES.values()))), fingers or 1 + int(two),
                ORIENTATIONS[turn] if specimen.name == "kidney" else (0.0, 0.0, 0.0),
            )  # fmt: skip
            drawn = varied(replace(drawn, exact=bool(rng.uniform() < EXACT)), rng)
            yield replace(drawn, width=0.0) if rng.uniform() < POINT else drawn


def paired(surfaces: Sequence[Specimen], bodies: Sequence[str]) -> list[tuple[Specimen, str]]:
    """Each surface with each body that it can have."""
    return [(s, b) for s in surfaces for b in bodies if s.patch or b not in WITH_BASIS]


def choose_bodies(names: list[str] | None) -> Sequence[str]:
    """These bodies, or all. ArgumentError: an unknown name."""
    if unknown := [name for name in names or () if name not in BODIES]:
        raise ArgumentError(f"--body: found {', '.join(unknown)}, expected some of {', '.join(BODIES)}")
    return names or BODIES
