"""The invariant `side`: direction and depth of a contact are those of the nearest point of the surface.

While the nearest point of the surface has moved continuously since the finger touched (in 4 and 20 ms at 0.1 m/s, or
twice as far as the finger along the surface; its direction by less than 60 degrees), the normal is within 0.35 rad of
the direction from it, and the approach within 0.3 mm + 5 %. At an edge the interpolated normal differs from this
direction; the normal is within 0.35 rad of the arc between both, and the approach may be smaller, so that the hand
gains no energy (`geometry.proxy`), until the finger has moved by five times the difference. The normal may be behind by
an angle delta. Over an edge the nearest point's direction turns by more than w/R, the most that `still` allows the
normal, and delta grows by all of it; near a centre of curvature the nearest point moves J while the foot moves at most
m, `EASY` times as far as the finger along the surface or at `FASTEST` (half of it on the mean, since each leap from
triangle to triangle starts it again), and delta grows by the part 1 - m/2J of its turn. While the foot gains on the
nearest point, by m - J but no faster than `FASTEST`, delta decreases by the smaller of 1/R and delta/LANDING per
distance, since the foot arrives without stopping abruptly (`geometry.proxy`). A foot that still waits, as it is farther
from the finger by at most the hysteresis, gains nothing on it. Inside, at an approach e and a depth d, the normal turns
by at most w/(e/6) (`SUDDEN`) and m/d, and delta grows by at least what this lacks. A finger that enters along the
bisector of an edge is equally near to two faces, 90 degrees apart: the foot stays on its face until another is nearer
by the hysteresis h (`nodes.collision`). So a foot that is farther by at most h also counts: with theta between both
directions, the nearest point of the finger moved by h/(1 - cos theta) towards the foot is on its face; from there on
delta is the angle between the faces, and does not decrease before a foot at its greatest speed, which loses `FASTEST`
in `ARRIVES`, has stopped: it first stops on its way, then turns round. The foot of the smooth surface through a mesh is
between two faces that are equally near, by h: with the angle of the normal alpha, the nearest point of the finger moved
by h/alpha towards the foot is on the other face, and the normal is within 0.35 rad of the arc between both directions.
A foot within 0.2 mm of the nearest point counts as there: over an edge of a coarse mesh the interpolated normal turns
by 1 rad within this distance. At the corner of a block next to the bridge over its groove a foot is as near to the
finger as the bridge, by 0.2 mm: its normal is within 0.35 rad of the arc between the interpolated normal there, or
where it was up to 20 ms ago, and the direction from it. A finger that comes out of the body past another face than that
of its foot leaves with the approach that it had, which falls by the finger's motion (`geometry.proxy`): it may be
greater by what it was then, less half of the motion that does not remove it from the surface.
"""

from __future__ import annotations

import numpy as np

from palpate.physics.geometry.proxy import ARRIVES, EASY, FASTEST, LANDING, REGAIN, SUDDEN
from palpate.studies.organs.score import Score
from palpate.studies.organs.touches import THICKNESS
from palpate.studies.organs.trace import LEAST_CURVATURE, LEAST_FORCE, ON, Trace, length

STEEPEST = 0.35  # [rad]
BENT = 0.2
"""[rad] Near an edge the interpolated normals of a mesh differ by more from the direction to the nearest point."""
NEAR = 2e-4  # [m] from the surface beyond which an edge is recognized by this direction
MOVES = EASY  # [1] motion of the nearest point over that of the finger
CLOSE = 2e-4  # [m] from the nearest point, or farther from the finger: a foot that is nearer counts as at it
PART = 1.5e-4  # [m] of the finger's motion between looks for a leap of the nearest point
EVERY, LONGER = 4e-3, 20e-3  # [s] between comparisons with the nearest point, and of its leaps


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


def _waits(trace: Trace, before: int, tick: int, gap: float) -> bool:
    """Whether the foot has not moved between two ticks, and is farther from the finger than the surface, but by no more
    than the hysteresis."""
    foot, last = trace["collision.foot"][[tick, before]]
    farther = float(length(trace["finger.position"][tick] - foot)) - abs(gap)
    return bool(length(foot - last) <= ON and ON < farther <= float(trace.nodes["collision"]["hysteresis"]))


def _at_foot(trace: Trace, tick: int, gap: float) -> float:
    """Angle [rad] of the normal to the arc between the interpolated normal at the foot, now or 10 or 20 ms ago, and the
    direction from there; inf if the foot is farther from the finger than the surface by more than `CLOSE`, twice the
    hysteresis: it has just begun to move.

    gap  [m] signed distance of the nearest point
    """
    p, foot = trace["finger.position"][tick], trace["collision.foot"][tick]
    far = float(length(p - foot))
    if far > abs(gap) + CLOSE:
        return np.inf
    away = np.sign(gap) * (p - foot) / max(far, ON)
    ticks = [tick, *(max(tick - trace.ticks(part * LONGER), 0) for part in (0.5, 1.0))]
    normals = trace.closest(trace["collision.foot"][ticks] + ON * away)[1]
    return min(_from_arc(trace, normal, away, tick) for normal in normals)


