"""Random simple polygons, prisms over them, and mesh files that are written here, independently of what reads them."""

import struct

import numpy as np
from scipy.spatial.transform import Rotation

L_SHAPE = np.array([(0, 0), (60, 0), (60, 20), (20, 20), (20, 60), (0, 60)], float)  # mm, arms of 20 mm


def star(rng) -> np.ndarray:
    """Corners in the order of their angle about the origin, with no gap of half a turn: never crosses itself."""
    count = rng.integers(5, 25)
    angle = 2.0 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    return rng.uniform(8.0, 40.0, count)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def spiral(rng) -> np.ndarray:
    end = rng.uniform(1.0, 5.0) * np.pi
    turn = np.linspace(0.0, end, int(end / rng.uniform(0.2, 0.5)) + 2)  # its chords keep off the next turn
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.concatenate([(12.0 + 3.0 * turn)[:, None] * ring, ((8.0 + 3.0 * turn)[:, None] * ring)[::-1]])


def comb(rng) -> np.ndarray:
    teeth, root = int(rng.integers(1, 6)), rng.uniform(2.0, 15.0)
    corners = [(0.0, 0.0), (10.0 * teeth, 0.0)]
    for k in range(teeth, 0, -1):
        corners += [(10.0 * k, 20.0), (10.0 * k - 5.0, 20.0), (10.0 * k - 5.0, root), (10.0 * k - 10.0, root)]
    return np.array(corners)


def l_shape(rng) -> np.ndarray:
    return L_SHAPE * rng.uniform(0.5, 1.5, 2)


SHAPES = {"star": star, "spiral": spiral, "comb": comb, "L": l_shape}


def polygon(rng, shape: str) -> np.ndarray:
    """A simple polygon (n,2), counter-clockwise, from any start corner, some with corners on their sides."""
    corners = SHAPES[shape](rng)
    parts = int(rng.integers(1, 4))
    along = np.roll(corners, -1, axis=0) - corners
    corners = (corners[:, None] + along[:, None] * (np.arange(parts) / parts)[:, None]).reshape(-1, 2)
    return np.roll(corners, rng.integers(len(corners)), axis=0)


def area_of(corners: np.ndarray) -> float:
    """Of a simple polygon, by the shoelace formula."""
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def is_inside(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points (m,2) are in a polygon: a ray to the right crosses its sides an odd number of times."""
    a, b = corners, np.roll(corners, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = x < a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])
    return np.asarray((spans & right).sum(axis=1) % 2 == 1)


def prism(corners: np.ndarray, height: float) -> tuple[np.ndarray, list[list[int]]]:
    """Vertices (2n,3) and faces of a prism from z = 0 to its height: two polygons and n quads, outwards."""
    n = len(corners)
    points = np.concatenate([np.column_stack([corners, np.full(n, z)]) for z in (0.0, height)])
    faces = [list(range(n))[::-1], list(range(n, 2 * n))]
    return points, faces + [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]


def any_plane(rng, points: np.ndarray, uneven: float = 0.0) -> tuple[np.ndarray, Rotation, np.ndarray]:
    """The points turned and moved at random, each moved out of its plane by up to `uneven`; the rotation; the shift."""
    turn, shift = Rotation.random(random_state=int(rng.integers(1 << 30))), rng.uniform(-300.0, 300.0, 3)
    return turn.apply(points) + shift + rng.uniform(-uneven, uneven, points.shape), turn, shift


def as_obj(points: np.ndarray, faces: list[list[int]], corner: str = "{0}") -> bytes:
    """An OBJ file; `corner` is the form of a corner, with the number of its vertex from 1."""
    lines = ["v {!r} {!r} {!r}".format(*map(float, point)) for point in points]
    lines += ["f " + " ".join(corner.format(k + 1) for k in face) for face in faces]
    return "\n".join(lines).encode() + b"\n"


def as_ply(points: np.ndarray, faces: list[list[int]], form: str = "ascii") -> bytes:
    head = (
        f"ply\nformat {form} 1.0\ncomment made by a test\nelement vertex {len(points)}\nproperty double x\n"
        f"property double y\nproperty double z\nelement face {len(faces)}\n"
        "property list ushort int vertex_indices\nend_header\n"
    ).encode()
    if form == "ascii":
        rows = [" ".join(repr(float(x)) for x in point) for point in points]
        rows += [" ".join(map(str, [len(face), *face])) for face in faces]
        return head + "\n".join(rows).encode() + b"\n"
    order = "<" if "little" in form else ">"
    body = b"".join(struct.pack(f"{order}3d", *point) for point in points)
    return head + body + b"".join(struct.pack(f"{order}H{len(face)}i", len(face), *face) for face in faces)
