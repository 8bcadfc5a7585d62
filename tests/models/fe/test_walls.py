"""Near walls of an organ: which they are, and that they carry pressure without friction."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import Solver, box, neo_hooke
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.contact.walls import Walls
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.walls import bodies, facing, near_walls
from palpate.models.fe.solve.body import ElasticBody
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.geometry.mesh import Mesh

GAP, YOUNG = 4e-4, 1e4
SIDE, HEIGHT = 0.02, 0.01


def stacked(gap=GAP, counts=((2, 2, 2), (3, 3, 2))):
    """Two blocks with meshes that do not match, the second above the first across a gap, and their closed surface."""
    below, above = (box((SIDE, SIDE, HEIGHT), count) for count in counts)
    points = np.concatenate([below.points, above.points + (0.0, 0.0, HEIGHT + gap)])
    elements = np.concatenate([below.elements, above.elements + len(below.points)])
    mesh = TetMesh(points, elements, np.zeros(len(elements), np.int64))
    return mesh, Mesh(points, np.ascontiguousarray(mesh.faces[:, :3], np.int32))


def pairs_of(mesh, surface, stiffness):
    pairs = facing(mesh, near_walls(surface, 1e-3, np.inf), 1e-3, 1e-6)
    return pairs, Walls(pairs.nodes, pairs.values, pairs.normals, stiffness * pairs.area)


def test_pairs_cover_both_walls_once_and_know_their_gap():
    mesh, surface = stacked()
    pairs, _ = pairs_of(mesh, surface, 1.0)
    assert pairs.area.sum() == approx(SIDE**2)  # also at the rims
    assert np.abs(pairs.normals[:, 2]) == approx(1.0)
    assert pairs.gap.max() == approx(GAP)
    at = np.einsum("pa,pai->pi", pairs.values, mesh.points[pairs.nodes])
    assert np.abs(at[:, 2]) == approx(GAP)
    assert at[:, :2] == approx(0.0, abs=1e-9)  # opposite points


@pytest.mark.parametrize("gap", [1e-6, 1e-5, 1e-4])
def test_walls_are_near_however_small_their_gap_is(gap):
    """Facets may be 20 um above a tangent plane, and so may another wall."""
    near = near_walls(stacked(gap)[1], 1e-3, np.inf)
    assert near is not None and near.walls.sum() >= 2 * 2 * 2


def test_two_blocks_in_series_are_as_soft_as_both_and_the_layer():
    """Uniaxial stress by hand: 2 H / E + 1 / k, with lateral expansion free."""
    mesh, surface = stacked()
    k = 5e6
    _, walls = pairs_of(mesh, surface, k)
    z = mesh.points[:, 2]
    fixed = np.zeros(mesh.points.shape, bool)
    fixed[z < 1e-9, 2] = True
    fixed[:, 0], fixed[:, 1] = mesh.points[:, 0] < 1e-9, mesh.points[:, 1] < 1e-9
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > z.max() - 1e-9).all(axis=1)]
    push = np.zeros(mesh.points.shape)
    push[:, 2] = -nodal_areas(mesh, top)
    pressure = 1.0  # [Pa] small
    solver = Solver(
        mesh, {0: neo_hooke(YOUNG, 0.3)}, fixed, loads=lambda load: load * pressure * push, contacts=[walls]
    )
    solver.advance(1.0)
    sunk = -solver.displacement[z > z.max() - 1e-9, 2]
    by_hand = pressure * (2.0 * HEIGHT / YOUNG + 1.0 / k)
    assert sunk.mean() == approx(by_hand, rel=2e-3)
    assert sunk == approx(by_hand, rel=5e-3)  # meshes that do not match press on each other unevenly


def nodal_areas(mesh, faces):
    """Integral of each shape function over faces [m²] (N,): unit pressure as nodal loads."""
    bed = ElasticFoundation(faces, 1.0)
    force, body = np.zeros_like(mesh.points), ElasticBody(mesh, {0: neo_hooke(YOUNG, 0.3)})
    bed.bind(mesh.points, body.pattern, np.zeros(0))
    bed.add(np.ones_like(mesh.points), 0.0, False, force, np.zeros((0, 3, 3)))
    return force[:, 2]


def test_a_cut_under_the_finger_is_as_stiff_as_no_cut_and_an_open_one_is_not():
    """A load in the plane of the cut: the plane bears no shear by symmetry, so walls that touch change nothing."""
    size, count = (0.06, 0.03, 0.024), (8, 4, 4)
    side = box(size, count)
    for gap, bounds in ((1e-5, (0.98, 1.0)), (1e-3, (0.93, 1.0)), (None, (0.65, 0.8))):
        points = np.concatenate([side.points - (0.0, size[1] + 0.5 * (gap or 0.0), 0.0),
                                 side.points + (0.0, 0.5 * (gap or 0.0), 0.0)])  # fmt: skip
        elements = np.concatenate([side.elements, side.elements + len(side.points)])
        cut = TetMesh(points, elements, np.zeros(len(elements), np.int64))
        beds = []
        if gap:
            surface = Mesh(points, np.ascontiguousarray(cut.faces[:, :3], np.int32))
            pairs = facing(cut, near_walls(surface, 2e-3, np.inf), 2e-3, 1e-6)
            beds = [Walls(pairs.nodes, pairs.values, pairs.normals, 3.8 * YOUNG * pairs.area / pairs.gap)]
        whole = box((size[0], 2.0 * size[1], size[2]), (8, 8, 4))
        whole = TetMesh(whole.points - (0.0, size[1], 0.0), whole.elements, whole.region)
        low, high = bounds
        assert low < stiffness(cut, beds) / stiffness(whole, []) <= high + 1e-6


def stiffness(mesh, beds):
    """Of a block on a fixed ground under a patch of 8 mm round (30, 0) mm on its top [N/m]."""
    body = ElasticBody(mesh, {0: neo_hooke(YOUNG, 0.45)}, beds)
    z, up = mesh.points[:, 2], mesh.points[:, 2].max()
    fixed = np.repeat((z < 1e-9)[:, None], 3, axis=1)
    top = mesh.faces[(mesh.points[mesh.faces][:, :, 2] > up - 1e-9).all(axis=1)]
    at = np.einsum("qa,fai->fqi", face_rule.VALUES, mesh.points[top])
    share = np.maximum(1.0 - ((at[..., 0] - 0.03) ** 2 + at[..., 1] ** 2) / 8e-3**2, 0.0) ** 2
    share *= face_rule.areas(mesh.points, top)
    load = np.zeros_like(mesh.points)
    np.add.at(load[:, 2], top, -np.einsum("fq,qa->fa", share / share.sum(), face_rule.VALUES))
    return 1.0 / float(load.ravel() @ body.rest(fixed).solve(load.ravel()))


def test_walls_slide_freely_and_forces_belong_to_the_tangent():
    mesh, surface = stacked()
    pairs, walls = pairs_of(mesh, surface, 3e6)
    body = ElasticBody(mesh, {0: neo_hooke(YOUNG, 0.3)}, [walls])
    upper = mesh.points[:, 2] > HEIGHT + 0.5 * GAP
    slid = np.where(upper[:, None], (1e-4, -2e-4, 0.0), 0.0)
    assert np.abs(body.forces(slid)).max() < 1e-12
    apart = np.where(upper[:, None], (0.0, 0.0, 1e-5), 0.0)
    force = body.forces(apart)
    assert force[upper].sum(axis=0) == approx((0.0, 0.0, 3e6 * SIDE**2 * 1e-5))
    assert force.sum(axis=0) == approx(0.0, abs=1e-12)
    u = 1e-5 * np.random.default_rng(1).standard_normal(mesh.points.shape)
    stiff = body.pattern.matrix(body.tangent(np.zeros_like(u)))
    alone = ElasticBody(mesh, {0: neo_hooke(YOUNG, 0.3)})
    given = alone.pattern.matrix(alone.tangent(np.zeros_like(u)))
    pull = np.zeros_like(u)
    walls.add(u, 0.0, False, pull, np.zeros((0, 3, 3)))
    assert (stiff @ u.ravel() - given @ u.ravel()).reshape(-1, 3) == approx(pull, abs=1e-9 * np.abs(pull).max())
    other = ElasticBody(mesh, {0: neo_hooke(YOUNG, 0.3)}, [Walls(pairs.nodes, pairs.values, pairs.normals, pairs.area)])
    assert len({body.digest(), alone.digest(), other.digest()}) == 3


@pytest.mark.parametrize("turn", [0.0, 0.7])
@pytest.mark.parametrize("gap", [5e-5, 2e-4, 9e-4])
def test_walls_of_a_cut_are_found_at_any_angle(gap, turn):
    _, surface = stacked(gap)
    c, s = np.cos(turn), np.sin(turn)
    turned = Mesh(surface.vertices @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]]), surface.triangles)
    near = near_walls(turned, 1e-3, 0.004)
    across = 0.5 * np.linalg.norm(near.surface.face_vectors[near.walls], axis=1).sum()
    assert across == approx(2.0 * SIDE**2)
    assert near.gap[near.walls] == approx(gap)
    assert not near.gap[~near.walls].any()


def test_surfaces_without_near_walls_have_none():
    """Convex ones, walls that are farther apart, and the two sides of an inner corner."""
    assert near_walls(surface_mesh("sphere", 300), 1e-3, np.inf) is None
    assert near_walls(surface_mesh("kidney", 600), 1e-3, np.inf) is None
    assert near_walls(stacked(1.1e-3)[1], 1e-3, np.inf) is None
    assert near_walls(corner(), 1e-3, 1e-3) is None


def corner():
    """The surface of an L, with an inner corner of a right angle."""
    outline = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], float) * 0.01
    bottom, top = (np.column_stack([outline, np.full(6, z)]) for z in (0.0, 0.01))
    caps = np.array([(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)])
    sides = [t for i in range(6) for j in [(i + 1) % 6] for t in ((i, j, 6 + j), (i, 6 + j, 6 + i))]
    triangles = np.concatenate([caps[:, ::-1], caps + 6, np.array(sides)]).astype(np.int32)
    return Mesh(np.concatenate([bottom, top]), triangles)


def test_bodies_are_outer_pieces_with_their_cavities():
    _, surface = stacked()
    cavity = surface_mesh("sphere", 50)
    inside = Mesh(0.1 * cavity.vertices + (0.01, 0.01, 0.005), cavity.triangles[:, ::-1])
    both = Mesh(
        np.concatenate([surface.vertices, inside.vertices]),
        np.concatenate([surface.triangles, inside.triangles + len(surface.vertices)]),
    )
    lower, upper = sorted(bodies(both), key=lambda body: body.vertices[:, 2].mean())
    assert len(lower.triangles) - len(cavity.triangles) + len(upper.triangles) == len(surface.triangles)
    assert lower.vertices[:, 2].max() == approx(HEIGHT)
    assert bodies(surface_mesh("kidney", 200))[0] is surface_mesh("kidney", 200)
    _, crossed = stacked(-0.2 * HEIGHT)
    assert len(bodies(crossed)) == 1


def test_stiffness_must_be_positive():
    mesh, surface = stacked()
    with pytest.raises(ValueError, match="expected positive numbers"):
        pairs_of(mesh, surface, 0.0)
