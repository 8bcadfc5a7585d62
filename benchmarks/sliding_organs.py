"""A ball that slides over a kidney, or rolls on another ball, without a finger: python benchmarks/sliding_organs.py

The balls of 42 mm are pressed by 2.5 mm at 1 kHz, slide or roll at 30 mm/s, and rest. Force and area over those of the
same organs set up at the end; the largest change of the force in a tick of the slide over that of the press at 8 mm/s;
medians and 99th percentiles of the processor time of a tick of contact.Between in the slide, and at rest. On a roll by
more than 4 mm the contact leaves the cells of the start. The last rolls have another direction and balls that are
turned at the start, or are faster: the force before the rest is that while it rolls. In rolls one ball has more
vertices, so that the cells are those of the same ball at the end.
"""

import argparse
import json
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.contact.between import Between
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

GAP, CLOSING, SPEED, RADIUS, BEGIN, VERTICES = 1e-3, 2.5e-3, 30e-3, 21e-3, -15e-3, 2000
SLIDES = (1e-3, 5e-3, 15e-3, 30e-3)  # [m]
STRAIGHT, TURNED = (0.0, np.zeros((2, 3))), (2.0, np.array([[0.5, -0.3, 1.0], [1.0, 0.4, 0.0]]))
"""Direction [rad], and rotations [rad] (2,3) of both balls at the start."""
ROLLS = [(1e-3, STRAIGHT), (3e-3, STRAIGHT), (5e-3, STRAIGHT), (15e-3, STRAIGHT), (30e-3, STRAIGHT), (15e-3, TURNED),
         (30e-3, TURNED)]  # fmt: skip
FAST = (0.1, 0.2)  # [m/s]
FINER = 2600  # vertices
SETTINGS: dict[str, dict[str, Any]] = {
    "MassSpring": {"stiffness": 257.0, "exponent": 1.0, "damping": 0.0, "retardation": 10e-3},
    "ReducedFE": {"young": 19e3, "model": "linear", "retardation": 10e-3, "organ_loads": 1},
}
Way = list[tuple[np.ndarray, np.ndarray]]  # displacement [m] (3), rotation [rad] (3)


def body(
    kind: str, shape: str, place: np.ndarray, turn: np.ndarray | None = None, vertices: int = VERTICES
) -> dict[str, Any]:
    surface: dict[str, Any] = {"surface": shape, "vertices": vertices, "position": tuple(map(float, place))}
    if turn is not None:
        surface["rotation"] = tuple(map(float, turn))
    return {"use": kind, "settings": SETTINGS[kind] | surface, "surface": surface}


def run(bodies: list[dict[str, Any]], way: Way, turns: bool = False, **given: Any) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and area [m²] (T,2), and processor time [s] (T) of each tick."""
    contact, found, spent = Between(bodies=json.dumps(bodies), **given), [], []
    contact.start()
    centre = np.array(bodies[0]["surface"]["position"])
    for at, turn in way:
        more: dict[str, Any] = {"rotation": turn, "spin": np.zeros(3), "centre": centre} if turns else {}
        x, y, z = map(float, at)
        moved = Support(displacement=(x, y, z), velocity=(0.0, 0.0, 0.0), **more)
        messages = contact._inputs(([], []), {"first_support": [moved]})
        records = contact.records(messages)
        begun = time.thread_time()
        records.compute(messages, 1e-3)
        spent.append(time.thread_time() - begun)
        (answer,) = records.read()
        assert isinstance(answer, OrganContact)
        found.append((answer.force, answer.area))
    return np.array(found), np.array(spent)


def pressing(normal: np.ndarray) -> Way:
    """The way into the other organ, and a rest."""
    return [(-CLOSING * share * normal, np.zeros(3)) for share in [*np.linspace(0.0, 1.0, 300), *[1.0] * 100]]


def height(x: float) -> float:
    """Of the ball above the kidney at x [m]."""
    ball, kidney = (surface_mesh(shape, VERTICES, (0.0, 0.0, 0.0)) for shape in ("sphere", "kidney"))
    z, search = 0.1, MeshClosestPoint(kidney)
    while abs(away := float(search.find(ball.vertices + (x, 0.0, z))[3].min()) - GAP) > 1e-7:
        z -= 0.8 * away
    return z


def report(name: str, kind: str, way: float, found: np.ndarray, right: np.ndarray, spent: np.ndarray) -> None:
    force, change = found[:, 0], np.abs(np.diff(found[:, 0]))
    slide, rest = 1e6 * spent[400:-400], 1e6 * spent[-300:]
    print(
        f"{kind} {name} {1e3 * way:g} mm: {force[-1]:.4f} N, {force[-1] / right[-1, 0]:.3f} of the right force, "
        f"{force[-401] / right[-1, 0]:.3f} before the rest, "
        f"{found[-1, 1] / right[-1, 1]:.3f} of the area; change {change[400:].max() / change[:299].max():.2f} of the "
        f"press; {np.median(slide):.0f}, 99 %: {np.percentile(slide, 99):.0f} us, at rest {np.median(rest):.0f} us",
        flush=True,
    )


def slide(kind: str, way: float) -> None:
    """A ball that slides along a kidney, always with the same gap without load."""
    up, z = np.array([0.0, 0.0, 1.0]), height(BEGIN)
    knots = np.linspace(0.0, way, 16)
    heights = [height(BEGIN + each) - z for each in knots]
    path = pressing(up)
    for along in np.linspace(0.0, way, max(round(way / SPEED * 1e3), 2)):
        path.append((np.array([along, 0.0, np.interp(along, knots, heights) - CLOSING]), np.zeros(3)))
    path += [path[-1]] * 400
    kidney = body(kind, "kidney", np.zeros(3))
    found, spent = run([body(kind, "sphere", np.array([BEGIN, 0.0, z])), kidney], path)
    right, _ = run([body(kind, "sphere", np.array([BEGIN + way, 0.0, height(BEGIN + way)])), kidney], pressing(up))
    report("slide", kind, way, found, right, spent)


def roll(kind: str, way: float, heading: float, turns: np.ndarray, speed: float = SPEED) -> None:
    """A ball that rolls on a ball: the contact moves by the way on both."""
    far, up = 2.0 * RADIUS + GAP, np.array([0.0, 0.0, 1.0])
    along, axis = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([-np.sin(heading), np.cos(heading), 0.0])
    path = pressing(up)
    for angle in np.linspace(0.0, way / RADIUS, max(round(way / speed * 1e3), 2)):
        out = np.sin(angle) * along + np.cos(angle) * up
        path.append(((far - CLOSING) * out - far * up, 2.0 * angle * axis))
    path += [path[-1]] * 400
    end = (Rotation.from_rotvec(2.0 * angle * axis) * Rotation.from_rotvec(turns[0])).as_rotvec()
    lower = body(kind, "sphere", np.zeros(3), turns[1])
    found, spent = run([body(kind, "sphere", far * up, turns[0], FINER), lower], path, True)
    right, _ = run([body(kind, "sphere", far * out, end, FINER), lower], pressing(out))
    name = "roll of turned balls" if heading else "roll" if speed == SPEED else f"roll at {speed:g} m/s"
    report(name, kind, way, found, right, spent)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    for kind in SETTINGS:
        for way in SLIDES:
            slide(kind, way)
        for way, (heading, turns) in ROLLS:
            roll(kind, way, heading, turns)
        for speed in FAST:
            roll(kind, 15e-3, *STRAIGHT, speed)


if __name__ == "__main__":
    main()
