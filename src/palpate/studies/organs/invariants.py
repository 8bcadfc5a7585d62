"""What holds for every touch of every surface: bounds on the force, its changes, its direction and its energy.

A score is a value over its bound: above 1 the invariant is broken.

force    contact force <= 0.03 N + 1.2 x the force of the series law at the greatest approach e, approach rate v and
         speed along the surface u of the last 60 ms, of the finger, or of its foot up to twice that (`reference`). At
         rest it is the quasi-static force of the depth. v is a mean over 2 ms along the normal, or that of the finger
         towards the point of the surface that is nearest now: one that slides into a wall, or starts, approaches at its
         speed. A patch that rolls over a rim indents another face, whose tissue has not yielded: its rate e (omega -
         u/8 mm), omega the turn of the normal within 0.5 ms and u the speed along the surface, counts for a body with a
         memory of the place. Beyond the thickness of the fingertip's soft tissue its law, and so the force, is not
         valid, as a note reports: it is exponential, and 0.2 mm are 35 %. Under two fingers e and v are those
         to the surface that the other finger lifts, by at most 1.2 x its force by this law.
hand     change of the force on the hand within W = 1 ms <= (1 + m²)^½ ((k + f/R) w + B (dv + v w/R + v at the first
         contact) + (f - f_0) W/2 ms) + f (sigma_0 w + (sigma_1 + sigma_2) dv) + k_t w + 0.1 N, where
         w, dv, v: path, change of velocity and speed of the *finger* within W and two steps before. The foot does not
                 appear: a foot that moves while the finger does not must not change the force. A second finger that
                 presses moves the surface: of its motion the part counts that the body at rest transmits, and w grows
                 by the displacement here under the change of its force;
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
         contact would also end. After a contact it may fall to zero at that slope. While a finger moves out by less
         than an encoder step and a half, the controller may hold a force that falls, as by another finger, for a step
         (`device.rendered`): the fall of the step before counts too.
felt     what the hand lacks of the contact's force while that is soft (`felt`).
contact  the same as `hand` of f n + lateral force, before the controller limits its rate.
lateral  force along the surface without friction <= 0.5 f + 0.05 N; a body whose stiffness changes by a factor e within
         30 mm pulls with s/(2 x 30 mm), 0.17 f at 10 mm.
rubbing  friction <= (max(mu_s, a mu_s + sigma_1 v) + sigma_2 v + 0.05) f + 0.02 N. Bristles that are bent add sigma_1
         times their rate: v at first, and, where the law has a share `a` in which they are elastic, up to there.
still    the normal turns within 20 ms by at most w/R + 0.02, w the sum of the extents of the finger's motion in eight
         parts of 2.5 ms: a finger that turns round and goes back has moved. On a rigid body the fingertip, 10 kN/m at
         6 N, and the hand, 0.15 kg, turn round in a quarter of 24 ms.
energy   work of the force on the hand over a closed path <= 0.5 mJ + 2 % of the work that went to and fro. One finger
         lifts another through the organ: the work on both hands together.
side     direction and depth are those of the nearest point (`side`).
finite   no lane stops, and every value is finite.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np

from palpate.studies.organs.bounds.crowded import is_crowded
from palpate.studies.organs.bounds.felt import lacks
from palpate.studies.organs.bounds.side import side
from palpate.studies.organs.runs import Traces
from palpate.studies.organs.score import Score
from palpate.studies.organs.trace import (
    ABOVE,
    LEAST_CURVATURE,
    LEAST_FORCE,
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


def worst(trace: Trace, values: np.ndarray, bounds: np.ndarray, start: int = 0) -> Score:
    """The largest value over its bound."""
    if not len(values):
        return Score(0.0, 0.0, 0.0, 0.0)
    share = values / bounds
    k = int(np.argmax(share))
    return Score(float(share[k]), (k + start) * trace.step, float(values[k]), float(bounds[k]))


def force(trace: Trace) -> Score:
    f, fast = trace["contact.force"], trace.fast
    f = np.where(trace["contact.compression"] > trace.valid, 0.0, f)
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
        other = trace.other["contact.force"]
        theirs_changes = greatest(other, n + 3) + greatest(-other, n + 3)
        moved = moved + trace.yields_most * theirs_changes
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
        if trace.carried > 0.0:
            moved[k] += max(trace.yield_at(k) - trace.yields_most, 0.0) * theirs_changes[k]
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
        f, held = trace["contact.force"], np.zeros(len(trace["contact.force"]))
        held[n + 1 :] = np.maximum(f[: -n - 1] - f[1:-n], 0.0)  # the fall of the step before
        return _change(trace, felt, True, held + np.where(ended, np.minimum(most, before), np.minimum(most, damped)))
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
    fingers = [trace] if trace.other is None else [trace, trace.other]
    if is_crowded(trace):
        return Score(0.0, 0.0, 0.0, 0.0)
    if not trace["contact.force"].max() > 0.0 or any(each["contact.force"][-1] > 0.0 for each in fingers):
        return Score(0.0, 0.0, 0.0, 0.0)
    work = np.concatenate([_work(each) for each in fingers])
    gain, turned = float(work.sum()), float(np.abs(work).sum())
    bound = CREDIT + SHARE * turned
    return Score(max(gain, 0.0) / bound, len(trace["contact.force"]) * trace.step, gain, bound)


def _work(trace: Trace) -> np.ndarray:
    """Work [J] of the force on the hand in each step."""
    return np.einsum("ij,ij->i", trace["controller.force"][:-1], np.diff(trace["finger.position"], axis=0))


def felt(trace: Trace) -> Score:
    return lacks(trace, _observed(trace))


INVARIANTS: dict[str, Callable[[Trace], Score]] = {
    "force": force, "hand": hand, "felt": felt, "contact": contact, "lateral": lateral, "rubbing": rubbing,
    "still": still, "energy": energy_gain, "side": side,
}  # fmt: skip
UNITS = {"force": "N", "hand": "N", "felt": "N", "contact": "N", "lateral": "N", "rubbing": "N", "still": "rad",
         "energy": "J", "side": "m or rad", "finite": "1", "turned": "of the peak", "refined": "of the peak",
         "merged": "N", "turns": "rad", "gap": "N", "groove": "N", "slide": "N", "sideways": "1", "same": "N",
         "spun": "N", "again": "m"}  # fmt: skip


def score_touch(trace: Trace | None) -> dict[str, Score]:
    """The score of each invariant in a touch."""
    if trace is None:
        return {"finite": Score(np.inf, 0.0, 1.0, 0.0)}
    return {name: check(trace) for name, check in INVARIANTS.items()}


def scores(traces: Traces) -> list[dict[str, Score]]:
    """The score of each invariant, for each touch of a batch of one finger."""
    return [score_touch(trace) for trace in trace_batch([traces])[0]]
