"""What holds for every touch of every surface: bounds on the force, its changes, its direction and its energy.

A score is a value over its bound: above 1 the invariant is broken.

force    contact force <= 0.03 N + 1.2 x the force of the series law at the greatest approach e, approach rate v and
         speed along the surface u of the last 60 ms, of the finger, or of its foot up to twice that (`reference`). At
         rest it is the quasi-static force of the depth. v is a mean over 2 ms along the normal, or that of the finger
         towards the point of the surface that is nearest now: one that slides into a wall, or starts, approaches at
         its speed. A patch that rolls over a rim indents another face, whose tissue has not yielded: its rate e (omega
         - u/8 mm), omega the turn of the normal within 0.5 ms and u the speed along the surface, counts for a body
         with a memory of the place. Under two fingers e and v are those to the surface that the other finger lifts, by
         at most 1.2 x its force by this law.
hand     change of the force on the hand within W = 1 ms <= (1 + m²)^½ ((k + f/R) w + B (dv + v w/R + v at the first
         contact) + (f - f_0) W/2 ms) + f (sigma_0 w + (sigma_1 + sigma_2) dv) + k_t w + 0.1 N, where
         w, dv, v: path, change of velocity and speed of the *finger* within W and two steps before. The foot does not
                 appear: a foot that moves while the finger does not must not change the force. A second finger that
                 presses moves the surface: of its motion the part counts that the body at rest transmits;
         k = k1 k2/(k1 + k2), k1 = g'(s1) (1 + c v), k2 = 1.5 x the secant stiffness of the body: fingertip and body;
         f/R     the turn of the normal: a fingertip does not feel curvature below R, an eighth of its patch;
         B = K_body tau, what a change of the rate changes at once; c f on a rigid body;
         sigma   the bristles of LuGre, k_t the spring of Coulomb;
         m       the largest friction over the normal force, with which it changes (0 for `contact`);
         f, f_0  1.2 x the force that depth, rate and roll explain, as in `force`, and that of the depth alone, to
                 which it relaxes; of f at most what acts within these steps. Force and stiffness of the body are those
                 of the place: the greater of two that the foot visits before and after, no more than 4 mm apart, and
                 where the bound would be broken, of the tick.
         A force that dissipates the observed energy E < 0 also changes, by at most K = 0.1 N per encoder step of the
         motion and (-2 K E)^½ (`device.controller`): K is the greatest slope that the device renders, at which a
         contact would also end. After a contact it may fall to zero at that slope.
contact  the same of f n + lateral force, before the controller limits its rate.
lateral  force along the surface without friction <= 0.5 f + 0.05 N; a body whose stiffness changes by a factor e within
         30 mm pulls with s/(2 x 30 mm), 0.17 f at 10 mm.
rubbing  friction <= (max(mu_s, a mu_s + sigma_1 v) + sigma_2 v + 0.05) f + 0.02 N. Bristles that are bent add sigma_1
         times their rate: v at first, and, where the law has a share `a` in which they are elastic, up to there.
still    the normal turns within 20 ms by at most w/R + 0.02, w the sum of the extents of the finger's motion in eight
         parts of 2.5 ms: a finger that turns round and goes back has moved. On a rigid body the fingertip, 10 kN/m at
         6 N, and the hand, 0.15 kg, turn round in a quarter of 24 ms.
energy   work of the force on the hand over a closed path <= 0.5 mJ + 2 % of the work that went to and fro.
side     while the nearest point of the surface has moved continuously since the finger touched (in 4 and 20 ms at
         0.1 m/s, or twice as far as the finger along the surface; its direction by less than 60 degrees), the normal is
         within 0.35 rad of the direction from it, and the approach within 0.3 mm + 5 %. At an edge the interpolated
         normal differs from this direction; the normal is within 0.35 rad of the arc between both, and the approach
         may be smaller, so that the hand gains no energy (`geometry.proxy`), until the finger has moved by five times
         the difference. The normal may be behind by an angle delta. Over an edge the nearest point's direction turns by
         more than w/R, the most that `still` allows the normal, and delta grows by all of it; deep inside, at an
         approach e, the normal turns by at most w/(e/6) (`SUDDEN`), and delta grows by the rest; near a centre of
         curvature the nearest point moves J while the foot moves at most m, `EASY` times as far as the finger along the
         surface or at `FASTEST` (half of it on the mean, since each leap from triangle to triangle starts it again),
         and delta grows by the part 1 - m/2J of its turn. While the foot gains on the nearest point, by m - J but no
         faster than `FASTEST`, delta decreases by the smaller of 1/R and delta/LANDING per distance, since the foot
         arrives without stopping abruptly (`geometry.proxy`). A finger that enters along the bisector of an edge is
         equally near to two faces, 90 degrees apart: the foot stays on its face until another is nearer by the
         hysteresis h (`nodes.collision`). So a foot that is farther by at most h also counts: with theta between both
         directions, the nearest point of the finger moved by h/(1 - cos theta) towards the foot is on its face; from
         there on delta is the angle between the faces.
finite   no lane stops, and every value is finite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.physics.geometry.proxy import EASY, FASTEST, LANDING, REGAIN, SUDDEN
from palpate.studies.organs.runs import Traces
from palpate.studies.organs.touches import THICKNESS
from palpate.studies.organs.trace import (
    ABOVE,
    LEAST_CURVATURE,
    LEAST_FORCE,
    ON,
    Trace,
    extent,
    greatest,
    length,
    trace_batch,
)

WINDOW = 1e-3  # [s] W
SLOW = 5e-3  # [m/s]
STILL, PARTS = 20e-3, 8  # [s], and parts of it
RELAXES = 2e-3  # [s]
STIFFEST = 1e4  # [N/m] of a body; on a stiffer one the fingertip is the damper
ROUNDED = 0.03  # [N] by which a force at an impact may exceed it, since the rate is a mean of `SMOOTH`
LATERAL = 0.5  # [1] of the normal force
ALLOWED = 0.1  # [N] change within 1 ms
PASSIVE = 0.1  # [N] per encoder step, by which the force that dissipates energy changes
CREDIT, SHARE = 0.5e-3, 0.02  # [J], [1] of a closed path
STEEPEST = 0.35  # [rad]
BENT = 0.2
"""[rad] Near an edge the interpolated normals of a mesh differ by more from the direction to the nearest point."""
NEAR = 2e-4  # [m] from the surface beyond which an edge is recognized by this direction
MOVES = EASY  # [1] motion of the nearest point over that of the finger
PART = 1.5e-4  # [m] of the finger's motion between looks for a leap of the nearest point
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


def worst(trace: Trace, values: np.ndarray, bounds: np.ndarray, start: int = 0) -> Score:
    """The largest value over its bound."""
    if not len(values):
        return Score(0.0, 0.0, 0.0, 0.0)
    share = values / bounds
    k = int(np.argmax(share))
    return Score(float(share[k]), (k + start) * trace.step, float(values[k]), float(bounds[k]))


def force(trace: Trace) -> Score:
    f, fast = trace["contact.force"], trace.fast
    # candidates: the largest force, and the largest for its depth, at any speed and of a slow finger
    found = Score(0.0, 0.0, 0.0, 0.0)
    share = np.where(f > LEAST_FORCE, f / (trace.explained + 1e-3), 0.0)
    slow = np.where(f > LEAST_FORCE, f / (trace.static + 1e-3), 0.0)
    for k in {int(np.argmax(f)), int(np.argmax(share)), int(np.argmax(np.where(fast < SLOW, slow, 0.0)))}:
        if f[k] > LEAST_FORCE:
            bound = trace.most(k) + ROUNDED
            if f[k] / bound > found.score:
                found = Score(float(f[k] / bound), k * trace.step, float(f[k]), bound)
    return found


def _motion(trace: Trace, ticks: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Path [m], change of velocity and speed [m/s] of the finger (T) within this number of ticks and two before."""
    p, v = trace["finger.position"], trace["finger.velocity"]
    path = np.concatenate([[0.0], np.cumsum(length(np.diff(p, axis=0)))])
    back = np.maximum(np.arange(len(p)) - ticks - 2, 0)
    return path - path[back], extent(v, ticks + 3), greatest(length(v), ticks + 3)


