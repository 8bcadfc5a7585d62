"""What holds for every touch of every surface: bounds on the force, its changes, its direction and its energy.

A score is a value over its bound: above 1 the invariant is broken.

force    contact force <= 0.03 N + 1.2 x the force of the series law at the greatest approach e, approach rate v and
         speed of the finger along the surface u of the last 60 ms (`reference`). At rest it is the quasi-static force
         of the depth.
hand     change of the force on the hand within W = 1 ms <= (k + f/R) w + B (dv + v w/R + v at the first contact)
         + f (sigma_0 w + (sigma_1 + sigma_2) dv) + k_t w + (f - f_0) W/2 ms + 0.1 N, where
         w, dv, v: path, change of velocity and speed of the *finger* within W and two steps before. The foot does not
                 appear: a foot that moves while the finger does not must not change the force;
         k = k1 k2/(k1 + k2), k1 = g'(s1) (1 + c v), k2 = 1.5 x the secant stiffness of the body: fingertip and body;
         f/R     the turn of the normal: a fingertip does not feel curvature below R, an eighth of its patch;
         B = K_body tau, what a change of the rate changes at once; c f on a rigid body;
         sigma   the bristles of LuGre, k_t the spring of Coulomb;
         f, f_0  1.2 x the force that depth and rate explain, as in `force`, and that of the depth alone, to which it
                 relaxes.
contact  the same of f n + lateral force, before the controller limits its rate.
lateral  force along the surface without friction <= 0.5 f + 0.05 N; a body whose stiffness changes by a factor e within
         30 mm pulls with s/(2 x 30 mm), 0.17 f at 10 mm.
rubbing  friction <= (mu_s + sigma_2 v + 0.05) f + 0.02 N.
still    the normal turns within 20 ms by at most w/R + 0.02, w the extent of the finger's motion in the first 10 ms
         plus that in the other 10 ms: a finger that turns round and goes back has moved.
energy   work of the force on the hand over a closed path <= 0.5 mJ + 2 % of the work that went to and fro.
side     while the nearest point of the surface has moved continuously since the finger touched (at most twice as far
         as the finger, its direction by less than 60 degrees), the normal is within 0.35 rad of the direction from it,
         and the approach within 0.3 mm + 5 %.
finite   no lane stops, and every value is finite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from palpate.studies.organs.reference import AtRest, Place, at_rest
from palpate.studies.organs.runs import Traces
from palpate.studies.organs.touches import THICKNESS

WINDOW = 1e-3  # [s] W
PAST = 60e-3  # [s] of approach and rate that explain a force
SLOW = 5e-3  # [m/s]
SMOOTH = 2e-3  # [s] over which the rate of approach is measured
STILL = 20e-3  # [s]
PATCH = 8e-3  # [m]
LEAST_CURVATURE = PATCH / 8.0  # [m] R
RELAXES = 2e-3  # [s]
STIFFEST = 1e4  # [N/m] of a body; on a stiffer one the fingertip is the damper
ABOVE = 1.2  # [1] of the quasi-static force
ROUNDED = 0.03  # [N] by which a force at an impact may exceed it, since the rate is a mean of `SMOOTH`
LATERAL = 0.5  # [1] of the normal force
LEAST_FORCE = 0.1  # [N] below which directions do not matter
ALLOWED = 0.1  # [N] change within 1 ms
CREDIT, SHARE = 0.5e-3, 0.02  # [J], [1] of a closed path
STEEPEST = 0.35  # [rad]
BENT = 0.2
"""[rad] Near an edge the interpolated normals of a mesh differ by more from the direction to the nearest point."""
ON = 2e-4  # [m] from the surface within which the direction from the nearest point is not known
MOVES = 2.0  # [1] motion of the nearest point over that of the finger
EVERY = 4e-3  # [s] between comparisons with the nearest point


@dataclass(frozen=True)
class Score:
    """Value over bound of an invariant in a touch, and where it was largest."""

    score: float
    time: float
    value: float
    bound: float

    @property
    def broken(self) -> bool:
        return not self.score <= 1.0


@dataclass
class Trace:
    """One finger of one touch: fields (T) and (T,3), and times of the laws."""

    values: dict[str, np.ndarray]
    step: float
    rest: AtRest
    nodes: dict[str, dict[str, Any]]
    closest: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
    places: dict[int, Place] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def place(self, tick: int) -> Place:
        """Finger and body at rest at the foot of a tick."""
        if tick not in self.places:
            self.places[tick] = self.rest.place(self["contact.foot"][tick], self["contact.normal"][tick])
        return self.places[tick]

    @cached_property
    def deep(self) -> np.ndarray:
        """The greatest approach [m] of the last `PAST` (T)."""
        return greatest(self["collision.approach"], self.ticks(PAST))

    @cached_property
    def fast(self) -> np.ndarray:
        """The greatest rate of approach [m/s] of the last `PAST` (T), over `SMOOTH`."""
        n, e = self.ticks(SMOOTH), -self["collision.gap"]
        before = np.concatenate([np.repeat(e[:1], n), e])[: len(e)]
        return greatest(np.maximum((e - before) / (n * self.step), 0.0), self.ticks(PAST))

    @cached_property
    def slides(self) -> np.ndarray:
        """The greatest speed [m/s] along the surface of the last `PAST` (T)."""
        v, n = self["finger.velocity"], self["contact.normal"]
        aside = length(v - np.einsum("ti,ti->t", v, n)[:, None] * n)
        return greatest(np.where(self["contact.force"] > 0.0, aside, 0.0), self.ticks(PAST))

    @cached_property
    def static(self) -> np.ndarray:
        """Force [N] (T) that the depth explains at rest: `ABOVE` x that of the series law at the deepest place."""
        return ABOVE * self.place(int(np.argmax(self.deep))).force(self.deep)

    @cached_property
    def explained(self) -> np.ndarray:
        """Force [N] (T) that depth, rate and slide explain; rate and slide are rounded up to one of four."""
        place, total = self.place(int(np.argmax(self.deep))), self.static
        rates, slides = (float(each.max()) * np.array([0.0, 0.25, 0.5, 0.75, 1.0]) for each in (self.fast, self.slides))
        for k in range(5):
            for i in range(5):
                moves = (self.fast > rates[k - 1] if k else True) & (self.slides > slides[i - 1] if i else True)
                if k + i and np.any(moves):
                    total = np.where(moves, ABOVE * place.force(self.deep, rates[k], float(slides[i])), total)
        return total

    def ticks(self, seconds: float) -> int:
        return max(1, round(seconds / self.step))


def worst(trace: Trace, values: np.ndarray, bounds: np.ndarray, start: int = 0) -> Score:
    """The largest value over its bound."""
    if not len(values):
        return Score(0.0, 0.0, 0.0, 0.0)
    share = values / bounds
    k = int(np.argmax(share))
    return Score(float(share[k]), (k + start) * trace.step, float(values[k]), float(bounds[k]))


def length(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def greatest(values: np.ndarray, ticks: int) -> np.ndarray:
    """The greatest value of the last `ticks` values (T)."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, ticks, origin=(ticks - 1) // 2, mode="nearest"))


