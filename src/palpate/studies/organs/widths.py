"""What holds for a finger that has a width: a gap narrower than it loses no force, and a bridge adds none.

A finger presses and holds. Its force at the end is compared with that on a body of which the answer is known. F is the
contact force on the body with the gap, F_0 that of the same touch on the whole body, w the width of the gap and r half
the width of the finger. Forces have a lower and an upper bound.

merged    F_0 within 2 % + 0.02 N: a body of the zoo without a slab of 0.05 to 0.2 mm in a random plane. Its other
          points are the same, and the closing dips by w²/(8 r) <= 0.6 um. Balls that overlap against their union
turns     the normals of these two touches differ by at most 3 degrees
gap       F_0 within a share of `WITHIN` + 0.02 N: the block in two pieces, and with a comb of slots
groove    F <= F of the next narrower groove, or of the whole block, + 1 % + 0.01 N, and >= 0.9 x the force that the
          tissue and fingertip have at rest at the depth that the closing leaves, less r - (r² - w²/4)^½, or the depth
          of the groove where it is wider than the finger, - 0.02 N. A fissure of an ellipsoid like a groove
sideways  part of the normal along the flat top <= w/(2 r) + 0.02
same      F_0 exactly, at each tick: a convex body with the width of the finger and without
spun      F within 1 % + 0.01 N of that of hand and organ turned together, which turns the grid of the closing
beams     a BeamBundle loses the beams that are missing over a gap: the lower bounds of merged, gap and groove are
          times the stiffness that they leave (`gaps`)
again     a surface that is closed once more changes on 99 % of its area by at most twice the error of a closing, that
          of chords of the grid's step h on its spheres and the lift of the rims: 2 (h²/(8 r) + 10 um) = 51 um
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.physics.device.falcon import HOME
from palpate.physics.geometry.felt.bridge import RIM, STEP, close_surface
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.organs.gaps import (
    DEEP,
    FISSURE,
    GROOVES,
    HIGH,
    MM,
    force_left,
    name_of_cut,
    plane_of,
)
from palpate.studies.organs.pairs import turn_touch
from palpate.studies.organs.reference import at_rest
from palpate.studies.organs.runs import Traces, run
from palpate.studies.organs.score import Score
from palpate.studies.organs.search import Found
from palpate.studies.organs.settings import WIDTH, varied
from palpate.studies.organs.touches import THICKNESS, Finger, Setting, Touch, reachable
from palpate.studies.organs.trace import LEAST_FORCE
from palpate.studies.organs.zoo import USUAL, Specimen, mesh_of

NEAR = 12 * MM  # [m] from a gap within which a finger presses
CLOSE = 3 * MM  # [m] within which half of the touches are
FREE = 12 * MM  # [m] of the body below the finger, without another side
CUTS = (0.05, 0.1, 0.2)  # [mm]
MERGED, NARROW, LIGHT = 0.02, 0.01, 0.02  # [1], [1], [N]
MOST, TURNS = 0.99, np.deg2rad(3.0)  # [1] of the area, [rad]
WITHIN = {"cut-0.05": NARROW, "cut-0.2": MERGED, "cut-0.5": MERGED, "cut-2": 0.04, "comb": 0.04}  # [1] of the force
CONVEX = ("sphere", "ellipsoid", "box", "plate-20")
ACROSS, ALONG = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
SEAMS = {
    "cut-0.2": (ACROSS, 0.0), "groove-4": (ACROSS, 0.0), "fissure": (ACROSS, 0.0), "comb": (ACROSS, 0.0),
    "near": (ALONG, 20.1 * MM), "union": (ALONG, 9.0 * MM),
}  # fmt: skip
"""The plane of a gap, its normal [1] (3) and distance from the origin [m], by body."""
TRIES = 400


def press_touch(setting: Setting, place: np.ndarray, toward: np.ndarray, deep: float) -> Touch:
    """A touch that presses at a point of the surface [m] (3) in a direction [1] (3), and holds."""
    start, bottom = (place - toward * d for d in (THICKNESS + 6 * MM, THICKNESS - deep))
    points = [tuple(round(float(x), 6) for x in each) for each in (start, bottom)]
    path: tuple[dict[str, Any], ...] = (
        {"to": list(points[1]), "time": 0.3, "shape": "minimum-jerk"}, {"hold": 0.5},
    )  # fmt: skip
    x, y, z = (round(float(c), 4) for c in 0.5 * (start + bottom) - HOME)
    (a, b, c) = points[0]
    return Touch(setting, (Finger((a, b, c), (x, y, z), path),))


def draw_press(setting: Setting, away: np.ndarray, offset: float, rng: np.random.Generator) -> Touch | None:
    """A random press of a whole body within `NEAR` of a plane (its normal [1] (3) and offset [m]); None: there is no
    place where the device reaches and no other side is near."""
    mesh, closest = setting.mesh(), setting.closest()
    areas = np.linalg.norm(mesh.face_vectors, axis=1)
    distance = mesh.vertices[mesh.triangles].mean(axis=1) @ away - offset
    near = np.abs(distance) < (NEAR if rng.uniform() < 0.5 else CLOSE)
    share = np.where(near, areas, 0.0)
    if not share.sum() > 0.0:
        return None
    for _ in range(TRIES):
        place = mesh.vertices[mesh.triangles[rng.choice(len(share), p=share / share.sum())]].mean(axis=0)
        normal = closest.find(place + 1e-9)[1]
        line = np.linspace(MM, FREE, 8)[:, None]
        inside, outside = (closest.find(place + sense * normal * line)[3] for sense in (-1.0, 1.0))
        if (inside > -0.9 * line[:, 0]).any() or (outside < 0.9 * line[:, 0]).any():
            continue
        touch = press_touch(setting, place, -normal, float(rng.uniform(5 * MM, 12 * MM)))
        if reachable(touch.fingers[0]):
            return touch
    return None


class Ends:
    """The ends of touches: force [N] (L), foot and normal (L,3), gap [m] (L), and the time [s]."""

    def __init__(self, touches: Sequence[Touch], folder: Path, extra: Sequence[str] = ()) -> None:
        self.traces: Traces = run(touches, folder, extra=extra)[0]
        last = np.array([round((t.duration - 0.15) / self.traces.step) for t in touches])
        lanes = np.arange(len(touches))
        self.time = last * self.traces.step
        self.force, self.foot, self.normal, self.gap = (
            self.traces[name][lanes, last]
            for name in ("contact.force", "contact.foot", "contact.normal", "collision.gap")
        )


def within(value: float, least: float, bound: float, time: float, one_sided: bool = False) -> Score:
    """The score of a value between two bounds: the distance from their middle over half of theirs.

    one_sided  value over the upper bound, of a value that is not negative
    """
    if one_sided:
        return Score(value / bound, time, value, bound, least)
    middle, half = 0.5 * (least + bound), max(0.5 * (bound - least), 1e-12)  # bounds that exclude each other: broken
    return Score(abs(value - middle) / half, time, value, bound, least)


def on(touch: Touch, surface: str) -> Touch:
    """The touch on another surface."""
    return replace(touch, setting=replace(touch.setting, surface=surface))


def compare_cut(
    whole: Sequence[Touch], cut: str, share: float, name: str, folder: Path, extra: Sequence[str] = ()
) -> list[Found]:
    """Touches of the whole body and of the cut one, within a share of the force; `name` of the relation."""
    touches = [on(touch, cut) for touch in whole]
    one, two, found = Ends(whole, folder), Ends(touches, folder, extra), list[Found]()
    for k, touch in enumerate(touches):
        f, g, time = float(one.force[k]), float(two.force[k]), float(two.time[k])
        slack = share * f + LIGHT
        least = force_left(touch.setting.body, cut, 0.5 * touch.setting.width) * f - slack
        found.append(Found(touch, name, within(g, least, f + slack, time)))
        if name == "merged" and f > LEAST_FORCE:
            angle = float(2.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(one.normal[k] - two.normal[k])))))
            found.append(Found(touch, "turns", within(angle, 0.0, TURNS, time, one_sided=True)))
    return found


def merged(
    specimen: Specimen, body: str, count: int, rng: np.random.Generator, folder: Path, extra: Sequence[str] = ()
) -> list[Found]:
    """Touches of a body of the zoo near a random plane, cut there and whole."""
    number, gap = int(rng.integers(1_000_000)), float(rng.choice(CUTS))
    setting = varied(Setting(specimen.name, USUAL, body, friction=""), rng)
    away, offset = plane_of(mesh_of(specimen.name, USUAL), number)
    drawn = [draw_press(setting, away, offset, rng) for _ in range(count)]
    whole = [touch for touch in drawn if touch is not None]
    if not whole:
        return []
    return compare_cut(whole, name_of_cut(specimen.name, gap, number), MERGED, "merged", folder, extra)


def top_presses(setting: Setting, count: int, rng: np.random.Generator) -> list[Touch]:
    """Presses on the flat top of the block, straight down, at most `NEAR` from its middle."""
    found = []
    for _ in range(count):
        far = NEAR if rng.uniform() < 0.5 else CLOSE
        x, y = rng.uniform(-5 * MM, 5 * MM), rng.uniform(-far, far)
        place, down = np.array([x, y, 0.5 * HIGH]), np.array([0.0, 0.0, -1.0])
        found.append(press_touch(setting, place, down, float(rng.uniform(4 * MM, 11 * MM))))
    return found


def block_relations(
    body: str, count: int, rng: np.random.Generator, folder: Path, extra: Sequence[str] = ()
) -> list[Found]:
    """Gaps and grooves of the block, of each width the same touches."""
    setting = varied(Setting("block", USUAL, body, friction=""), rng)
    whole, found, r = top_presses(setting, count, rng), [], 0.5 * setting.width
    for name, share in WITHIN.items():
        found += compare_cut(whole, name, share, "gap", folder, extra)
    before = Ends(whole, folder)
    for width in GROOVES:
        touches, half = [on(touch, f"groove-{width:g}") for touch in whole], 0.5 * width * MM
        ends = Ends(touches, folder, extra)
        found += _below(touches, before, ends, dip_of(r, half, DEEP))
        for lane, touch in enumerate(touches):
            tilt, time = float(np.linalg.norm(ends.normal[lane][:2])), float(ends.time[lane])
            most = min(1.0, half / r) + 0.02
            found.append(Found(touch, "sideways", within(tilt, 0.0, most, time, one_sided=True)))
        before = ends
    return found


def dip_of(r: float, half: float, deep: float) -> float:
    """Depth [m] to which a ball of the radius r [m] sinks in a groove of half the width `half` and the depth `deep`."""
    return min(deep, r - float(np.sqrt(r * r - half * half))) if half < r else deep


def _below(touches: Sequence[Touch], whole: Ends, ends: Ends, dip: float) -> list[Found]:
    """Bounds of the force over a groove, whose closing is at most `dip` [m] lower than the whole body."""
    rest, found, setting = at_rest(whole.traces), [], touches[0].setting
    left = force_left(setting.body, setting.surface, 0.5 * setting.width)
    for lane, touch in enumerate(touches):
        f, most, time = float(ends.force[lane]), float(whole.force[lane]), float(ends.time[lane])
        bone = ends.traces["finger.position"][lane, round(time / ends.traces.step)]
        foot, normal = whole.foot[lane], whole.normal[lane]
        depth = THICKNESS - dip - float((bone - foot) @ normal)
        least = 0.9 * left * float(rest.place(foot, normal).force(depth)) - LIGHT
        found.append(Found(touch, "groove", within(f, least, 1.01 * most + 0.01, time)))
    return found


def fissure(body: str, count: int, rng: np.random.Generator, folder: Path, extra: Sequence[str] = ()) -> list[Found]:
    """Touches of an ellipsoid near its fissure, and of the whole one."""
    setting = varied(Setting("unfissured", USUAL, body, friction=""), rng)
    drawn = [draw_press(setting, *SEAMS["fissure"], rng) for _ in range(count)]
    whole = [touch for touch in drawn if touch is not None]
    if not whole:
        return []
    touches = [on(touch, "fissure") for touch in whole]
    dip = dip_of(0.5 * setting.width, 0.5 * FISSURE, DEEP)
    return _below(touches, Ends(whole, folder), Ends(touches, folder, extra), dip)


def same(specimen: Specimen, body: str, count: int, rng: np.random.Generator, folder: Path) -> list[Found]:
    """Touches of a body without a gap, with the width of the finger and without: nothing changes."""
    setting = Setting(specimen.name, USUAL, body, friction="", width=WIDTH)
    drawn = [draw_press(setting, np.array([0.0, 0.0, 1.0]), 0.0, rng) for _ in range(count)]
    wide = [touch for touch in drawn if touch is not None]
    if not wide:
        return []
    one = run(wide, folder)[0]
    two = run([replace(t, setting=replace(t.setting, width=0.0)) for t in wide], folder)[0]
    found = []
    for lane, touch in enumerate(wide):
        off = float(np.abs(one["contact.force"][lane] - two["contact.force"][lane]).max())
        found.append(Found(touch, "same", within(off, 0.0, 1e-12, 0.0, one_sided=True)))
    return found


def spun(surface: str, body: str, count: int, rng: np.random.Generator, folder: Path) -> list[Found]:
    """Touches of a body near its gap, of hand and organ turned together."""
    setting = replace(varied(Setting(surface, USUAL, body, friction=""), rng), exact=True)
    turn = Rotation.random(random_state=int(rng.integers(1_000_000)))
    drawn = [draw_press(setting, *SEAMS[surface], rng) for _ in range(count)]
    pairs = [(touch, turn_touch(touch, turn)) for touch in drawn if touch is not None]
    pairs = [pair for pair in pairs if reachable(pair[1].fingers[0])]
    if not pairs:
        return []
    one, two = (Ends([pair[k] for pair in pairs], folder) for k in (0, 1))
    found = []
    for (_, touch), f, g, time in zip(pairs, one.force.tolist(), two.force.tolist(), two.time.tolist(), strict=True):
        found.append(Found(touch, "spun", within(g, 0.99 * f - 0.01, 1.01 * f + 0.01, time)))
    return found


def again(surface: str) -> list[Found]:
    """A felt surface that is closed a second time; none if the body needs no bridge."""
    setting, r = Setting(surface, USUAL, width=WIDTH), 0.5 * WIDTH
    felt = close_surface(setting.mesh(), r)
    if felt is None:
        return []
    twice, off = close_surface(felt.mesh, r), 0.0
    if twice is not None:
        away = np.abs(MeshClosestPoint(felt.mesh).find_along(twice.mesh.vertices)[3])
        order = np.argsort(away)
        share = np.cumsum(twice.mesh.areas[order])
        off = float(away[order][np.searchsorted(share, MOST * share[-1])])
    bound = 2.0 * ((STEP * r) ** 2 / (8.0 * r) + RIM)
    place = setting.mesh().vertices[0]
    touch = press_touch(setting, place, np.array([0.0, 0.0, -1.0]), MM)
    return [Found(touch, "again", within(off, 0.0, bound, 0.0, one_sided=True))]


def overlaps(body: str, count: int, rng: np.random.Generator, folder: Path, extra: Sequence[str] = ()) -> list[Found]:
    """Touches of two balls that overlap, near their seam, and of the surface of both."""
    setting = varied(Setting("union", USUAL, body, friction=""), rng)
    drawn = [draw_press(setting, *SEAMS["union"], rng) for _ in range(count)]
    whole = [touch for touch in drawn if touch is not None]
    return compare_cut(whole, "overlap", MERGED, "merged", folder, extra) if whole else []
