"""Spreading of the contact force over the surface nodes round the foot point.

    f_j = w_j f,    w_j = A_j k(d_j/R) / sum_l A_l k(d_l/R)

A_j [m²] nodal area, d_j [m] distance of node j to the foot point, R [m] radius of influence, k a kernel that goes to
zero at R, so that the weights change continuously while the foot point moves. The weights sum to one, so force is
conserved on any mesh. Nodes whose normal looks away from the contact's normal take no part: else the back of a thin
or folded piece would be pushed from behind.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from palpate.physics.entry_point import entry_point
from palpate.physics.geometry.grid import Grid, cell_range
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.kernel import kernel

Triple = tuple[float, float, float]
KERNELS = ("biweight", "wendland", "cosine")


@kernel(error_model="numpy")
def kernel_value(kind, q):
    """k(q), 1 at q = 0, 0 from q = 1 on: 0 biweight (1-q²)², 1 Wendland C² (1-q)⁴(4q+1), 2 raised cosine."""
    if q >= 1.0:
        return 0.0
    if kind == 0:
        x = 1.0 - q * q
        return x * x
    if kind == 1:
        x = (1.0 - q) * (1.0 - q)
        return x * x * (4.0 * q + 1.0)
    return 0.5 * (1.0 + math.cos(math.pi * q))


def kernel_values(name: str, q: ArrayLike) -> np.ndarray:
    """Kernel `name` of KERNELS at q = d/R >= 0 [1] (...)."""
    flat = np.asarray(q, float)
    kind = KERNELS.index(name)
    return np.array([kernel_value(kind, float(x)) for x in flat.ravel()]).reshape(flat.shape)


@kernel(error_model="numpy")
def spread_kernel(foot, normal, force, scalars, shape, first, order, near, nodes, weights, forces):
    """Spread `force` [N] over the nodes round `foot` [m]; returns how many, 0 where no node is in range.

    foot, normal, force  (3) each
    scalars              radius R [m], kind (index into KERNELS), then origin (3) and side [m] of the grid
    shape, first, order  of the `Grid`
    near     (V,7)       position, normal and area of each vertex, in the order of the grid
    nodes (V), weights (V), forces (V,3)  are filled as far as the returned count

    The work depends on the number of nodes near the foot, not on the mesh.
    """
    radius, kind, origin, side = scalars[0], int(scalars[1]), scalars[2:5], scalars[5]
    lo, hi = cell_range(foot, radius, origin, side, shape)
    count = 0
    total = 0.0
    reach = radius * radius
    for i in range(lo[0], hi[0] + 1):
        for j in range(lo[1], hi[1] + 1):
            row = (i * shape[1] + j) * shape[2]
            for at in range(first[row + lo[2]], first[row + hi[2] + 1]):
                x, y, z = near[at, 0] - foot[0], near[at, 1] - foot[1], near[at, 2] - foot[2]
                square = x * x + y * y + z * z
                if square >= reach or near[at, 3] * normal[0] + near[at, 4] * normal[1] + near[at, 5] * normal[2] <= 0:
                    continue
                weight = near[at, 6] * kernel_value(kind, math.sqrt(square) / radius)
                if weight > 0.0:
                    nodes[count] = order[at]
                    weights[count] = weight
                    total += weight
                    count += 1
    for at in range(count):
        weights[at] /= total
        for k in range(3):
            forces[at, k] = weights[at] * force[k]
    return count


class Spreader:
    """Spreads a force that acts at a foot point of a mesh.

    mesh    surface
    radius  [m] radius of influence R > 0
    kernel  one of KERNELS

    ValueError: an unknown kernel, a radius that is not positive.
    """

    def __init__(self, mesh: Mesh, radius: float, kernel: str = "biweight") -> None:
        if kernel not in KERNELS:
            raise ValueError(f"kernel {kernel!r}: unknown. Kernels: {', '.join(KERNELS)}.")
        if not 0.0 < radius < math.inf:
            raise ValueError(f"radius {radius} m: expected a positive number")
        self.grid = grid = Grid.of(mesh, radius)
        near = np.concatenate([mesh.vertices, mesh.normals, mesh.areas[:, None]], axis=1)[grid.order]
        size = max(len(near), 3)
        self.nodes, self.weights, self.forces = np.empty(size, np.int32), np.empty(size), np.empty((size, 3))
        scalars = np.array([radius, KERNELS.index(kernel), *grid.origin, grid.side])
        self._fixed = (scalars, grid.shape, grid.first, grid.order, near, self.nodes, self.weights, self.forces)
        self._kernel = entry_point(spread_kernel, *3 * ((0.0, 0.0, 0.0),), *self._fixed)

    def spread(self, foot: Triple, normal: Triple, force: Triple) -> int:
        """Fill `nodes`, `weights` [1] and `forces` [N] for a `force` at `foot` [m]; returns how many.

        normal: outward unit normal [1] (3) of the surface at the foot point

        With no node in range, the nodes of the nearest triangle share the force by the barycentric coordinates of its
        point nearest to the foot.
        """
        count = self._kernel(foot, normal, force, *self._fixed)
        if count:
            return count
        # From far away only the direction matters; held near the mesh, squares of distances stay finite.
        low, high = self.grid.points.min(axis=0), self.grid.points.max(axis=0)
        margin = 10 * (self.grid.longest + float(np.max(high - low)))
        triangle, shares = self.grid.nearest(np.clip(foot, low - margin, high + margin), normal)
        if triangle < 0:
            return 0
        self.nodes[:3] = self.grid.triangles[triangle]
        self.weights[:3] = shares / shares.sum()
        self.forces[:3] = self.weights[:3, None] * np.asarray(force)
        return 3
