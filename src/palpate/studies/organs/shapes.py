"""Triangle meshes of closed surfaces: star-shaped bodies, bodies of revolution, tori and unions of boxes."""

import itertools
from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from palpate.physics.geometry.mesh import Mesh

GOLDEN = (1.0 + 5.0**0.5) / 2.0
CORNER = 0.35  # [rad] turn of an outline above which its point is a corner


def join_vertices(vertices: np.ndarray, triangles: np.ndarray, near: float = 1e-9) -> Mesh:
    """The mesh whose vertices [m] (V,3) nearer than `near` [m] are merged; triangles without area are left out."""
    _, first, same = np.unique(np.round(vertices / near), axis=0, return_index=True, return_inverse=True)
    triangles = same.reshape(-1)[triangles]
    a, b, c = triangles.T
    kept = triangles[(a != b) & (b != c) & (c != a)]
    return Mesh(vertices[first], kept.astype(np.int32))


def together(*meshes: Mesh) -> Mesh:
    """The union of separate meshes as one mesh."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles).astype(np.int32))


@lru_cache(maxsize=4)
def directions(count: int) -> Mesh:
    """The unit sphere: an icosahedron with each edge divided so that it has about `count` vertices."""
    parts = max(1, round(((count - 2) / 10.0) ** 0.5))
    corners = np.array([(0, a, b * GOLDEN) for a in (-1, 1) for b in (-1, 1)], dtype=float)
    corners = np.concatenate([corners, corners[:, [2, 0, 1]], corners[:, [1, 2, 0]]])
    edge = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    near = np.abs(edge - 2.0) < 1e-9
    faces = [
        (i, j, k) for i in range(12) for j in range(i + 1, 12) for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]  # fmt: skip
    # a lattice of points on each face
    rows = [(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]
    place = {pair: n for n, pair in enumerate(rows)}
    small = [(place[i, j], place[i + 1, j], place[i, j + 1]) for i, j in rows if i + j < parts]
    small += [(place[i + 1, j], place[i + 1, j + 1], place[i, j + 1]) for i, j in rows if i + j < parts - 1]
    weights = np.array([(parts - i - j, i, j) for i, j in rows]) / parts
    points, triangles = [], []
    for n, (i, j, k) in enumerate(faces):
        a, b, c = corners[i], corners[j], corners[k]
        if np.dot(np.cross(b - a, c - a), a) < 0.0:
            b, c = c, b
        points.append(weights @ np.array([a, b, c]))
        triangles.append(np.array(small) + n * len(rows))
    every = np.concatenate(points)
    return join_vertices(every / np.linalg.norm(every, axis=1)[:, None], np.concatenate(triangles), 1e-7)


def star(radius: Callable[[np.ndarray], np.ndarray], count: int) -> Mesh:
    """A body whose radius [m] is a function of the direction (n,3)."""
    unit = directions(count)
    return Mesh(unit.vertices * radius(unit.vertices)[:, None], unit.triangles)


def torus(ring: float, tube: float, count: int) -> Mesh:
    """A torus in the plane z = 0: radius of the ring and of the tube [m]."""
    around = max(8, round((count * ring / tube) ** 0.5))
    across = max(6, round(count / around))
    u, v = np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(across) * 2 * np.pi / across, indexing="ij")
    far = ring + tube * np.cos(v)
    points = np.stack([far * np.cos(u), far * np.sin(u), tube * np.sin(v)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    return Mesh(points, triangles.astype(np.int32))


def resample_outline(outline: np.ndarray, step: float) -> np.ndarray:
    """An outline (n,2), divided into parts of about `step` [m]; corners of more than `CORNER` are kept."""
    sides = np.diff(outline, axis=0)
    length = np.linalg.norm(sides, axis=1)
    unit = sides / length[:, None]
    corner = np.flatnonzero(np.einsum("ij,ij->i", unit[1:], unit[:-1]) < np.cos(CORNER)) + 1
    along, points = np.concatenate([[0.0], np.cumsum(length)]), [outline[:1]]
    for a, b in zip([0, *corner], [*corner, len(length)], strict=True):
        parts = max(1, int(np.ceil((along[b] - along[a]) / step - 1e-9)))
        at = along[a] + (along[b] - along[a]) * np.arange(1, parts + 1) / parts
        points.append(np.stack([np.interp(at, along, outline[:, k]) for k in range(2)], axis=1))
    return np.concatenate(points)


def revolve_outline(outline: np.ndarray, count: int) -> Mesh:
    """A body of revolution about z: its outline (r, z) [m] (n,2) runs from the top of the axis to its bottom."""
    lengths = np.linalg.norm(np.diff(outline, axis=0), axis=1)
    area = 2 * np.pi * np.sum(lengths * 0.5 * (outline[1:, 0] + outline[:-1, 0]))
    step = (area / count) ** 0.5
    line = resample_outline(outline, step)
    around = max(6, round(2 * np.pi * line[:, 0].max() / step))
    angle = np.arange(around) * 2 * np.pi / around
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.column_stack([r * ring, np.full(around, z)]) for r, z in line])
    i, j = np.meshgrid(np.arange(len(line) - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    c, d = a + around, b + around
    triangles = np.concatenate([np.stack([a, c, d], -1).reshape(-1, 3), np.stack([a, d, b], -1).reshape(-1, 3)])
    return join_vertices(points, triangles)


def arc(centre: tuple[float, float], radius: float, begin: float, end: float, parts: int = 64) -> np.ndarray:
    """Points (n,2) on an arc of an outline; angles [rad] from the r axis."""
    angle = np.linspace(begin, end, parts + 1)
    return np.array(centre) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def boxes(x: Sequence[float], y: Sequence[float], z: Sequence[float], full: np.ndarray, count: int) -> Mesh:
    """The surface of a union of cells of a grid with planes at x, y, z [m]; `full` (nx-1,ny-1,nz-1): which cells."""
    step = 1e-2
    mesh = _boxes(x, y, z, full, step)
    for _ in range(3):  # the number of vertices is proportional to 1/step²
        step *= (len(mesh.vertices) / count) ** 0.5
        mesh = _boxes(x, y, z, full, step)
    return mesh


def _divide_line(a: float, b: float, step: float) -> np.ndarray:
    return np.linspace(a, b, max(1, int(np.ceil((b - a) / step))) + 1)


def _boxes(x: Sequence[float], y: Sequence[float], z: Sequence[float], full: np.ndarray, step: float) -> Mesh:
    planes, cells = [], []
    for given in (x, y, z):
        line = np.unique(np.concatenate([_divide_line(a, b, step) for a, b in itertools.pairwise(given)]))
        planes.append(line)
        cells.append(np.searchsorted(np.array(given), 0.5 * (line[1:] + line[:-1])) - 1)
    solid = np.pad(full[np.ix_(*cells)], 1)
    corners, triangles, total = [], [], 0
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        step_in = np.diff(solid.astype(np.int8), axis=axis)
        trimmed = tuple(slice(None) if k == axis else slice(1, -1) for k in range(3))
        for sense in (1, -1):
            at = np.argwhere(step_in[trimmed] == -sense)
            quad = np.zeros((len(at), 4, 3))
            for n, (du, dv) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
                quad[:, n, axis] = planes[axis][at[:, axis]]
                quad[:, n, one] = planes[one][at[:, one] + du]
                quad[:, n, two] = planes[two][at[:, two] + dv]
            order = (0, 1, 2, 3) if sense == 1 else (0, 3, 2, 1)
            first = total + 4 * np.arange(len(at))[:, None]
            triangles += [first + [order[i] for i in part] for part in ((0, 1, 2), (0, 2, 3))]
            corners.append(quad.reshape(-1, 3))
            total += 4 * len(at)
    return join_vertices(np.concatenate(corners), np.concatenate(triangles))
