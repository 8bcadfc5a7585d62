"""The stiffness map of a region of any shape: the column of a ball, limits, finite elements by another route."""

import numpy as np
import pytest
from pytest import approx
from scipy.sparse import bsr_array
from scipy.sparse.linalg import splu

from palpate.models.build.basis import build_basis
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.reducible import of_organ
from palpate.models.fe.solve.body import ElasticBody
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.physics.materials.nodule import column_map, stiffness_map
from palpate.physics.segmentation.region import Region

UP = np.array([[0.0, 0.0, 1.0]])
SIDE = 1e-3  # [m] of the voxels


def region(level, half=(30, 30, 25), side=SIDE):
    """The voxels around the origin where `level` of their centres [m] is below 0."""
    half = np.array(half)
    points = side * (np.moveaxis(np.indices(2 * half + 1), 0, -1) - half)
    return Region(level(points) < 0.0, np.column_stack([side * np.eye(3), -side * half]))


def vessel(points):
    """A cylinder of radius 6 mm along y, 12 mm above the origin."""
    return np.hypot(points[..., 0], points[..., 2] - 0.012) - 0.006


def test_the_voxels_of_a_ball_have_the_column_of_the_ball():
    """The error is proportional to the side of a voxel; next to the ball the factor is exactly 1."""
    places = np.column_stack([np.linspace(0.0, 20e-3, 40), np.zeros(40), np.full(40, 0.012)])
    up = np.repeat(UP, 40, axis=0)
    exact = stiffness_map(places, up, [0.0, 0.0, 0.0], 0.0085, 5.0, 6e-3)
    middle, errors = places[:, 0] < 7e-3, []  # near the rim a column is in a voxel or not
    for side in (1e-3, 0.5e-3, 0.25e-3):
        count = int(9.5e-3 / side) + 1
        ball = region(lambda points: np.linalg.norm(points, axis=-1) - 0.0085, (count, count, count), side)
        found = column_map(places, up, ball.contains, 5.0, 6e-3, 0.5 * side)
        errors.append(np.sqrt(np.mean((found / exact - 1.0)[middle] ** 2)))
        assert (found[places[:, 0] > 9.5e-3] == 1.0).all()
    assert errors[0] < 0.05 and errors[2] < 0.35 * errors[0]


def test_layers_of_a_column_add_up_and_a_cavity_is_bounded():
    """Shares of 0 to 3 and 6 to 9 mm; both laws have the same first order."""
    two = region(lambda points: np.where((points[..., 2] < -8.4e-3) | (np.abs(points[..., 2] + 4e-3) < 1.4e-3), 1, -1))

    def factor(ratio):
        return float(column_map(np.zeros((1, 3)), UP, two.contains, ratio, 6e-3, 0.5e-3)[0])

    def held(z):
        return 1.0 / np.sqrt(1.0 + (z / 6e-3) ** 2)

    share = 1.0 - held(2.5e-3) + held(5.5e-3) - held(8.5e-3)
    assert factor(4.0) == approx(1.0 / (1.0 - 0.75 * share)) and factor(0.1) == approx(1.0 - 0.9 * share)
    assert factor(1.0) == 1.0 and factor(1e-9) == approx(1.0 - share)
    assert factor(1.001) - 1.0 == approx(1.0 - factor(0.999), rel=2e-3)


def test_a_region_is_read_as_it_was_written_and_a_wrong_file_is_one_line(tmp_path):
    made = region(vessel)
    made.save(tmp_path / "vessel.npz")
    body = MassSpring(surface="sphere", nodule_radius=0.006, nodule_shape=str(tmp_path / "vessel.npz"))
    assert (body.region().voxels == made.voxels).all() and (body.region().affine == made.affine).all()
    np.savez(tmp_path / "other.npz", bits=np.zeros(3, np.uint8), sides=np.array([9, 9, 9]), affine=np.eye(4)[:3])
    (tmp_path / "text.npz").write_text("no archive")
    for name, text in (("other.npz", "found 3 bytes of voxels"), ("text.npz", "text.npz"), ("no.npz", "No such file")):
        with pytest.raises(SettingError, match=f"setting 'nodule_shape': .*{text}"):
            MassSpring(surface="sphere", nodule_radius=0.006, nodule_shape=str(tmp_path / name)).hardness()


