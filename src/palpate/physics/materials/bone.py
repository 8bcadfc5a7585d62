"""Bone near the surface of soft tissue, as a map of stiffness over the surface.

Rigid bone takes the strain out of the tissue where it lies, and out of what it shields from the load. With the density
of the strain energy of a load on an incompressible half-space (`physics.materials.nodule`), W as a share of the whole,

    w = ∫ dΩ ∫_d^∞ W(rho, Ω) rho² drho

is the share behind the bone, d(Ω) the distance to it from the loaded point in each direction into the tissue. On a
layer of the thickness h, bonded to a rigid base, d = h/cos(theta), and the stiffness is known exactly (D. M.
Burmister, J. Appl. Phys. 16, 1945, 89): with the Hankel transform p(k) of the pressure and x = k h

    k = ∫ p² dk / ∫ p² L dk,   L(x) = (sinh 2x - 2x)/(cosh 2x + 1 + 2x²)

Both are functions of h/R, R the radius of the patch, from which

    k = (1 - w)^(-4/3)

within 4 % for h/R from 0.25 to 10 (tests/physics/materials/test_bone.py). The law is taken for bone of any shape: it is
the stiffness over the layer that leaves the same energy. The range ends at `MOST`, the layer of R/4.

Neglected: that tissue is compressible (with Poisson's ratio 0.45 a layer of the thickness R has 10 % less), what lies
between organ and bone, and the curvature of the surface.
"""

import numpy as np

from palpate.compiler.exact import exp, log, solve
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix, Points, Tensor
from palpate.physics.bodies.true_patch import sideways
from palpate.physics.kept import keep_results
from palpate.physics.materials.nodule import FAR, WIDTH, energy_density
from palpate.physics.segmentation.region import Region
from palpate.physics.special import gauss_legendre

MOST = 20.0
"""[1] Largest factor."""
LEVELS, AROUND, ALONG = 10, 24, 10
"""Rays from a vertex: cosines of the angle with its normal, and directions around it; points along a ray."""


@keep_results
def bone_map(vertices: Points, normals: Points, bone: Region, reach: float) -> np.ndarray:
    """Factor k [1] (V) on the stiffness of each surface vertex by rigid bone in its tissue; 1 where it is farther than
    8 times the reach.

    vertices [m] (V,3), normals [1] (V,3) outward   undeformed surface
    bone             its voxels; the sides of a voxel at right angles
    reach [m] > 0    R, radius over which a fingertip spreads its load

    The last results are kept, since all lanes of an ensemble have the same map: do not write to it.
    """
    sides = np.linalg.norm(bone.affine[:, :3], axis=0)
    away = _distances(np.pad(bone.voxels, 1), sides)
    to_index = np.ascontiguousarray(solve(bone.affine[:, :3], np.eye(3)))
    begin = bone.affine[:, 3] - bone.affine[:, :3].sum(axis=1)  # of the voxels with their margin
    cosines, weights = (0.5 * each for each in gauss_legendre(LEVELS))
    along, parts = (0.5 * each for each in gauss_legendre(ALONG))
    shares = np.zeros(len(vertices))
    _shield(
        np.ascontiguousarray(vertices, float), np.ascontiguousarray(normals, float), away, to_index, begin, sides,
        np.column_stack([cosines + 0.5, weights]), np.column_stack([along + 0.5, parts]), reach, shares,
    )  # fmt: skip
    return np.minimum(exp(-4.0 / 3.0 * log(np.maximum(1.0 - shares, 1e-9))), MOST)


def _distances(voxels: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """Distance [m] (i,j,k), float32, of the middle of each voxel to that of the nearest true one."""
    from scipy.ndimage import distance_transform_edt

    found = distance_transform_edt(~voxels, sampling=sides, return_distances=False, return_indices=True)
    square = np.zeros(voxels.shape)
    for axis, side in enumerate(sides):
        line = np.arange(voxels.shape[axis]).reshape([-1 if k == axis else 1 for k in range(3)])
        square += np.square(side * (found[axis] - line))
    return np.sqrt(square).astype(np.float32)


@kernel
def _behind(distance: float, cosine: float, reach: float, rule: Matrix):
    """∫ W rho² drho [1] from a distance [m] to infinity, along a ray with this cosine of its angle to the normal."""
    width, total = WIDTH * reach, 0.0
    for k in range(len(rule)):
        left = 1.0 - rule[k, 0]
        rho = distance + width * rule[k, 0] / left
        square = rho * rho
        density = energy_density(square * (1.0 - cosine * cosine), rho * cosine, width)
        total += rule[k, 1] * density * square * width / (left * left)
    return total


@kernel
def _nearest_voxel(index: float, count: int, side: float):
    """The voxel of an axis at an index, and the square of the distance [m²] to it from outside."""
    inside = min(max(int(np.floor(index + 0.5)), 0), count - 1)
    out = max(abs(index - inside) - 0.5, 0.0) * side
    return inside, out * out


@kernel
def _to_bone(at: Array, along: Array, away: Tensor, to_index: Matrix, begin: Array, sides: Array, far: float):
    """Distance [m] from a point along a direction to the bone; `far` if it is not met before. A step is at most as long
    as the distance of the voxel there to the bone, so that none passes through it."""
    slack = np.sqrt(sides[0] * sides[0] + sides[1] * sides[1] + sides[2] * sides[2])
    least, rho = 0.25 * min(sides[0], sides[1], sides[2]), 0.0
    while rho < far:
        x, y = at[0] + rho * along[0] - begin[0], at[1] + rho * along[1] - begin[1]
        z = at[2] + rho * along[2] - begin[2]
        i, a = _nearest_voxel(to_index[0, 0] * x + to_index[0, 1] * y + to_index[0, 2] * z, away.shape[0], sides[0])
        j, b = _nearest_voxel(to_index[1, 0] * x + to_index[1, 1] * y + to_index[1, 2] * z, away.shape[1], sides[1])
        k, c = _nearest_voxel(to_index[2, 0] * x + to_index[2, 1] * y + to_index[2, 2] * z, away.shape[2], sides[2])
        known, out = float(away[i, j, k]), np.sqrt(a + b + c)
        if known == 0.0 and out == 0.0:
            return max(rho - 0.5 * least, 0.0)
        rho += max(max(known, out) - slack, least)
    return far


@ieee_kernel
def _shield(
    places: Matrix, facing: Matrix, away: Tensor, to_index: Matrix, begin: Array, sides: Array, levels: Matrix,
    rule: Matrix, reach: float, shares: Array,
):  # fmt: skip
    """Fill the shares w (V)."""
    axes, along, far = np.zeros((2, 3)), np.zeros(3), FAR * reach
    for v in range(len(places)):
        normal = (facing[v, 0], facing[v, 1], facing[v, 2])
        sideways(normal, axes)
        for i in range(len(levels)):
            cosine = levels[i, 0]
            sine = np.sqrt(1.0 - cosine * cosine)
            for j in range(AROUND):
                turn = 2.0 * np.pi * (j + 0.5) / AROUND
                one, other = sine * np.cos(turn), sine * np.sin(turn)
                for x in range(3):
                    along[x] = one * axes[0, x] + other * axes[1, x] - cosine * normal[x]
                distance = _to_bone(places[v], along, away, to_index, begin, sides, far)
                if distance < far:
                    part = 2.0 * np.pi / AROUND * levels[i, 1]
                    shares[v] += part * _behind(max(distance, 1e-6), cosine, reach, rule)
