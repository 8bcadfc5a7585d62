"""Random scenes: a surface, a body, laws, a rate, and numbers for settings that other searches leave as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.studies.organs.settings import FRICTION, RATES
from palpate.studies.organs.touches import ORIENTATIONS, Setting, draw_touch
from palpate.studies.organs.zoo import COARSE, USUAL
from palpate.studies.relations.relation import Case

BODIES = {"MassSpring": 0.4, "ReducedFE": 0.2, "BeamBundle": 0.25, "Rigid": 0.15}  # and their shares
MESHES = ("sphere", "ball-5", "ellipsoid", "torus-14", "torus-20", "plate-5", "plate-20", "box", "l-shape", "lobes",
          "wedge", "dome", "bumpy", "kidney-mesh")  # fmt: skip
PATCHES = ("kidney", "sphere-nurbs", "plane")
"""Built-in surfaces, which have stored bases."""
FINGER_LAWS = ("exponential", "power", "hertz", "soft", "median", "stiff")
LOW, HIGH = 0.3, 10.0  # [N] force of the mass-spring body at an indentation of `AT`
AT = 5e-3  # [m]


def _between(low: float, high: float, rng: np.random.Generator) -> float:
    """A number whose logarithm is uniform, with four digits."""
    return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.4g}")


def choose_bodies(names: list[str] | None) -> dict[str, float]:
    """These bodies, or all, and their shares. ArgumentError: an unknown name."""
    if unknown := [name for name in names or () if name not in BODIES]:
        raise ArgumentError(f"--body: found {', '.join(unknown)}, expected some of {', '.join(BODIES)}")
    return {name: BODIES[name] for name in names or BODIES}


def draw_setting(rng: np.random.Generator, bodies: Mapping[str, float] = BODIES) -> Setting:
    """What the cases of a batch have in common."""
    shares = np.array(list(bodies.values()))
    body = str(rng.choice(list(bodies), p=shares / shares.sum()))
    patch = body == "ReducedFE" or rng.uniform() < 0.4
    surface = str(rng.choice(PATCHES[:2] if body == "ReducedFE" else PATCHES if patch else MESHES))
    count = 0 if patch else int(rng.choice([COARSE, USUAL]))
    friction = str(rng.choice(list(FRICTION), p=list(FRICTION.values())))
    rate = float(rng.choice(list(RATES), p=list(RATES.values())))
    turn = ORIENTATIONS[rng.integers(len(ORIENTATIONS))] if surface == "kidney" else (0.0, 0.0, 0.0)
    radius = _between(5e-3, 10e-3, rng)  # the surface that a finger of this width feels takes seconds for a mesh
    return Setting(surface, count, body, friction, rate, 1, turn, bool(rng.uniform() < 0.5), 2.0 * radius)


def draw_numbers(setting: Setting, rng: np.random.Generator) -> tuple[str, ...]:
    """Values of `--set` of hand, finger, tissue and friction."""
    body = setting.body
    texts = [
        f"device.mass={_between(0.05, 0.8, rng)}", f"device.hand_stiffness={_between(150, 1500, rng)}",
        f"device.hand_damping={_between(3, 30, rng)}", f"scene.finger.finger_law={rng.choice(FINGER_LAWS)}",
        f"scene.finger.finger_damping={_between(1, 20, rng)}",
        f"spread.radius={0.5 * setting.width:.6g}",
    ]  # fmt: skip
    if body == "MassSpring":
        exponent = float(rng.choice([1.0, 1.0, 1.25, 1.5]))
        texts += [
            f"tissue.exponent={exponent}", f"tissue.stiffness={_between(LOW, HIGH, rng) / AT**exponent:.6g}",
            f"tissue.damping={_between(0.5, 10, rng) if rng.uniform() < 0.3 else 0.0}",
        ]  # fmt: skip
    if body == "ReducedFE":
        texts.append(f"tissue.young={_between(4e3, 8e4, rng)}")
    if body in ("MassSpring", "ReducedFE"):
        texts.append(f"tissue.retardation={_between(1e-3, 0.1, rng) if rng.uniform() < 0.8 else 0.0}")
        if rng.uniform() < 0.2:
            texts += ["tissue.second_order=true", "contact.second_order=true"]
    if setting.friction in ("LuGre", "ElastoPlastic"):
        slide = _between(0.05, 0.8, rng)
        texts += [f"scene.sliding.mu_slide={slide}", f"scene.sliding.mu_static={slide * _between(1.0, 1.4, rng):.6g}"]
    return tuple(texts)


def draw_case(setting: Setting, rng: np.random.Generator, folder: Path, batch: int) -> Case:
    """A random touch with random numbers."""
    touch = draw_touch(setting, rng)
    more = draw_numbers(setting, rng)
    return Case(replace(touch, setting=replace(setting, more=more)), folder, batch)