def _between_faces(trace: Trace, tick: int, nearest: np.ndarray, away: np.ndarray, gap: float, angle: float) -> float:
    """Angle [rad] of the normal to the arc between two directions: from the nearest point, and from another face that
    is as near, by the hysteresis, on the side of the foot; inf if the foot is farther. The foot of the smooth surface
    is between both.

    nearest, away, gap  [m], [1] (3), [m]  nearest point of the finger, direction from it, and its signed distance
    angle               [rad] of the normal to this direction
    """
    p, foot = trace["finger.position"][tick], trace["collision.foot"][tick]
    hysteresis, aside = float(trace.nodes["collision"]["hysteresis"]), foot - nearest
    if float(length(p - foot)) > abs(gap) + hysteresis:
        return np.inf
    place = p + aside * (hysteresis / (angle * max(float(length(aside)), ON)))
    there, _, _, left = trace.closest(place[None])
    if abs(left[0]) <= ON:
        return np.inf
    other = (place - there[0]) / left[0]
    return max(_from_arc(trace, away, other, tick), 0.0)


def _from_arc(trace: Trace, one: np.ndarray, other: np.ndarray, tick: int) -> float:
    """Angle [rad] of the normal of a tick to the arc between two directions [1] (3)."""
    normal = trace["contact.normal"][tick]
    return 0.5 * (_between(one, normal) + _between(other, normal) - _between(one, other))


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
    found, regular, behind, lost, stops, leaves = Score(0.0, 0.0, 0.0, 0.0), True, 0.0, 0.0, 0.0, 0.0
    for i, k in enumerate(ticks):
        if not touching[i]:
            regular, behind, lost, stops, leaves = True, 0.0, 0.0, 0.0, 0.0
            continue
        if i > 0:
            turn = max(_between(each[i - 1], each[i]) for each in ((normal, away) if abs(gap[i]) > ON else (normal,)))
            most, w = max(EASY * motion[i - 1], FASTEST * EVERY), float(length(step[i - 1]))
            turns = min(w / max(SUDDEN * float(trace["collision.approach"][k]), LEAST_CURVATURE),
                        most / max(-float(trace["collision.gap"][k]), ON))  # fmt: skip
            least = behind + turn - turns
            if turn <= w / LEAST_CURVATURE:
                turn = max(turn * (1.0 - 0.5 * most / max(jump[i - 1], ON)), turn - turns, 0.0)
            waits = stops > 0.0 or _waits(trace, int(ticks[i - 1]), int(k), float(gap[i]))
            gains = 0.0 if waits else min(max(most - jump[i - 1], 0.0), FASTEST * EVERY)
            behind, stops = max(_behind(behind + turn, gains), least), stops - EVERY
            lost = max(lost - REGAIN * w, 0.0)
            leaves = max(leaves - 0.5 * max(w - max(float(gap[i] - gap[i - 1]), 0.0), 0.0), 0.0)
        inside = i > 0 and gap[i] < -ON and abs(gap[i - 1]) > ON
        turned = i > 0 and (normal[i] @ normal[i - 1] < 0.5 or (inside and away[i] @ away[i - 1] < 0.5))
        if i > 0 and not turned and min(gap[i - 1], gap[i]) > ON and away[i] @ away[i - 1] < 0.5:
            turned = _leaps(trace, int(ticks[i - 1]), int(k))
        recent = [slice(max(0, i - n), i) for n in (1, round(LONGER / EVERY))]
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
        if trace["collision.gap"][k] < 0.0 < gap[i]:
            leaves = max(leaves, e - true)
        away_by, most = float(abs(e - true)), 3e-4 + 0.05 * abs(true) + (lost if e < true else leaves)
        found = max(found, Score(away_by / most, k * trace.step, away_by, most), key=lambda s: s.score)
        if abs(gap[i]) > 1e-3:
            angle = _between(away[i], trace["contact.normal"][k])
            if edge:  # how far it is from the arc between this direction and the interpolated normal
                angle = _from_arc(trace, normal[i], away[i], int(k))
            there = trace["collision.foot"][k]
            if angle > STEEPEST and length(there - foot[i]) <= CLOSE:
                angle = min(angle, _from_arc(trace, trace.closest(there[None] + ON * away[i])[1][0], away[i], int(k)))
            if angle > STEEPEST and (other := _on_other_face(trace, int(k), away[i], float(gap[i]))) < angle:
                angle, behind = other, max(behind, angle)
                stops = ARRIVES * max(EASY * motion[max(i - 1, 0)], FASTEST * EVERY) / (FASTEST * EVERY)
            if angle > STEEPEST:
                angle = min(angle, _between_faces(trace, int(k), foot[i], away[i], float(gap[i]), angle))
            if angle > STEEPEST + behind:
                angle = min(angle, _at_foot(trace, int(k), float(gap[i])))
            most = STEEPEST + behind
            found = max(found, Score(angle / most, k * trace.step, angle, most), key=lambda s: s.score)
    return found
