"""Flat sides of cut blocks stay flat, and tubes straight: booleans leave long edges, and thin and obtuse triangles."""

import numpy as np
import pytest
import trimesh

from palpate.nodes.base.surface import rotation_matrix
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.refined.contracted import contract_edges
from palpate.physics.geometry.refined.divided import refine_mesh
from palpate.physics.geometry.refined.edges import turns_of
from palpate.physics.geometry.refined.rims import find_rims

manifold3d = pytest.importorskip("manifold3d")  # its objects are not kept: it warns of them at the end
LONGEST, MOST = 1.6e-3, 400_000


def box(size, place=(0, 0, 0), turn=(0, 0, 0)):
    return manifold3d.Manifold.cube(list(size), True).rotate(list(turn)).translate(list(place))


CUTS = {
    "slit": [((30, 0.5, 40),)],
    "pocket": [((30, 1, 14), (0, 0, 12))],
    "cross": [((100, 0.2, 100),), ((0.2, 100, 100),)],
    "slanted": [((100, 0.3, 100), (0, 0, 0), (60, 0, 0))],
    "undercut": [((8, 100, 10), (0, 0, 9)), ((30, 100, 4), (0, 0, 2))],
}
"""Size, place [mm] and rotation [degrees] of the boxes that are cut out of a block."""


def cut(name):
    body = box((60, 64, 24)).refine_to_length(4.0)
    for tool in CUTS[name]:
        body = body - box(*tool)
    return mesh_of(body)


def mesh_of(body):
    found = body.to_mesh64()
    points = np.asarray(found.vert_properties)[:, :3].astype(np.float32) * 1e-3  # as in a file
    return Mesh(np.ascontiguousarray(points, float), np.ascontiguousarray(found.tri_verts, np.int32))


def off(mesh, fine):
    """Largest distance [m] of the vertices of a mesh from the surface of another."""
    return np.abs(MeshClosestPoint(mesh).find_sorted(fine.vertices)[3]).max()


@pytest.mark.parametrize("name", CUTS)
@pytest.mark.parametrize("turned", [False, True])
def test_the_sides_of_a_cut_stay_flat(name, turned):
    mesh = cut(name)
    if turned:
        mesh = Mesh(mesh.vertices @ rotation_matrix((0.7, -0.4, 1.1)).T, mesh.triangles)
    fine = refine_mesh(mesh, LONGEST, MOST)
    assert len(fine.vertices) > 10 * len(mesh.vertices)
    assert off(mesh, fine) < 1e-6 and off(fine, mesh) < 0.1e-3  # an edge of a gap of 0.2 mm may be contracted


def test_a_long_edge_between_two_flat_sides_is_a_rim():
    mesh = cut("slanted")
    along = mesh.vertices[find_rims(mesh)]
    length = np.linalg.norm(along[:, 0] - along[:, 1], axis=1)
    # at both sides of the cut one edge has an angle of 30 degrees, and is as long as the block
    assert (length > 0.0599).sum() >= 2


def test_a_short_edge_is_contracted_to_a_crease_and_there_to_its_corner():
    # on the edge x = 0 of a corner of a box: a vertex at the side, and one next to the corner of the box
    points = np.array([[0, 0, 0], [0, 20, 0], [20, 0, 0], [20, 20, 0], [0, 0, -20], [0, 20, -20], [0, 10, 0],
                       [0.1, 10, 0], [0, 0.1, 0]]) * 1e-3  # fmt: skip
    triangles = [(8, 2, 7), (8, 7, 6), (0, 2, 8), (7, 2, 3), (6, 7, 1), (7, 3, 1), (0, 8, 4), (8, 6, 4), (6, 1, 5),
                 (6, 5, 4)]  # fmt: skip
    mesh = Mesh(points, np.array(triangles, np.int32))
    creases = np.array([[0, 8], [6, 8], [1, 6], [0, 2], [0, 4], [1, 3], [1, 5]])
    turns = turns_of(points, creases)
    assert {0, 1} <= set(turns) and not {6, 8} & set(turns)
    found, number = contract_edges(mesh, 0.3e-3, turns, creases.ravel())
    assert number[7] == number[6] and number[8] == number[0] and len(found.vertices) == len(points) - 2
    assert (found.vertices[number[6]] == points[6]).all() and (found.vertices[number[0]] == points[0]).all()


TUBES = {
    "two tubes": [
        (1, 4.98, 60, (297.8, 336.0, 52.2), (-27.43, -23.03, -5.55)),
        (1, 4.0, 30, (48.9, 248.1, 303.0), (-24, -20, 4)),
    ],
    "slanted tube": [(1, 4.45, 60, (198.4, 48.3, 252.9), (-11.89, -4.84, -16.51))],
    "two holes": [
        (-1, 5.48, 120, (83.0, 241.4, 41.4), (24.21, 13.35, 7.45)),
        (-1, 5.64, 120, (150.1, 163.3, 168.5), (-0.36, 6.3, -13.86)),
    ],
}  # fmt: skip
"""Cylinders that are joined to an ellipsoid (1) or cut out: radius, length [mm], rotation [degrees], place [mm]."""


def organ(name, fine):
    """An ellipsoid with tubes, in a file, or as intended: with four times as many vertices along each edge."""
    found = trimesh.creation.icosphere(4 + 2 * fine, 1.0)
    points = np.asarray(found.vertices * np.array([45, 35, 20]), np.float32)
    body = manifold3d.Manifold(manifold3d.Mesh(points, np.asarray(found.faces, np.uint32)))
    for sign, radius, length, turn, place in TUBES[name]:
        tool = manifold3d.Manifold.cylinder(length, radius, -1, 24 + 72 * fine, True)
        tool = tool.rotate(list(turn)).translate(list(place))
        body = body + tool if sign > 0 else body - tool
    return mesh_of(body)


@pytest.mark.parametrize("name", TUBES)
def test_tubes_at_an_organ_stay_straight(name):
    """Their long strips were bent, and cut off, by up to 3.3 mm."""
    file, true = organ(name, False), organ(name, True)
    assert off(true, refine_mesh(file, LONGEST, MOST)) < max(2.0 * off(true, file), 0.3e-3)
