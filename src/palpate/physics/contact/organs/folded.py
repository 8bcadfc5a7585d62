"""The candidates of the contact of an organ with itself: where walls of one surface face each other, as those of a cut,
of a fissure between two lobes, or of a fold.

A vertex p and the place q opposite it (`geometry.felt.opposite`) are a pair of points, with the gap n.(p - q), n the
normal at q. Each pair is met twice, from both walls: the walls of a fissure face to different sides of the plane across
the principal axis of their normals, and the vertices of the finer wall are kept. They are gathered into cells like
those between two organs (`candidates`), without cells that reach from one wall to another.
"""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import einsum
from palpate.physics.contact.organs.candidates import Candidates, Near, cells
from palpate.physics.geometry.felt.opposite import opposite, unit
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

INSIDE = 1e-3  # [1] of the distance of a vertex from the middle of its triangles, by which its place is moved
AXIS_STEPS = 50  # of the power iteration for the principal axis


def folded_candidates(mesh: Mesh, least: float, reach: float, most: int) -> Candidates:
    """At most `most` cells where walls of a surface face each other with a gap from `least` to `reach` [m]."""
    near = _near_itself(mesh, least, reach)
    near, walls = _one_wall(mesh, near)
    return cells(mesh, mesh, near, most, walls)


def _near_itself(mesh: Mesh, least: float, reach: float) -> Near:
    """The vertices of both walls: of triangles whose middle faces another wall, with a third of their areas. A vertex
    on a rim has the normal and area of the wall alone."""
    closest, triangles = MeshClosestPoint(mesh), mesh.triangles
    faces = unit(mesh.face_vectors)
    middle = mesh.vertices[triangles].mean(axis=1)
    wall = _gaps(mesh, closest, middle, faces, least, reach)[0]
    area = 0.5 * np.sqrt(np.sum(np.square(mesh.face_vectors[wall]), axis=1))
    used, corner = np.unique(triangles[wall], return_inverse=True)
    corner = corner.ravel()

    def summed(of_faces: np.ndarray) -> np.ndarray:
        """Of a vertex, over its triangles on walls."""
        return np.bincount(corner, np.repeat(of_faces, 3), minlength=len(used))

    areas = summed(area / 3.0)
    normals = unit(np.stack([summed(area * faces[wall, i]) for i in range(3)], axis=1))
    inward = np.stack([summed(area * middle[wall, i]) for i in range(3)], axis=1) / (3.0 * areas)[:, None]
    # next to a rim, so that the foot is on the wall
    points = mesh.vertices[used] + INSIDE * (inward - mesh.vertices[used])
    seen, feet, across, gaps = _gaps(mesh, closest, points, normals, least, reach)
    deepest = float(gaps.min()) if len(gaps) else np.inf
    return Near(used[seen], areas[seen], feet, faces[across], across, gaps, deepest)


def _gaps(
    mesh: Mesh, closest: MeshClosestPoint, points: np.ndarray, normals: np.ndarray, least: float, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The points of a surface that face another wall with a gap from `least` to `reach` [m]: indices, places opposite
    them [m] (n,3), their triangles, and gaps [m] (n)."""
    radius = 0.5 * reach
    # a point that the largest ball can touch faces nothing
    hidden = np.flatnonzero(~closest.beyond(points + radius * normals, radius * (1.0 - 1e-3)))
    feet, across, _ = opposite(closest, mesh, points[hidden], normals[hidden], radius)
    faces = across >= 0
    seen, feet, across = hidden[faces], feet[faces], across[faces]
    gaps = einsum("ni,ni->n", points[seen] - feet, unit(mesh.face_vectors[across]))
    keep = (gaps >= least) & (gaps > 0.0) & (gaps < reach)
    return seen[keep], feet[keep], across[keep], gaps[keep]


def _one_wall(mesh: Mesh, near: Near) -> tuple[Near, np.ndarray]:
    """The vertices of the finer wall of each fissure, and a number of the wall of each of them."""
    size, count = len(mesh.vertices), len(near.vertices)
    across = mesh.triangles[near.triangles]
    facing = np.zeros(size, bool)
    facing[near.vertices] = True
    along = mesh.triangles[facing[mesh.triangles].all(axis=1)]
    edges = _edges(along)
    links = np.concatenate([edges, np.stack([np.repeat(near.vertices, 3), across.ravel()], axis=1)])
    fissure = _connected(links, size)[near.vertices]
    kept = np.zeros(count, bool)
    for one in np.unique(fissure):
        members = np.flatnonzero(fissure == one)
        area = near.areas[members]
        side = einsum("ni,i->n", near.normals[members], _axis(near.normals[members], area)) > 0.0
        finer = side.any() and (side.all() or area[side].mean() <= area[~side].mean())
        kept[members[side == finer]] = True
    facing[:] = False
    facing[near.vertices[kept]] = True
    walls = _connected(_edges(mesh.triangles[facing[mesh.triangles].all(axis=1)]), size)
    wall = walls[near.vertices[kept]]
    return Near._make([*(each[kept] for each in near[:-1]), near.deepest]), wall


def _edges(triangles: np.ndarray) -> np.ndarray:
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def _connected(links: np.ndarray, size: int) -> np.ndarray:
    """Number of the connected part of each of `size` vertices, the index of its first one."""
    graph = scipy.sparse.coo_array((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(size, size))
    _, label = scipy.sparse.csgraph.connected_components(graph.tocsr(), directed=False)
    return np.unique(label, return_index=True)[1][label]


def _axis(normals: np.ndarray, area: np.ndarray) -> np.ndarray:
    """The principal axis [1] (3) of normals [1] (n,3) with these weights, whose largest component is positive."""
    spread = np.sum((area[:, None] * normals)[:, :, None] * normals[:, None, :], axis=0)
    axis = normals[0]
    for _ in range(AXIS_STEPS):
        axis = unit(einsum("ij,j->i", spread, axis))
    return axis if axis[np.argmax(np.abs(axis))] > 0.0 else -axis