def extent(vectors: np.ndarray, ticks: int) -> np.ndarray:
    """Diagonal (T) of the box around the last `ticks` vectors (T,3)."""
    total = np.zeros(len(vectors))
    for axis in range(3):
        total += (greatest(vectors[:, axis], ticks) + greatest(-vectors[:, axis], ticks)) ** 2
    return np.asarray(np.sqrt(total))


def force(trace: Trace) -> Score:
    f, deep, fast, slides = trace["contact.force"], trace.deep, trace.fast, trace.slides
    # candidates: the largest force, and the largest for its depth, at any speed and of a slow finger
    found = Score(0.0, 0.0, 0.0, 0.0)
    share = np.where(f > LEAST_FORCE, f / (trace.explained + 1e-3), 0.0)
    slow = np.where(f > LEAST_FORCE, f / (trace.static + 1e-3), 0.0)
    for k in {int(np.argmax(f)), int(np.argmax(share)), int(np.argmax(np.where(fast < SLOW, slow, 0.0)))}:
        if f[k] > LEAST_FORCE:
            bound = ABOVE * float(trace.place(k).force(deep[k], fast[k], float(slides[k]))) + ROUNDED
            if f[k] / bound > found.score:
                found = Score(float(f[k] / bound), k * trace.step, float(f[k]), bound)
    return found


