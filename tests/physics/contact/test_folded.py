"""An organ that touches itself: its candidates and compliance, against two organs and full finite elements."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import Solver, box, neo_hooke
from palpate.models.fe.contact.pair import Pair
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.solve.body import ElasticBody, hats
from palpate.physics.bodies.between_bodies import condensed_between, folded_between, tangents_of
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_body import condensed_body
from palpate.physics.contact.organs import between
from palpate.physics.contact.organs.candidates import candidates
from palpate.physics.contact.organs.folded import folded_candidates
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.organs.gaps import MM, cut_block, slotted

YOUNG, POISSON = 1e4, 0.3


def merged(one, other):
    triangles = np.concatenate([one.triangles, other.triangles + len(one.vertices)])
    return Mesh(np.concatenate([one.vertices, other.vertices]), triangles)


def halves(gap, counts=(1500, 2500)):
    """The pieces of a block that is cut in two, of which the second is finer, and both as one surface."""
    pieces = []
    for sign, count in zip((-1.0, 1.0), counts, strict=True):
        cut = cut_block(gap, count)
        some = (sign * cut.vertices[cut.triangles][:, :, 1] > 0.0).all(axis=1)
        used, corners = np.unique(cut.triangles[some], return_inverse=True)
        pieces.append(Mesh(cut.vertices[used], corners.reshape(-1, 3).astype(np.int32)))
    return (*pieces, merged(*pieces))


@pytest.mark.parametrize("gap", [0.5 * MM, 1 * MM, 3 * MM])
def test_the_candidates_of_a_cut_cover_it_once_between_opposite_places(gap):
    one, _, both = halves(gap)
    found = folded_candidates(both, 0.0, 4 * MM, 100)
    assert 50 < len(found.gap) <= 100 and found.gap == approx(gap, rel=1e-9)
    assert found.area.sum() == approx(40e-3 * 24e-3, rel=1e-9)  # of the walls, without the faces next to their rims
    # the cells are those of the vertices of the finer piece, y > 0
    assert found.first.vertices.min() >= len(one.vertices) > found.second.vertices.max()
    assert found.normal == approx(np.tile((0.0, 1.0, 0.0), (len(found.gap), 1)), abs=1e-9)
    apart = found.first.place - found.second.place
    assert apart == approx(gap * found.normal, abs=2e-3 * MM)
    for shares in (found.first, found.second):
        assert np.bincount(shares.cells, shares.weights) == approx(1.0, rel=1e-12)


def test_inner_candidates_of_two_pieces_of_one_surface_are_those_of_two_surfaces():
    """Next to rims a vertex of two surfaces has the mean normal of both faces."""
    one, other, both = halves(1 * MM, (1500, 2500))
    two, found = candidates(one, other, 4 * MM, 400), folded_candidates(both, 0.0, 4 * MM, 400)
    assert two.swapped

    def inner(place):
        return (np.abs(place[:, 0]) < 17 * MM) & (np.abs(place[:, 2]) < 9 * MM)

    mine, theirs = inner(found.first.place), inner(two.second.place)
    assert mine.sum() == theirs.sum() > 100
    order, ordered = (np.lexsort(np.round(place[:, [0, 2]].T, 6)) for place in
                      (found.first.place[mine], two.second.place[theirs]))  # fmt: skip
    for a, b in ((found.first.place, two.second.place), (found.second.place, two.first.place)):
        assert a[mine][order] == approx(b[theirs][ordered], abs=3e-3 * MM)
    assert found.area[mine][order] == approx(two.area[theirs][ordered], rel=1e-9)
    assert found.gap[mine][order] == approx(two.gap[theirs][ordered], rel=1e-9)


def test_walls_out_of_reach_and_those_that_a_basis_couples_have_no_candidate():
    both = halves(2 * MM)[2]
    assert len(folded_candidates(both, 0.0, 2.1 * MM, 100).gap) > 50
    assert len(folded_candidates(both, 0.0, 1.9 * MM, 100).gap) == 0
    assert len(folded_candidates(both, 2.1 * MM, 4 * MM, 100).gap) == 0


def test_each_slot_of_a_comb_is_covered_once_and_no_cell_has_two_walls():
    """Five slots, 1.5 mm wide and 10 mm deep, between teeth of 2.5 mm, fewer than the cells are apart."""
    comb = slotted(1.5 * MM, tuple(y * MM for y in (-8.0, -4.0, 0.0, 4.0, 8.0)), 10 * MM, 6000)
    found = folded_candidates(comb, 0.0, 2 * MM, 40)
    assert found.spacing > 2.5 * MM
    assert found.gap == approx(1.5 * MM, rel=1e-9) and np.abs(found.normal[:, 1]) == approx(1.0)
    for shares in (found.first, found.second):
        y = comb.vertices[shares.vertices, 1]
        for cell in range(len(found.gap)):
            assert np.ptp(y[shares.cells == cell]) < 1e-9
    assert 0.85 < found.area.sum() / (5 * 40e-3 * 10e-3) <= 1.0 + 1e-9
    assert len(np.unique(np.round(found.first.place[:, 1] + found.second.place[:, 1], 6))) == 5


def linear_body(mesh, compliance, poisson):
    return condensed_body(
        Basis(mesh.vertices, mesh.triangles, compliance.astype(np.float32)), mesh, YOUNG, 0.02, 8e-3, 10e-3, poisson
    ).model  # fmt: skip


@pytest.mark.parametrize("poisson", [None, 0.3])
def test_two_pieces_of_one_body_have_the_compliance_of_two_bodies(poisson):
    """C_pp + C_qq: between separate pieces nothing is mutual. With the half-space of the surface, and along it."""
    one, other, both = halves(1 * MM, (400, 600))
    rng = np.random.default_rng(1)
    parts = []
    for piece in (one, other):
        some = rng.normal(size=(3 * len(piece.vertices), 40))
        parts.append((some @ some.T + np.eye(len(some))) * 1e-6 * YOUNG)
    size = len(parts[0])
    whole = np.zeros((size + len(parts[1]),) * 2)
    whole[:size, :size], whole[size:, size:] = parts
    found = folded_candidates(both, 0.0, 4 * MM, 30)
    found = found._replace(normal=-found.normal, first=found.second, second=found.first)  # the coarser piece is first
    tangents = tangents_of(found.normal)

    def of(mesh, compliance):
        model = linear_body(mesh, compliance, poisson)
        return lambda *given: condensed_between(model, *given)

    folded = folded_between(of(both, whole), found.first, found.second, found.normal, found.area, tangents)
    first = of(one, parts[0])(found.first, found.normal, found.area, tangents)
    beyond = found.second._replace(vertices=found.second.vertices - len(one.vertices))
    second = of(other, parts[1])(beyond, found.normal, found.area, tangents)
    least = 1e-6 if poisson is None else 1e-4  # the table of the half-space has single precision
    for name, sign in (("matrix", 1.0), ("drags", 1.0), ("response", -1.0), ("aside", -1.0)):
        mine, theirs = getattr(first, name), sign * getattr(second, name)
        wanted = mine + theirs if sign > 0.0 else np.concatenate([mine, theirs])
        assert getattr(folded, name) == approx(wanted, abs=least * np.abs(wanted).max()), name


def slotted_mesh(gap, cells=(4, 9, 10)):
    """A block of 20 x 20 x 15 mm, with a slot from its top, 9 mm deep, in the middle of y, `gap` [m] wide."""
    whole = box((0.02, 0.02, 0.015), cells)
    place = whole.points[whole.elements[:, :4]].mean(axis=1)
    width = 0.02 / cells[1]
    keep = ~((np.abs(place[:, 1] - 0.01) < 0.5 * width) & (place[:, 2] > 0.006))
    used, elements = np.unique(whole.elements[keep], return_inverse=True)
    points = whole.points[used].copy()
    out = points[:, 1] - 0.01  # the slot becomes `gap` wide
    half = 0.5 * width
    points[:, 1] = 0.01 + np.sign(out) * np.where(
        np.abs(out) <= half,
        np.abs(out) * gap / width,
        0.5 * gap + (np.abs(out) - half) * (0.01 - 0.5 * gap) / (0.01 - half),
    )
    return TetMesh(points, elements.reshape(-1, 10), np.zeros(int(keep.sum()), np.int64))


def test_lobes_of_one_piece_press_on_each_other_as_in_full_finite_elements():
    """A load on the outer side of a lobe closes the slot towards the other lobe, which is held: force on the walls, and
    the motion of the load, of finite elements with contact (`fe.Pair`), and of the condensed block with candidates.
    Without the compliance of one wall by forces on the other the force is wrong by more than 10 %."""
    gap, push = 0.005 * MM, 0.0003
    mesh, law = slotted_mesh(gap), {0: neo_hooke(YOUNG, POISSON)}
    held = (mesh.points[:, 2] < 1e-9) & (mesh.points[:, 1] > 0.0122)  # the lobe that is not pushed
    fixed = np.repeat(held[:, None], 3, axis=1)
    corners = np.unique(mesh.faces[:, :3])
    spread = hats(mesh, mesh.faces, corners)
    place = mesh.points[corners]
    on = (np.abs(place - (0.01, 0.0, 0.015)) < (5.1e-3, 1e-9, 5.1e-3)).all(axis=1)
    share = on / on.sum()
    load = np.outer(spread @ share, (0.0, push, 0.0))
    at = mesh.points[mesh.faces]
    walls = [(np.abs(at[:, :, 1] - 0.01 - sign * 0.5 * gap) < 1e-9).all(axis=1) for sign in (-1.0, 1.0)]
    touch = Pair(mesh.faces[walls[0]], mesh.faces[walls[1]])
    solver = Solver(mesh, law, fixed, loads=lambda given: given * load, contacts=[touch])
    solver.advance(1.0)
    moved = float(np.sum(solver.displacement * load)) / push

    surface = Mesh(place, np.searchsorted(corners, mesh.faces[:, :3]).astype(np.int32))
    body = ElasticBody(mesh, law)
    loose = ~held[corners]
    compliance = np.zeros((3 * len(corners),) * 2)
    some = np.repeat(loose, 3)
    compliance[np.ix_(some, some)] = body.compliance(fixed, spread[:, loose])
    model = linear_body(surface, YOUNG * compliance, None)
    found = folded_candidates(surface, 0.0, 3.0 * gap, 400)

    def pressed(of_pair):
        """Force between the walls [N], and motion of the load [m]."""
        forces = np.zeros((len(corners), 3))
        forces[:, 1] = push * share
        opened = forces.ravel() @ of_pair.response
        pair = between.pair(found.gap, of_pair.matrix, 0.0 * of_pair.matrix, (0.0, 0.0))
        assert between.step_pair(pair, np.stack([opened, 0.0 * opened]), 1e-3, 10_000) == 0
        work = forces.ravel() @ compliance @ forces.ravel() + pair.active.force @ opened
        return pair.active.force.sum(), work / push

    folded = folded_between(
        lambda *given: condensed_between(model, *given), found.first, found.second, found.normal, found.area
    )
    force, motion = pressed(folded)
    assert force == approx(abs(touch.force[1]), rel=0.03) and force > 0.2 * push
    assert motion == approx(moved, rel=0.015)
    sides = [condensed_between(model, shares, sign * found.normal, found.area).matrix
             for shares, sign in ((found.first, 1.0), (found.second, -1.0))]  # fmt: skip
    assert abs(pressed(folded._replace(matrix=sum(sides)))[0] / force - 1.0) > 0.1