def _change(trace: Trace, vector: np.ndarray, rubs: bool, more: np.ndarray | float = 0.0) -> Score:
    """Change of a force (T,3) within `WINDOW` against what the motion of the finger allows, and `more` [N] (T).

    rubs  whether the force includes friction
    """
    n, p, f = trace.ticks(WINDOW), trace["finger.position"], trace["contact.force"]
    if len(p) <= n + 2 or not f.max() > LEAST_FORCE:
        return Score(0.0, 0.0, 0.0, 0.0)
    window = n * trace.step
    moved, turned, speed = _motion(trace, n)
    if trace.carried > 0.0 and trace.other is not None:
        presses = trace.carried * (greatest(trace.other["contact.force"], n + 3) > 0.0)
        theirs = (presses * each for each in _motion(trace.other, n))
        moved, turned, speed = (a + b for a, b in zip((moved, turned, speed), theirs, strict=True))
    begins = (f > 0.0) & (-greatest(-f, n + 3) <= 0.0)
    change = np.zeros(len(p))
    change[n:] = length(vector[n:] - vector[:-n])
    rest, law = trace.rest, trace.nodes.get("friction") if rubs else None
    acts = greatest(np.maximum(f, length(vector)), n + 3)

    def bound(at: slice, explained: np.ndarray, static: np.ndarray, body: np.ndarray) -> np.ndarray:
        usual, path, dv, v = np.minimum(explained, acts[at]), moved[at], turned[at], speed[at]
        one, two = np.interp(usual, rest.forces, rest.tangents) * (1.0 + rest.damping * v), 1.5 * body
        viscous = np.where(body < STIFFEST, body * rest.retardation, rest.damping * usual)
        allowed = (one * two / (one + two) + usual / LEAST_CURVATURE) * path
        allowed += viscous * (dv + v * path / LEAST_CURVATURE + v * begins[at])
        allowed += np.clip(explained - static, 0.0, usual) * window / RELAXES
        if law:
            allowed *= np.hypot(1.0, _friction(law, v))
            allowed += (law.get("stiffness", 0.0) + usual * law.get("bristle_stiffness", 0.0)) * path
            allowed += usual * (law.get("bristle_damping", 0.0) + law.get("viscous", 0.0)) * dv
        return np.asarray(allowed + ALLOWED)

    most = max(float(trace.explained.max()), LEAST_FORCE)
    body = trace.at_places(lambda place, _: place.stiffness(most))
    bounds = bound(slice(None), trace.explained, trace.static, body) + more
    found, last = worst(trace, change, bounds), -1
    while found.broken and (k := round(found.time / trace.step)) != last:  # between the places visited
        last, at, place = k, slice(k, k + 1), trace.place(k)
        explained = max(float(trace.explained[k]), trace.most(k), trace.most(max(k - n, 0)))
        static = min(float(trace.static[k]), ABOVE * float(place.force(trace.reach[k] + trace.raised[k])))
        stiffness = max(float(body[k]), place.stiffness(most))
        here = bound(at, *(np.array([each]) for each in (explained, static, stiffness)))
        bounds[k] = max(bounds[k], float((here + np.broadcast_to(more, len(p))[at])[0]))
        found = worst(trace, change, bounds)
    return found


