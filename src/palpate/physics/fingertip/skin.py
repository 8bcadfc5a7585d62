"""The skin of the contact pad: a sheet of plane-stress triangles, meshed once at the largest depth.

Strain is constant in each triangle. Its stiffness with thickness t, area A and strain matrix B (3 x 6) is

    K_e = A t B^T [ lambda J_l + mu J_m ] B,   lambda = E nu / (1 - nu^2),   mu = E / (2 (1 + nu)),
    J_l = [[1,1,0],[1,1,0],[0,0,0]],   J_m = diag(2, 2, 1)

and its viscosity is the same with c for E (eq. 1 of the beam bundle paper). Triangles with a node out of contact exert
no force; the mesh does not change. Their weights grow with pressure, so the force is continuous when nodes make or lose
contact.
"""

from typing import NamedTuple

import numpy as np

from palpate.compiler.exact import einsum
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Points, Tensor, Triangles


class Sheet(NamedTuple):
    """A triangle mesh on the bundle's nodes with its stiffness blocks, and the sparse pattern of their sum."""

    triangles: np.ndarray  # [1] (E,3) node indices, counter-clockwise
    blocks: np.ndarray  # [N/m] (E,9,2,2) K_e by node pair, row by row
    slots: np.ndarray  # [1] (E,9) index of each block in the sparse matrix
    rows: np.ndarray  # [1] (N+1) start of each node's row
    columns: np.ndarray  # [1] (Z) node of each block of the row
    diagonal: np.ndarray  # [1] (N) slot of each node's diagonal block
    band: int  # [1] () largest |i - j| of coupled nodes


def grid_triangles(index: np.ndarray) -> np.ndarray:
    """Two triangles (E,3) in each cell of a square grid, without those that lack a corner.

    The diagonals alternate, so that no direction is preferred. Their direction depends only on the position, so the
    mesh of a subset of the nodes is a subset of the mesh.

    index  [1] (n,2)  integer grid coordinates of the nodes, each once; the first grows with x, the second with y
    """
    place = {(int(i), int(j)): k for k, (i, j) in enumerate(index)}
    cells = sorted({(i - p, j - q) for i, j in place for p in (0, 1) for q in (0, 1)})
    triangles = []
    for i, j in cells:
        a, b, c, d = (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)
        halves = ((a, b, c), (a, c, d)) if (i + j) % 2 == 0 else ((a, b, d), (b, c, d))
        triangles += [[place[k] for k in half] for half in halves if all(k in place for k in half)]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def plane_stress_blocks(
    points: Points, triangles: Triangles, modulus: float, poisson: float, thickness: float
) -> np.ndarray:
    """K_e of each triangle (E,9,2,2) [N/m].

    points [m] (N,2)   triangles [1] (E,3)   modulus [Pa]   poisson [1] in (-1, 1)   thickness [m]

    ValueError: a triangle without area.
    """
    corners = points[triangles]
    x, y = corners[..., 0], corners[..., 1]
    area = ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])) / 2
    if np.any(area <= 0):
        raise ValueError(f"triangle {int(np.argmin(area))}: area {area.min()} m², expected > 0 (counter-clockwise)")
    dx = (np.roll(y, -1, 1) - np.roll(y, -2, 1)) / (2 * area[:, None])
    dy = (np.roll(x, -2, 1) - np.roll(x, -1, 1)) / (2 * area[:, None])
    strain = np.zeros((len(triangles), 3, 6))
    strain[:, 0, 0::2], strain[:, 1, 1::2] = dx, dy
    strain[:, 2, 0::2], strain[:, 2, 1::2] = dy, dx
    first, second = modulus * poisson / (1 - poisson**2), modulus / (2 * (1 + poisson))
    law = first * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]]) + second * np.diag([2, 2, 1])
    whole = einsum("e,eai,ab,ebj->eij", area * thickness, strain, law, strain)
    return np.ascontiguousarray(whole.reshape(-1, 3, 2, 3, 2).transpose(0, 1, 3, 2, 4)).reshape(-1, 9, 2, 2)


def sheet(points: Points, triangles: Triangles, modulus: float, poisson: float, thickness: float) -> Sheet:
    """The sheet on given nodes; arguments as of `plane_stress_blocks`. Without triangles it exerts no force."""
    count = len(points)
    blocks = plane_stress_blocks(points, triangles, modulus, poisson, thickness)
    pairs = np.stack([np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))], axis=-1).reshape(-1, 2)
    diagonal = np.stack([np.arange(count)] * 2, axis=1)
    unique, inverse = np.unique(np.concatenate([diagonal, pairs]), axis=0, return_inverse=True)
    inverse, bands = inverse.ravel(), np.abs(unique[:, 0] - unique[:, 1])
    rows = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(np.bincount(unique[:, 0], minlength=count), out=rows[1:])
    return Sheet(
        triangles, blocks, inverse[count:].reshape(-1, 9), rows, np.ascontiguousarray(unique[:, 1]),
        inverse[:count].copy(), int(bands.max(initial=0)),
    )  # fmt: skip


@kernel
def assemble(matrix: Tensor, sheet: Sheet, weight: Array, scale: float):
    """Sum the blocks of a `Sheet`, each times its weight and `scale`, into `matrix` (Z,2,2), which is overwritten.

    weight  [1] (N)  of the nodes, 0 ... 1; a triangle has the smallest of its three, 0 if one is out of contact
    """
    triangles = sheet.triangles
    matrix[:] = 0.0
    for e in range(triangles.shape[0]):
        w = scale * min(weight[triangles[e, 0]], weight[triangles[e, 1]], weight[triangles[e, 2]])
        if w > 0.0:
            for k in range(9):
                s = sheet.slots[e, k]
                for a in range(2):
                    for b in range(2):
                        matrix[s, a, b] += w * sheet.blocks[e, k, a, b]
