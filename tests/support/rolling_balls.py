"""A ball on another one, of which it is pressed into, rolls on or turns against: `contact.Between` step by step."""

import json

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.messages.tissue import Support
from palpate.nodes.contact.between import Between

GAP, CLOSING, RADIUS = 1e-3, 2.5e-3, 21e-3
FAR, UP = 2 * RADIUS + GAP, np.array([0.0, 0.0, 1.0])
SETTINGS = {
    "MassSpring": {"stiffness": 257.0, "exponent": 1.0, "damping": 0.0, "retardation": 5e-3},
    "ReducedFE": {"young": 19e3, "model": "linear", "retardation": 5e-3, "organ_loads": 1},
}


def contact(kind, place, turns, vertices=(2600, 2000), exchanged=False, **settings):
    """The contact of a ball at a place [m] (3) with one at the origin; turns [rad] (2,3) of both."""
    bodies = []
    for at, turn, count in zip((place, (0.0, 0.0, 0.0)), turns, vertices, strict=True):
        surface = {"surface": "sphere", "vertices": count, "position": tuple(map(float, at)),
                   "rotation": tuple(map(float, turn))}  # fmt: skip
        bodies.append({"use": kind, "settings": SETTINGS[kind] | surface, "surface": surface})
    made = Between(bodies=json.dumps(bodies[::-1] if exchanged else bodies), **settings)
    made.start()
    return made


def course(made, path, exchanged=False, rate=1000, loads=()):
    """The messages for these displacements [m] and rotations [rad] (n,2,3) of the upper ball; loads: on each body."""
    side, found = "second_support" if exchanged else "first_support", []
    for at, turn in path:
        moved = Support(displacement=tuple(map(float, at)), velocity=(0.0, 0.0, 0.0), rotation=np.array(turn),
                        spin=np.zeros(3), centre=FAR * UP)  # fmt: skip
        found.append(made.step([*loads], [*loads], **{side: [moved]}, dt=1.0 / rate))
    return found


def roll(way, heading, speed=30e-3, rate=1000, closing=CLOSING):
    """Displacements and rotations (n,2,3) that press the ball by `closing` [m] within 0.3 s, and roll it by `way` [m];
    place [m] (3) without the press, direction [1] (3) and rotation [rad] (3) at the end. heading [rad]"""
    along, axis = np.array([np.cos(heading), np.sin(heading), 0.0]), np.array([-np.sin(heading), np.cos(heading), 0.0])
    path = [(-closing * share * UP, 0.0 * UP) for share in np.linspace(0.0, 1.0, 3 * rate // 10)]
    for angle in np.linspace(0.0, way / RADIUS, max(int(way / speed * rate), 2)):
        out = np.sin(angle) * along + np.cos(angle) * UP
        path.append(((FAR - closing) * out - FAR * UP, 2.0 * angle * axis))
    return path, FAR * out, out, 2.0 * angle * axis


def together(turn, first):
    return (Rotation.from_rotvec(turn) * Rotation.from_rotvec(first)).as_rotvec()
