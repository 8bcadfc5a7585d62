"""Solids that touch along edges, as voxels and closing gaps do."""

import numpy as np
import pytest
import trimesh
import trimesh.graph
from scipy.ndimage import label

from palpate.models.build.parted import APART, part_solids
from palpate.models.build.repair import repair_mesh
from palpate.nodes.base.mesh_file import flaws
from palpate.nodes.base.surface import rotation_matrix
from palpate.physics.geometry.crossing import crossing
from palpate.physics.geometry.topology import edge_counts

CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def faces_of(solid):
    """Vertices and triangles of the faces between the voxels of a solid and those that are not of it; all vertices at
    the same place are one."""
    quads, filled = [], np.pad(solid, 1)
    for axis in range(3):
        for sense in (1, -1):
            at = np.argwhere(filled & ~np.roll(filled, -sense, axis))
            others = [(axis + 1) % 3, (axis + 2) % 3]
            each = np.repeat(at[:, None], 4, axis=1)
            each[:, :, axis] += sense > 0
            each[:, :, others] += np.array(CORNERS if sense > 0 else CORNERS[::-1])
            quads.append(each)
    found, number = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    return found.astype(float), np.concatenate([number[:, [0, 1, 2]], number[:, [0, 2, 3]]]).astype(np.int32)


def volume(vertices, triangles):
    return np.linalg.det(vertices[triangles]).sum() / 6.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("inside_out", [False, True])
def test_random_voxels_become_solids_of_the_same_volume(seed, inside_out):
    rng = np.random.default_rng(seed)
    solid = rng.random((6, 7, 5)) < rng.uniform(0.2, 0.7)
    vertices, triangles = faces_of(solid)
    vertices = vertices @ rotation_matrix(tuple(rng.normal(size=3))).T
    if inside_out:
        triangles = triangles[:, ::-1]
    assert edge_counts(triangles, len(vertices))[1] > 3
    apart, parted = part_solids(vertices, triangles)
    assert edge_counts(parted, len(apart)) == (0, 0)
    size = np.ptp(vertices, axis=0).max()
    assert volume(apart, parted) == pytest.approx(solid.sum(), rel=1e-2)
    assert (apart[: len(vertices)] == vertices).all() and len(np.unique(apart, axis=0)) == len(apart)
    middles = apart[len(vertices) :]  # half an edge, of length 1, from two corners
    away = np.sort(np.linalg.norm(middles[:, None] - vertices, axis=2), axis=1)
    assert np.abs(away[:, :2] - 0.5).max() < 1.001 * APART * size
    assert crossing(apart, parted) is None
    # voxels that share a face are one solid, and its holes are surfaces of it
    surfaces = len(trimesh.graph.connected_components(trimesh.Trimesh(apart, parted, process=False).face_adjacency))
    holes = label(~np.pad(solid, 1), np.ones((3, 3, 3)))[1] - 1
    assert surfaces == label(solid)[1] + holes


def test_a_body_that_touches_itself_stays_one():
    solid = np.zeros((3, 3, 1), bool)
    solid[[0, 0, 1, 2, 2, 0], [0, 1, 2, 2, 1, 2], 0] = True
    solid[1, 0] = True  # touches (2, 1) along an edge
    vertices, triangles = faces_of(solid)
    assert edge_counts(triangles, len(vertices))[1] == 1
    apart, parted = part_solids(vertices, triangles)
    assert edge_counts(parted, len(apart)) == (0, 0) and crossing(apart, parted) is None


def test_flaps_bound_no_solid():
    vertices, triangles = faces_of(np.ones((1, 1, 1), bool))
    a, b = triangles[0][:2]
    apex = np.array([[3.0, 3, 3], [4.0, 2, 3]])
    for flaps in ([[a, b, 8]], [[a, b, 8], [a, b, 9]], [[b, a, 8], [b, a, 9]]):
        whole = np.concatenate([triangles, np.array(flaps, np.int32)])
        assert part_solids(np.concatenate([vertices, apex[: len(flaps)]]), whole) is None


def test_the_file_of_a_gap_that_closes_is_repaired(tmp_path):
    """Two blocks that touch along an edge, and are 3 mm apart at the other end."""
    low = trimesh.convex.convex_hull([[x, y, z] for x, y in ((0, 0), (60, 0), (60, 30), (0, 32)) for z in (0, 24)])
    high = trimesh.convex.convex_hull([[x, y, z] for x, y in ((0, 32), (60, 34), (60, 64), (0, 64)) for z in (0, 24)])
    file = tmp_path / "wedge.stl"
    trimesh.util.concatenate([low, high]).export(file)
    fixed, done = repair_mesh(file, "mm")
    assert done == ["solids that touch along an edge parted"]
    assert [line for line in flaws(str(fixed)) if "separate pieces" not in line] == []
    assert 1e9 * trimesh.load(fixed).volume == pytest.approx(low.volume + high.volume, rel=1e-3)