def _change(trace: Trace, vector: np.ndarray) -> Score:
    """Change of a force (T,3) within `WINDOW` against what the motion of the finger allows."""
    n, p, f = trace.ticks(WINDOW), trace["finger.position"], trace["contact.force"]
    if len(p) <= n + 2 or not f.max() > LEAST_FORCE:
        return Score(0.0, 0.0, 0.0, 0.0)
    window = n * trace.step
    way = np.concatenate([[0.0], np.cumsum(length(np.diff(p, axis=0)))])
    back = np.maximum(np.arange(len(p)) - n - 2, 0)
    moved = way - way[back]
    turned, speed = extent(trace["finger.velocity"], n + 3), greatest(length(trace["finger.velocity"]), n + 3)
    begins = (f > 0.0) & (-greatest(-f, n + 3) <= 0.0)
    change = np.zeros(len(p))
    change[n:] = length(vector[n:] - vector[:-n])
    usual, rest = trace.explained, trace.rest
    body = trace.place(int(np.argmax(usual))).stiffness(max(float(usual.max()), 0.1))
    one, two = np.interp(usual, rest.forces, rest.tangents) * (1.0 + rest.damping * speed), 1.5 * body
    law = trace.nodes.get("friction", {})
    viscous = body * rest.retardation if body < STIFFEST else rest.damping * usual
    bounds = (one * two / (one + two) + usual / LEAST_CURVATURE + law.get("stiffness", 0.0)) * moved
    bounds += viscous * (turned + speed * moved / LEAST_CURVATURE + speed * begins)
    bounds += usual * law.get("bristle_stiffness", 0.0) * moved
    bounds += usual * (law.get("bristle_damping", 0.0) + law.get("viscous", 0.0)) * turned
    return worst(trace, change, bounds + np.maximum(usual - trace.static, 0.0) * window / RELAXES + ALLOWED)


def hand(trace: Trace) -> Score:
    return _change(trace, trace["controller.force"])


def contact(trace: Trace) -> Score:
    return _change(trace, trace["contact.force"][:, None] * trace["contact.normal"] + trace["contact.lateral_force"])


def lateral(trace: Trace) -> Score:
    return worst(trace, length(trace["contact.lateral_force"]), LATERAL * trace["contact.force"] + 0.05)


def rubbing(trace: Trace) -> Score:
    if "friction.force" not in trace.values:
        return Score(0.0, 0.0, 0.0, 0.0)
    law = trace.nodes["friction"]
    most = max(law.get("mu_static", 0.0), law.get("mu_slide", 0.0), law.get("mu", 0.0)) + 0.05
    speed = length(trace["finger.velocity"])
    bounds = (most + law.get("viscous", 0.0) * speed) * trace["contact.force"] + 0.02
    return worst(trace, length(trace["friction.force"]), bounds)


