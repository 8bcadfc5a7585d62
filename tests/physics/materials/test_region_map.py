"""The stiffness map of a region of any shape: a ball of voxels, parts that add up, finite elements by another route."""

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
from palpate.physics.materials.nodule import region_map, stiffness_map
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


def factor_of(made, places, ratio, size=1.5e-3):
    points, volume = made.points(size)
    return region_map(places, np.repeat(UP, len(places), axis=0), points, np.full(len(points), volume), ratio, 6e-3)


@pytest.mark.parametrize("ratio", [0.1, 5.0])
def test_the_voxels_of_a_ball_have_the_map_of_the_ball(ratio):
    """Within the error of its volume in voxels, and of points 1.5 mm apart; also in slices of twice the thickness."""
    places = np.column_stack([np.linspace(0.0, 60e-3, 40), np.zeros(40), np.full(40, 0.014)])
    exact = stiffness_map(places, np.repeat(UP, 40, axis=0), [0.0, 0.0, 0.0], 0.0085, ratio, 6e-3)
    assert np.abs(exact - 1.0).max() > 0.15
    for side in (1e-3, 0.5e-3):
        count = int(9.5e-3 / side) + 1
        ball = region(lambda points: np.linalg.norm(points, axis=-1) - 0.0085, (count, count, count), side)
        np.testing.assert_allclose(factor_of(ball, places, ratio), exact, rtol=0.02)
        turned = ball.affine * np.array([1.0, 1.0, 2.0, 1.0])  # every second slice, twice as thick
        turned[:, 3] += ball.affine[:, 2]
        slices = Region(ball.voxels[:, :, 1::2], turned)
        np.testing.assert_allclose(factor_of(slices, places, ratio), exact, rtol=0.03)


def test_the_points_of_a_region_have_its_volume_and_lie_in_it():
    made = region(vessel)
    for size in (0.3e-3, 0.5e-3, 2e-3):
        points, volume = made.points(size)
        assert len(points) * volume == approx(made.voxels.sum() * SIDE**3) and made.contains(points).all()
        assert len(points) == made.voxels.sum() * max(1, int(np.ceil(SIDE / size - 1e-9))) ** 3
    assert len(made.points(1e-9)[0]) == 64 * made.voxels.sum()  # a tiny reach does not fill the memory


def test_the_shares_of_parts_add_up():
    """k of two regions by the shares of each."""
    place = np.array([[0.0, 0.0, 0.0]])
    levels = [lambda points: points[..., 2] + 8.4e-3, lambda points: np.abs(points[..., 2] + 4e-3) - 1.4e-3]
    both = region(lambda points: np.minimum(levels[0](points), levels[1](points)))
    shares = [2.0 * (k - 1.0) / (1.5 + k) for k in (factor_of(region(level), place, 3.5)[0] for level in levels)]
    whole = factor_of(both, place, 3.5)[0]
    assert min(shares) > 0.03 and 2.0 * (whole - 1.0) / (1.5 + whole) == approx(sum(shares), rel=1e-9)


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
    assert rest.hardness().max() > 1.2


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
    """Over a vessel of 12 mm, 3 mm below the top of a ball of 42 mm, which is no half-space, within 30 % of coarse
    finite elements if it is stiff; a soft one is felt too weakly, by up to 45 %."""
    ratio, body, _, fe = stiffness
    springs = MassSpring(
        surface="sphere", vertices=400, position=(0.0, 0.0, 0.0), nodule_radius=0.006, nodule_ratio=ratio,
        nodule_shape=body.nodule_shape,
    )  # fmt: skip
    vertices = springs.mesh().vertices
    apart = np.linalg.norm(vertices[:, None] - vertices, axis=2)
    weight = np.clip(1.0 - (apart / springs.radius) ** 2, 0.0, None) ** 2
    factor = weight @ springs.hardness() / weight.sum(axis=1)  # under a finger
    over = (np.abs(vertices[:, 0]) < 5e-3) & (vertices[:, 2] > 0.018)
    sign = 1.0 if ratio > 1.0 else -1.0
    assert over.any() and (sign * (factor[over] - 1.0) > 0.2).all() and (sign * (fe[over] - 1.0) > 0.2).all()
    np.testing.assert_allclose(factor[over], fe[over], rtol=0.30 if ratio > 1.0 else 0.45)
    assert np.abs(fe[vertices[:, 2] < -0.015] - 1.0).max() < 0.01
