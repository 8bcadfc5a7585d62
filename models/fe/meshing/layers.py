"""Hexahedral lattice of a layered finger: a bone, three shells round it and a nail.

The lattice is an inflated box: a core, and shells of bricks over all its faces except the rear and the plane of
symmetry.
"""

from dataclasses import dataclass

import numpy as np

from palpate.models.fe.element.mesh import grid

BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL, PLATE = range(6)

CORE = 0.45  # Half width of the lattice's core over the bone's radius


@dataclass(frozen=True)
class Lattice:
    """Bricks and their layers.

    points  [1] (N,4) coordinates in [-1, 1] of the point of the box that a ray passes: across, up, and from the rear
            (-1) through the centre of the rounded tip (0) to its front (1); the fourth increases from 0 at the core to
            1 at the bone's surface, and by 1 in each layer: 2 subcutis, 3 dermis, 4 epidermis, 5 nail
    """

    points: np.ndarray
    cells: np.ndarray  # (C,8)
    region: np.ndarray  # (C,)


def lattice(fine: int, radii: np.ndarray) -> Lattice:
    """The lattice of half a finger: across >= 0 of the plane of symmetry.

    fine   cells across an eighth of the circumference
    radii  [m] (4,) outer radii of bone, subcutis, dermis, epidermis; a layer thicker than the width of the faces is
           divided into several
    """
    # the core: a box
    n = fine
    x = np.linspace(0.0, 1.0, n + 1)
    y = np.linspace(-1.0, 1.0, 2 * max(2, n // 2) + 1)
    tip = np.linspace(0.0, 1.0, n + 1)
    back = np.cumsum(1.35 ** np.arange(max(3, n - 1)))
    z = np.concatenate([-back[::-1] / back[-1], tip])
    u, cells = grid(x, y, z)
    # its outer faces: front, lower, upper, side
    nx, ny, nz = len(x), len(y), len(z)
    corner = np.array([[0, 1, nx, nx + 1], [0, 1, nx * ny, nx * ny + 1], [0, nx, nx * ny, nx * ny + nx]])
    node = np.arange(len(u)).reshape(nz, ny, nx)
    quads = [
        node[-1, :-1, :-1].ravel()[:, None] + corner[0],
        node[:-1, 0, :-1].ravel()[:, None] + corner[1],
        node[:-1, -1, :-1].ravel()[:, None] + corner[1],
        node[:-1, :-1, -1].ravel()[:, None] + corner[2],
    ]
    upper = len(quads[0]) + len(quads[1]) + np.arange(len(quads[2]))
    skin = np.concatenate(quads)
    surface, on = np.unique(skin, return_inverse=True)
    on = on.reshape(skin.shape)
    # shells of bricks on these faces, layer by layer
    points = [np.column_stack([u, np.zeros(len(u))])]
    every, region = [cells], [np.full(len(cells), BONE)]
    below, total = skin, len(u)
    for layer, level in _levels(radii, n):
        points.append(np.column_stack([u[surface], np.full(len(surface), level)]))
        every.append(np.concatenate([below, total + on], axis=1))
        region.append(np.full(len(skin), layer))
        below = total + on
        total += len(surface)
    # the nail on the upper face
    nail, spot = np.unique(on[upper], return_inverse=True)
    points.append(np.column_stack([u[surface[nail]], np.full(len(nail), 5.0)]))
    every.append(np.concatenate([below[upper], total + spot.reshape(-1, 4)], axis=1))
    region.append(np.full(len(upper), NAIL))
    return Lattice(np.concatenate(points), np.concatenate(every), np.concatenate(region))


def _levels(radii: np.ndarray, fine: int) -> list[tuple[int, float]]:
    """Layer below each shell, and the shell's fourth coordinate, from the bone outwards."""
    width = np.pi / 4 * radii[-1] / fine
    levels = [(BONE, 1.0)]
    for layer, thickness in enumerate(np.diff(radii), start=SUBCUTIS):
        count = max(1, round(thickness / width))
        levels += [(layer, layer + k / count) for k in range(1, count + 1)]
    return levels


def directions(box: np.ndarray) -> np.ndarray:
    """Unit rays [1] (N,3) (across, up, forward) through points of the box (N,3), perpendicular to the axis behind the
    tip."""
    ray = np.column_stack([box[:, :2], np.maximum(box[:, 2], 0.0)])
    direction = np.tan(np.pi / 4 * ray)
    return direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