def still(trace: Trace) -> Score:
    n = trace.ticks(STILL)
    f = trace["contact.force"]
    pressed = -greatest(-f, n) > LEAST_FORCE
    turn = extent(trace["contact.normal"], n)
    half = extent(trace["finger.position"], n // 2 + 1)
    bounds = (half + half[np.maximum(np.arange(len(f)) - n // 2, 0)]) / LEAST_CURVATURE + 0.02
    return worst(trace, np.where(pressed, turn, 0.0), bounds)


def energy(trace: Trace) -> Score:
    p, f = trace["finger.position"], trace["controller.force"]
    if trace["contact.force"][-1] > 0.0 or not trace["contact.force"].max() > 0.0:
        return Score(0.0, 0.0, 0.0, 0.0)
    work = np.einsum("ij,ij->i", f[:-1], np.diff(p, axis=0))
    gain, turned = float(work.sum()), float(np.abs(work).sum())
    bound = CREDIT + SHARE * turned
    return Score(max(gain, 0.0) / bound, len(p) * trace.step, gain, bound)


def side(trace: Trace) -> Score:
    every, p = trace.ticks(EVERY), trace["finger.position"]
    ticks = np.arange(0, len(p), every)
    foot, normal, _, gap = trace.closest(p[ticks])
    motion, jump = length(np.diff(p[ticks], axis=0)), length(np.diff(foot, axis=0))
    away = (p[ticks] - foot) / np.where(np.abs(gap) > ON, gap, np.inf)[:, None]
    touching = (gap < THICKNESS) | (trace["collision.approach"][ticks] > 0.0)
    found, regular = Score(0.0, 0.0, 0.0, 0.0), True
    for i, k in enumerate(ticks):
        if not touching[i]:
            regular = True
            continue
        inside = i > 0 and max(gap[i], gap[i - 1]) < -ON
        turned = i > 0 and (normal[i] @ normal[i - 1] < 0.5 or (inside and away[i] @ away[i - 1] < 0.5))
        if i and (jump[i - 1] > MOVES * motion[i - 1] + 2e-4 or turned):
            regular = False
        if not regular or trace["contact.force"][k] < LEAST_FORCE:
            continue
        e, true = trace["collision.approach"][k], THICKNESS - gap[i]
        found = max(found, Score(abs(e - true) / (3e-4 + 0.05 * abs(true)), k * trace.step, float(abs(e - true)),
                                 float(3e-4 + 0.05 * abs(true))), key=lambda s: s.score)  # fmt: skip
        if abs(gap[i]) > 1e-3:
            out = (p[k] - foot[i]) / gap[i]
            if out @ normal[i] < np.cos(BENT):
                continue
            angle = float(np.arccos(np.clip(out @ trace["contact.normal"][k], -1.0, 1.0)))
            found = max(found, Score(angle / STEEPEST, k * trace.step, angle, STEEPEST), key=lambda s: s.score)
    return found


INVARIANTS: dict[str, Callable[[Trace], Score]] = {
    "force": force, "hand": hand, "contact": contact, "lateral": lateral, "rubbing": rubbing, "still": still,
    "energy": energy, "side": side,
}  # fmt: skip
UNITS = {"force": "N", "hand": "N", "contact": "N", "lateral": "N", "rubbing": "N", "still": "rad", "energy": "J",
         "side": "m or rad", "finite": "1", "turned": "of the peak", "refined": "of the peak"}  # fmt: skip


def traced(traces: Traces, rest: AtRest) -> list[Trace | None]:
    """Each touch of a batch; None: its lane stopped, or a value is not finite."""
    closest, listed = traces.setting.smooth().find, list[Trace | None]()
    for lane, ticks in enumerate(traces.ticks):
        values = {name: column[lane, :ticks] for name, column in traces.values.items()}
        good = lane not in traces.failed and all(np.isfinite(v).all() for v in values.values())
        listed.append(Trace(values, traces.step, rest, traces.nodes, closest) if good else None)
    return listed


def judged(trace: Trace | None) -> dict[str, Score]:
    """The score of each invariant in a touch."""
    if trace is None:
        return {"finite": Score(np.inf, 0.0, 1.0, 0.0)}
    return {name: check(trace) for name, check in INVARIANTS.items()}


def scores(traces: Traces) -> list[dict[str, Score]]:
    """The score of each invariant, for each touch of a batch."""
    return [judged(trace) for trace in traced(traces, at_rest(traces))]