def hand(trace: Trace) -> Score:
    n, felt, before = trace.ticks(WINDOW), trace["controller.force"], np.zeros(len(trace["contact.force"]))
    before[n:] = length(felt[:-n]) if n < len(before) else 0.0
    ended = greatest(trace["contact.force"], n + 3) <= 0.0
    step, moved = trace.nodes["controller"].get("resolution", 0.0), _motion(trace, n)[0]
    if step > 0.0:
        most = PASSIVE / step * moved
        damped = np.sqrt(2.0 * PASSIVE / step * np.maximum(greatest(-_observed(trace), n + 3), 0.0))
        return _change(trace, felt, True, np.where(ended, np.minimum(most, before), np.minimum(most, damped)))
    return _change(trace, felt, True, ended * before)


def _observed(trace: Trace) -> np.ndarray:
    """Energy [J] (T) that the display has absorbed, as the controller counts it: it forgets what is positive when
    contact begins and ends."""
    p, f, touching = trace["finger.position"], trace["controller.force"], trace["contact.force"] > 0.0
    work = -np.einsum("ti,ti->t", f[:-1], np.diff(p, axis=0))
    energy, last = np.zeros(len(p)), 0.0
    changes = [0, *(np.flatnonzero(touching[1:] != touching[:-1]) + 1).tolist(), len(p)]
    for start, end in pairwise(changes):
        energy[start:end] = min(last, 0.0) + np.concatenate([[0.0], np.cumsum(work[start : end - 1])])
        last = float(energy[end - 1] + (work[end - 1] if end < len(p) else 0.0))
    return energy


def contact(trace: Trace) -> Score:
    pushed = trace["contact.force"][:, None] * trace["contact.normal"] + trace["contact.lateral_force"]
    return _change(trace, pushed, False)


def lateral(trace: Trace) -> Score:
    return worst(trace, length(trace["contact.lateral_force"]), LATERAL * trace["contact.force"] + 0.05)