def test_the_region_moves_and_turns_with_its_organ(tmp_path):
    region(vessel).save(tmp_path / "vessel.npz")
    given = {"nodule_radius": 0.006, "nodule_ratio": 8.0, "nodule_shape": str(tmp_path / "vessel.npz"), "vertices": 800}
    rest = MassSpring(surface="sphere", position=(0.0, 0.0, 0.0), **given)
    moved = MassSpring(surface="sphere", position=(0.1, 0.2, 0.3), rotation=(0.4, -0.9, 0.2), **given)
    np.testing.assert_allclose(moved.hardness(), rest.hardness(), rtol=1e-9)
    assert rest.hardness().max() > 1.5 and (rest.hardness() == 1.0).any()


@pytest.fixture(scope="module", params=[0.1, 10.0])
def stiffness(request, tmp_path_factory):
    """The ratio, the body with a vessel, its basis, and the stiffness over that of the homogeneous organ (V)."""
    file = tmp_path_factory.mktemp("region") / "vessel.npz"
    region(vessel).save(file)
    given = {"surface": "sphere", "coarse": 150, "vertices": 400, "position": (0.0, 0.0, 0.0)}
    plain = ReducedFE(**given)
    body = ReducedFE(nodule_radius=0.006, nodule_ratio=request.param, nodule_shape=str(file), **given)
    fields = [
        node.stiffness_field(build_basis(node, lambda *_: lambda *_: None, False)[0])[0] for node in (plain, body)
    ]
    basis = build_basis(body, lambda *_: lambda *_: None, False)[0]
    return request.param, body, basis, fields[1] / fields[0]


def test_the_basis_has_the_compliance_of_the_whole_mesh_with_the_vessel(stiffness):
    """The full tangent, with materials by the formula of the cylinder, solved by another library."""
    ratio, body, basis, _ = stiffness
    organ = Organ(body.coarse_mesh(), body.poisson, body.bed)
    whole = of_organ(organ)
    corners = organ.mesh.points[organ.mesh.elements[:, :4]]
    organ.mesh.region[:] = vessel(SIDE * np.rint(corners.mean(axis=1) / SIDE)) < 0.0  # of the nearest voxel
    laws = {0: neo_hooke(1.0, body.poisson), 1: neo_hooke(ratio, body.poisson)}
    full = ElasticBody(organ.mesh, laws, whole.supports(1.0))
    count, top = len(organ.mesh.points), int(basis.vertices[:, 2].argmax())
    blocks = full.tangent(np.zeros((count, 3)))
    tangent = bsr_array((blocks, full.pattern.indices, full.pattern.indptr), shape=(3 * count, 3 * count)).tocsc()
    load = np.zeros((count, 3))
    load[:, 2] = whole.hats[:, top]
    moved = whole.hats.T @ splu(tangent).solve(load.ravel()).reshape(-1, 3)
    found = basis.compliance.reshape(len(moved), 3, len(moved), 3)[:, :, top, 2]
    np.testing.assert_allclose(found, moved, atol=1e-5 * np.abs(moved).max())


def test_both_bodies_are_stiffer_over_a_stiff_region_softer_over_a_cavity_and_equal_far_away(stiffness):
    """Within 35 % of coarse finite elements over the vessel, 3 mm below the top of a ball of 42 mm, no half-space."""
    ratio, body, _, fe = stiffness
    springs = MassSpring(
        surface="sphere", vertices=400, position=(0.0, 0.0, 0.0), nodule_radius=0.006, nodule_ratio=ratio,
        nodule_shape=body.nodule_shape,
    )  # fmt: skip
    factor, vertices = springs.hardness(), springs.mesh().vertices
    over = (np.abs(vertices[:, 0]) < 5e-3) & (vertices[:, 2] > 0.018)
    sign = 1.0 if ratio > 1.0 else -1.0
    assert over.any() and (sign * (factor[over] - 1.0) > 0.2).all() and (sign * (fe[over] - 1.0) > 0.2).all()
    np.testing.assert_allclose(factor[over], fe[over], rtol=0.35)
    assert np.abs(fe[vertices[:, 2] < -0.015] - 1.0).max() < 0.01
