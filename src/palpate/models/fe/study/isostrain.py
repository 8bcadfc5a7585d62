"""Equivalent strain in a deformed finger, and the volumes above levels of it.

The strain varies within an element, as the displacement is quadratic. For volumes each element is divided into `CUTS`³
tetrahedra with linear strain between their corners (`physics.contact.tactile.isostrain_volume`). The error decreases
quadratically with the number of cuts.
"""

import itertools

import numpy as np

from palpate.models.fe.element.elements import gradients, shape
from palpate.models.fe.element.jacobian import CORNERS
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.fingertip import BONE, EPIDERMIS, NAIL
from palpate.physics.contact.tactile import equivalent_strain, isostrain_volume

CUTS = 4  # Number of divisions of each edge of an element for volumes
CHUNK = 2048  # Number of elements that are processed together


def strain(mesh: TetMesh, displacement: np.ndarray, chunk: slice = slice(None), at: np.ndarray = CORNERS) -> np.ndarray:
    """Equivalent strain [1] (E,n) of a chunk of elements at natural coordinates (n,3), by default the corners, not
    averaged, for displacements [m] (N,3). Effective Poisson's ratio: that of the material in the elastic layers, 0.5 in
    the others."""
    slope, _ = gradients(mesh.points, mesh.elements[chunk], at)
    F = np.eye(3) + np.einsum("eai,enaj->enij", displacement[mesh.elements[chunk]], slope, optimize=True)
    poisson = np.where(np.isin(mesh.region[chunk], (BONE, EPIDERMIS, NAIL)), 0.3, 0.5)
    return equivalent_strain(F, poisson[:, None])


def volumes_above(mesh: TetMesh, displacement: np.ndarray, levels: np.ndarray, cuts: int = CUTS) -> np.ndarray:
    """Deformed volume [m³] (L,) in which the equivalent strain is at least a level (L,), at displacements [m] (N,3)."""
    at, pieces = subdivide_element(cuts)
    value, _ = shape(at)
    moved, volumes = mesh.points + displacement, np.zeros(len(levels))
    for start in range(0, len(mesh.elements), CHUNK):
        chunk = slice(start, start + CHUNK)
        values = strain(mesh, displacement, chunk, at)
        place = np.einsum("na,eai->eni", value, moved[mesh.elements[chunk]])
        corner = place[:, pieces].reshape(-1, 4, 3)
        volume = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 6.0
        volumes += isostrain_volume(values[:, pieces].reshape(-1, 4), volume, levels)
    return volumes


def subdivide_element(cuts: int) -> tuple[np.ndarray, np.ndarray]:
    """A tetrahedron divided into cuts³: natural coordinates of the points (P,3), and the tetrahedra (T,4).

    The tetrahedron n >= x >= y >= z >= 0 of a cube is filled by tetrahedra of its unit cubes, six in each (Kuhn).
    """
    steps = range(cuts + 1)
    points = [(x, y, z) for x in steps for y in range(x + 1) for z in range(y + 1)]
    number = {point: k for k, point in enumerate(points)}
    tetrahedra = []
    for first in points:
        for order in itertools.permutations(range(3)):
            corner, walk = list(first), [first]
            for axis in order:
                corner[axis] += 1
                walk.append((corner[0], corner[1], corner[2]))
            if all(place in number for place in walk):
                tetrahedra.append([number[place] for place in walk])
    x, y, z = np.array(points).T / cuts
    return np.stack([x - y, y - z, z], axis=1), np.array(tetrahedra)