def rubbing(trace: Trace) -> Score:
    if "friction.force" not in trace.values:
        return Score(0.0, 0.0, 0.0, 0.0)
    law = trace.nodes["friction"]
    bounds = (_friction(law, length(trace["finger.velocity"])) + 0.05) * trace["contact.force"] + 0.02
    return worst(trace, length(trace["friction.force"]), bounds)


def _friction(law: dict[str, Any], speed: np.ndarray) -> np.ndarray:
    """Largest friction [1] (T) over the normal force at a speed [m/s] (T) of the finger; 0 without a law."""
    most = max(law.get("mu_static", 0.0), law.get("mu_slide", 0.0), law.get("mu", 0.0))
    bent = law.get("elastic", 0.0) * most + law.get("bristle_damping", 0.0) * speed
    return np.asarray(np.maximum(most, bent) + law.get("viscous", 0.0) * speed)


def still(trace: Trace) -> Score:
    n = trace.ticks(STILL)
    f = trace["contact.force"]
    pressed = -greatest(-f, n) > LEAST_FORCE
    turn = extent(trace["contact.normal"], n)
    part, ticks = extent(trace["finger.position"], -(-n // PARTS) + 1), np.arange(len(f))
    moved = np.sum([part[np.maximum(ticks - k * n // PARTS, 0)] for k in range(PARTS)], axis=0)
    bounds = moved / LEAST_CURVATURE + 0.02
    return worst(trace, np.where(pressed, turn, 0.0), bounds)


def energy_gain(trace: Trace) -> Score:
    p, f = trace["finger.position"], trace["controller.force"]
    if trace["contact.force"][-1] > 0.0 or not trace["contact.force"].max() > 0.0:
        return Score(0.0, 0.0, 0.0, 0.0)
    work = np.einsum("ij,ij->i", f[:-1], np.diff(p, axis=0))
    gain, turned = float(work.sum()), float(np.abs(work).sum())
    bound = CREDIT + SHARE * turned
    return Score(max(gain, 0.0) / bound, len(p) * trace.step, gain, bound)


def _between(one: np.ndarray, other: np.ndarray) -> float:
    """Angle [rad] between two directions [1] (3)."""
    return float(np.arccos(np.clip(one @ other, -1.0, 1.0)))


def _on_other_face(trace: Trace, tick: int, away: np.ndarray, gap: float) -> float:
    """Angle [rad] of the normal to the direction from a face that the foot is on; inf if it is on none that is as near
    as the nearest point, by the hysteresis.

    away, gap  [1] (3), [m]  direction from the nearest point of the finger, and its signed distance
    """
    p, foot = trace["finger.position"][tick], trace["collision.foot"][tick]
    far, hysteresis = float(length(p - foot)), float(trace.nodes["collision"]["hysteresis"])
    toward = (foot - p) / max(far, ON)
    turned = 1.0 - float(np.clip(-np.sign(gap) * (toward @ away), -1.0, 1.0))
    if far > abs(gap) + hysteresis or turned < 1.0 - np.cos(STEEPEST):
        return np.inf
    place = p + toward * min(hysteresis / turned, far)
    there, _, _, left = trace.closest(place[None])
    if abs(left[0]) <= ON:
        return np.inf
    return _between((place - there[0]) / left[0], trace["contact.normal"][tick])


def _behind(angle: float, gains: float) -> float:
    """Angle [rad] by which the normal may be behind after the foot has come nearer [m] to the nearest point."""
    first = min(max(angle - LANDING / LEAST_CURVATURE, 0.0) * LEAST_CURVATURE, gains)
    return (angle - first / LEAST_CURVATURE) * float(np.exp((first - gains) / LANDING))


def _leaps(trace: Trace, start: int, end: int) -> bool:
    """Whether the nearest point leaps to another face, by more than 60 degrees, between two ticks outside."""
    p = trace["finger.position"][[start, end]]
    parts = max(2, int(np.ceil(length(p[1] - p[0]) / PART)) + 1)
    foot, _, _, gap = trace.closest(np.linspace(p[0], p[1], parts))
    away = (np.linspace(p[0], p[1], parts) - foot) / np.maximum(gap, ON)[:, None]
    turned = np.einsum("ti,ti->t", away[:-1], away[1:]) < 0.5
    far = length(np.diff(foot, axis=0)) > MOVES * PART + 1e-4
    return bool((turned & far & (np.minimum(gap[:-1], gap[1:]) > ON)).any())


def side(trace: Trace) -> Score:
    every, p = trace.ticks(EVERY), trace["finger.position"]
    ticks = np.arange(0, len(p), every)
    foot, normal, _, gap = trace.closest(p[ticks])
    step, jump = np.diff(p[ticks], axis=0), length(np.diff(foot, axis=0))
    motion = length(step - np.einsum("ti,ti->t", step, normal[1:])[:, None] * normal[1:])
    away = (p[ticks] - foot) / np.where(np.abs(gap) > ON, gap, np.inf)[:, None]
    touching = (gap < THICKNESS) | (trace["collision.approach"][ticks] > 0.0)
    found, regular, behind, lost = Score(0.0, 0.0, 0.0, 0.0), True, 0.0, 0.0
    for i, k in enumerate(ticks):
        if not touching[i]:
            regular, behind, lost = True, 0.0, 0.0
            continue
        if i > 0:
            turn = max(_between(each[i - 1], each[i]) for each in ((normal, away) if abs(gap[i]) > ON else (normal,)))
            most, w = max(EASY * motion[i - 1], FASTEST * EVERY), float(length(step[i - 1]))
            if turn <= w / LEAST_CURVATURE:
                excess = turn - w / max(SUDDEN * float(trace["collision.approach"][k]), LEAST_CURVATURE)
                turn = max(turn * (1.0 - 0.5 * most / max(jump[i - 1], ON)), excess, 0.0)
            behind = _behind(behind + turn, min(max(most - jump[i - 1], 0.0), FASTEST * EVERY))
            lost = max(lost - REGAIN * w, 0.0)
        inside = i > 0 and gap[i] < -ON and abs(gap[i - 1]) > ON
        turned = i > 0 and (normal[i] @ normal[i - 1] < 0.5 or (inside and away[i] @ away[i - 1] < 0.5))
        if i > 0 and not turned and min(gap[i - 1], gap[i]) > ON and away[i] @ away[i - 1] < 0.5:
            turned = _leaps(trace, int(ticks[i - 1]), int(k))
        recent = [slice(max(0, i - n), i) for n in (1, round(STILL / EVERY))]
        if turned or any(
            jump[r].sum() > max(MOVES * motion[r].sum(), FASTEST * EVERY * (i - r.start)) + 2e-4 for r in recent
        ):
            regular = False
        if not regular or trace["contact.force"][k] < LEAST_FORCE:
            continue
        e, true = trace["collision.approach"][k], THICKNESS - gap[i]
        edge = abs(gap[i]) > NEAR and away[i] @ normal[i] < np.cos(BENT)
        if edge and e < true:
            lost = true - e
            continue
        away_by, most = float(abs(e - true)), 3e-4 + 0.05 * abs(true) + (lost if e < true else 0.0)
        found = max(found, Score(away_by / most, k * trace.step, away_by, most), key=lambda s: s.score)
        if abs(gap[i]) > 1e-3:
            angle = _between(away[i], trace["contact.normal"][k])
            if edge:  # how far it is from the arc between this direction and the interpolated normal
                angle += _between(normal[i], trace["contact.normal"][k]) - _between(away[i], normal[i])
                angle *= 0.5
            if angle > STEEPEST and (other := _on_other_face(trace, int(k), away[i], float(gap[i]))) < angle:
                angle, behind = other, max(behind, angle)
            most = STEEPEST + behind
            found = max(found, Score(angle / most, k * trace.step, angle, most), key=lambda s: s.score)
    return found


INVARIANTS: dict[str, Callable[[Trace], Score]] = {
    "force": force, "hand": hand, "contact": contact, "lateral": lateral, "rubbing": rubbing, "still": still,
    "energy": energy_gain, "side": side,
}  # fmt: skip
UNITS = {"force": "N", "hand": "N", "contact": "N", "lateral": "N", "rubbing": "N", "still": "rad", "energy": "J",
         "side": "m or rad", "finite": "1", "turned": "of the peak", "refined": "of the peak"}  # fmt: skip


def score_touch(trace: Trace | None) -> dict[str, Score]:
    """The score of each invariant in a touch."""
    if trace is None:
        return {"finite": Score(np.inf, 0.0, 1.0, 0.0)}
    return {name: check(trace) for name, check in INVARIANTS.items()}


def scores(traces: Traces) -> list[dict[str, Score]]:
    """The score of each invariant, for each touch of a batch of one finger."""
    return [score_touch(trace) for trace in trace_batch([traces])[0]]
