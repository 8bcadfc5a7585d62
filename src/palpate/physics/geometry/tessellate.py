"""Nearly uniform closed triangle meshes of a NURBS surface that is closed in u with a pole at both ends of v."""

import numpy as np

from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.nurbs import NurbsPatch

TABLE = 256  # Samples of the arc length in each direction


def tessellate(surface: NurbsPatch, count: int) -> Mesh:
    """A watertight mesh of about `count` vertices, all on the surface, without slivers at the poles.

    Rings of vertices run round the surface from pole to pole with 5, 10, 15, ... vertices, then constant numbers, then
    ..., 15, 10, 5; neighbouring rings are staggered. This is an icosahedron stretched along its axis: twelve vertices,
    including the poles, have five neighbours, all others six. Rings are spaced by arc length along each meridian,
    vertices by arc length along each ring.

    ValueError: fewer than 12 vertices, or a surface without poles.
    """
    if count < 12:
        raise ValueError(f"vertices: found {count}, expected at least 12")
    if not (surface.packed[1].pole_low and surface.packed[1].pole_high):
        raise ValueError("tessellate: expected a surface closed in u with a pole at both ends of v")
    u0, u1, v0, v1 = surface.domain
    u = np.linspace(u0, u1, TABLE + 1)
    v = np.linspace(v0, v1, 2 * TABLE + 1)
    walk = _length(surface(u[:, None], v), axis=1)
    levels = np.linspace(0.0, 1.0, TABLE + 1)
    v_at = np.array([np.interp(levels, row / row[-1], v) for row in walk])  # (u, level)
    rings = surface(u[:, None], v_at)
    turn = _length(rings, axis=0)
    share = np.linspace(0.0, 1.0, TABLE + 1)
    u_at = np.empty_like(v_at)
    for k in range(TABLE + 1):
        total = turn[-1, k]
        u_at[:, k] = np.interp(share, turn[:, k] / total, u) if total > 0 else u
    u_at[:, 0], u_at[:, -1] = u_at[:, 1], u_at[:, -2]
    slimness = walk[:, -1].mean() / turn[-1].max()
    numbers = _ring_sizes(count, slimness)
    ring = np.repeat(np.arange(len(numbers)), numbers)
    start = np.concatenate([[0], np.cumsum(numbers)])
    middle = _stagger(numbers)
    level = ring / (len(numbers) - 1)
    along = (np.arange(start[-1]) - start[ring] + middle[ring]) / numbers[ring] % 1.0
    found_u = _bilinear(u_at, along, level)
    found_v = _bilinear(v_at, (found_u - u0) / (u1 - u0), level)
    bands = [_band(numbers[k], numbers[k + 1], start[k], start[k + 1], middle[k + 1]) for k in range(len(numbers) - 1)]
    return Mesh(surface(found_u, found_v), np.concatenate(bands).astype(np.int32))


def _length(points: np.ndarray, axis: int) -> np.ndarray:
    step = np.linalg.norm(np.diff(points, axis=axis), axis=-1)
    return np.insert(np.cumsum(step, axis=axis), 0, 0.0, axis=axis)


def _ring_sizes(count: int, slimness: float) -> np.ndarray:
    """Vertices of each ring, poles included, for about `count` in all.

    With r rows between the poles and at most 5 m vertices in a ring, edges along and across have the same length for
    r = 2/sqrt(3) 5 m slimness; the number of vertices is 2 + 5 m (r - m).
    """
    ratio = max(10.0 / np.sqrt(3.0) * slimness, 2.0)
    m = max(1, round(np.sqrt((count - 2) / (5.0 * (ratio - 1.0)))))
    rows = max(2 * m + 1, round((count - 2) / (5.0 * m) + m))
    k = np.arange(rows + 1)
    numbers = 5 * np.minimum(np.minimum(k, rows - k), m)
    numbers[[0, -1]] = 1
    return numbers


def _stagger(numbers: np.ndarray) -> np.ndarray:
    """Shift of each ring, in spacings of its vertices: successive long rings are staggered by half a spacing, and the
    last cap is aligned with the last of them."""
    equal = np.concatenate([[False], numbers[1:] == numbers[:-1]])
    return np.where(np.cumsum(equal) % 2 == 1, 0.5, 0.0) * numbers / numbers.max()


def _bilinear(table: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x, y = x * TABLE, y * TABLE
    i = np.minimum(x.astype(int), TABLE - 1)
    j = np.minimum(y.astype(int), TABLE - 1)
    x, y = x - i, y - j
    below = table[i, j] * (1 - x) + table[i + 1, j] * x
    above = table[i, j + 1] * (1 - x) + table[i + 1, j + 1] * x
    return below * (1 - y) + above * y


def _band(lower: int, upper: int, at: int, above: int, shift: float) -> np.ndarray:
    """Triangles between a ring of `lower` vertices from index `at` and one of `upper` vertices from index `above`."""
    if lower == 1:
        i = np.arange(upper)
        return np.stack([np.full(upper, at), above + (i + 1) % upper, above + i], axis=1)
    if lower == upper:
        i = np.arange(lower)
        j = (i + 1) % lower
        ahead = shift > 0  # the upper ring is shifted by half a spacing forwards, else backwards
        one = np.stack([at + i, at + j, above + (i if ahead else j)], axis=1)
        two = np.stack([above + i, at + (j if ahead else i), above + j], axis=1)
        return np.concatenate([one, two])
    if lower > upper:
        turned = _band(upper, lower, above, at, shift)
        return turned[:, ::-1]
    n = lower // 5
    sector, i = np.divmod(np.arange(lower), n)
    far = sector * (n + 1) + i
    one = np.stack([at + np.arange(lower), above + (far + 1) % upper, above + far], axis=1)
    two = np.stack([at + np.arange(lower), at + (np.arange(lower) + 1) % lower, above + (far + 1) % upper], axis=1)
    tip = np.arange(5)
    three = np.stack(
        [at + ((tip + 1) * n) % lower, above + ((tip + 1) * (n + 1)) % upper, above + tip * (n + 1) + n], 1
    )
    return np.concatenate([one, two, three])
