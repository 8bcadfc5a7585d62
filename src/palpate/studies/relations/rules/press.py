"""Presses along the normal of a convex surface without friction: more of what resists does not give less force, and no
force is lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from palpate.studies.organs.reference import AtRest
from palpate.studies.organs.score import Score
from palpate.studies.organs.touches import reachable
from palpate.studies.organs.widths import press_touch
from palpate.studies.relations.relation import Case, Claim, Relation, at_least
from palpate.studies.relations.runs import Trace

CONVEX = ("sphere", "ellipsoid", "plate-20", "box", "kidney", "sphere-nurbs", "plane")
SLACK, LIGHT = 2e-3, 5e-3  # [1] of the force, and [N], that a press may lose
DEEP = 4e-3, 9e-3  # [m] of the hand's target below the point where the finger touches
MORE = 1.1, 2.0  # [1] factor by which something is stiffer
DEEPER = 1.05, 1.4  # [1]
NEARER = 0.2e-3, 2e-3  # [m]
LOST = 0.8  # [1] of the force of the law


@dataclass(frozen=True)
class Press:
    """A press of a case: the case of its touch, the point [m] and direction [1] (3) and the depth [m]."""

    case: Case
    place: np.ndarray
    down: np.ndarray
    deep: float

    def but(self, deep: float) -> Case:
        return self.case.but(press_touch(self.case.touch.setting, self.place, self.down, deep))


def draw_press(case: Case, rng: np.random.Generator) -> Press | None:
    """Below where the finger of the case begins; None: the surface is not convex, or out of reach."""
    setting = replace(case.touch.setting, exact=True, friction="")
    if setting.surface not in CONVEX:
        return None
    begin = np.array(case.touch.fingers[0].begin)
    place, normal = setting.closest().find(begin)[:2]
    deep = float(rng.uniform(*DEEP))
    touch = press_touch(setting, np.asarray(place), -np.asarray(normal), deep)
    return Press(case.but(touch), place, -normal, deep) if reachable(touch.fingers[0]) else None


def _not_less(one: Trace, two: Trace) -> Score:
    """At the end, where both hands rest."""
    before, after = float(one.force[-1]), float(two.force[-1])
    return at_least(after, before, SLACK * before + LIGHT, len(one.force) * one.step)


def _changed(press: Press, changes: Mapping[str, Any]) -> Claim:
    return Claim((press.case.run, press.case.run.but(changes)), _not_less)


def deeper(case: Case, rng: np.random.Generator) -> Claim | None:
    press = draw_press(case, rng)
    if press is None:
        return None
    return Claim((press.case.run, press.but(press.deep * float(rng.uniform(*DEEPER))).run), _not_less)


def nearer(case: Case, rng: np.random.Generator) -> Claim | None:
    press = draw_press(case, rng)
    if press is None:
        return None
    by = -press.down * float(rng.uniform(*NEARER))
    place = np.array(press.case.run.sets["scene.surface.position"], dtype=float) + by
    return _changed(press, {"scene.surface.position": place.tolist()})


def stiffer(case: Case, rng: np.random.Generator) -> Claim | None:
    """The tissue."""
    press, by = draw_press(case, rng), float(rng.uniform(*MORE))
    name = {"MassSpring": "tissue.stiffness", "ReducedFE": "tissue.young"}.get(case.touch.setting.body)
    if press is None or name is None:
        return None
    return _changed(press, {name: by * float(press.case.run.sets[name])})


def held(case: Case, rng: np.random.Generator) -> Claim | None:
    """By a stiffer arm, which yields less."""
    press, name = draw_press(case, rng), "device.hand_stiffness"
    if press is None:
        return None
    return _changed(press, {name: float(rng.uniform(*MORE)) * float(press.case.run.sets[name])})


def felt(case: Case, rng: np.random.Generator) -> Claim | None:
    """A press has at least a share of the force of fingertip and body in series, computed by another route."""
    press = draw_press(case, rng)
    if press is None:
        return None
    run = press.case.run

    def judge(one: Trace) -> Score:
        nodes = {name: dict(spec.settings) for name, spec in run.launch().load().nodes.items()}
        rest = AtRest(nodes, case.touch.setting.body).place(one["contact.foot"][-1], one["contact.normal"][-1])
        least = LOST * float(rest.force(float(one["collision.approach"][-1])))
        return at_least(float(one.force[-1]), least, SLACK * least + LIGHT, len(one.force) * one.step)

    return Claim((run,), judge)


SMALL = f"{SLACK:.1%} + {1e3 * LIGHT:g} mN"
RELATIONS = (
    Relation("deeper", "a hand that goes deeper does not feel less", SMALL, deeper),
    Relation("nearer", "an organ that comes nearer is not felt less", SMALL, nearer),
    Relation("stiffer", "a stiffer tissue is not felt less", SMALL, stiffer),
    Relation("held", "a stiffer arm does not press less", SMALL, held),
    Relation("felt", f"a press has at least {LOST:g} of the force of the law", SMALL, felt, share=0.2),
)
