"""A condensed organ under several contacts (physics.bodies.condensed_contacts)."""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from pressing import CondensedBody, Spreader
from pytest import approx
from scipy.integrate import quad
from scipy.special import j0, jv

from palpate.compiler.entry_point import NO_FLOATS
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.element.mesh import bricks, grid, quadratic
from palpate.models.fe.meshing.organ import SLAB
from palpate.models.fe.solve.solver import Solver
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.large_displacement import nonlinearity
from palpate.physics.bodies.loads.pairs import _mean_inverse, joint_profile
from palpate.physics.bodies.true_patch import MEAN
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.peers import continuum
from palpate.studies.peers.continuum import BED, POISSON, RADIUS, SIDE, STEPS, YOUNG, TissueBlock, grade_axis

UP = (0.0, 0.0, 1.0)


@lru_cache
def slab(model="nonlinear", retardation=0.0):
    node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=10000)
    rho = nonlinearity(POISSON) if model == "nonlinear" else NO_FLOATS
    return CondensedBody(node.basis(), node.mesh(), YOUNG, retardation, RADIUS, 1.0, POISSON, rho=rho)


def load(body, place, force, normal=UP):
    spreader, foot = Spreader(body.mesh, RADIUS), (*place, 0.0)[:3] if len(place) < 3 else tuple(place)
    count = spreader.spread(foot, normal, tuple(-force * n for n in normal))
    if force == 0.0:
        count = 0
    return spreader.nodes[:count].copy(), spreader.forces[:count].copy(), foot, normal


def pressed(body, places, forces, steps=2, dt=1.0):
    """The contacts after some steps, and their indentations [m]."""
    many = body.under(len(places))
    loads = [load(body, place, force) for place, force in zip(places, forces, strict=True)]
    for _ in range(steps):
        laws = many.steps(loads, dt)
    return many, np.array([law[2] for law in laws])


@pytest.mark.parametrize("rho", [0.0, 0.3, 1.0, 1.9, 2.6, 4.4, 7.0])
def test_the_compliance_between_two_patches_of_a_half_space_is_their_hankel_integral(rho):
    found = _mean_inverse(joint_profile(), rho)[0]
    total = 0.0
    for a, b in pairwise(np.arange(0.0, 60.5, 0.5)):
        total += quad(lambda x: (48.0 * jv(3, x) / x**3) ** 2 * j0(x * rho) if x > 0.0 else 1.0, a, b)[0]
    assert found == approx(total, rel=1e-3)


def test_patches_at_the_same_position_have_the_compliance_of_one_patch():
    assert joint_profile()[0] == approx(MEAN, rel=1e-4)


@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_contacts_act_separately_far_apart_and_as_one_at_the_same_position(model):
    body = slab(model)
    _, (left, right) = pressed(body, [(-0.03, 0.0), (0.03, 0.0)], [0.6, 0.6])
    for place, both in ((-0.03, left), (0.03, right)):
        _, (alone,) = pressed(body, [(place, 0.0)], [0.6])
        assert both == approx(alone, rel=0.01)
    _, shared = pressed(body, [(0.0, 0.0), (0.0, 0.0)], [0.2, 0.4])
    _, (one,) = pressed(body, [(0.0, 0.0)], [0.6])
    assert shared == approx(one, rel=2e-3)


@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_a_contact_without_force_changes_nothing(model):
    """A patch that sticks held the organ against the force of another one, even without a force: on a ball on its
    foundation, by 25 %."""
    _, (alone,) = pressed(slab(model), [(-0.006, 0.0)], [0.6])
    for place in ((-0.02, 0.0), (-0.006, 0.003), (0.006, 0.002)):
        _, (shared, _) = pressed(slab(model), [(-0.006, 0.0), place], [0.6, 0.0])
        assert shared == approx(alone, rel=1e-12)


def test_the_coupling_is_reciprocal_up_to_rounding():
    """Betti: 1 N at A indents B as much as 1 N at B indents A, for the linear organ and patches that differ in position
    and load."""
    body, places = slab("linear"), [(-0.021, 0.004), (-0.009, 0.0)]
    many, (_, there) = pressed(body, places, [0.3, 0.0])
    _, (here, _) = pressed(body, places, [0.0, 0.3])
    assert many.own.cross[0, 1] == many.own.cross[1, 0]
    assert there == approx(here, rel=1e-12)  # each is evaluated from a different side
    assert np.linalg.eigvalsh(many.own.cross + np.diag(many.own.contacts["self_compliance"])).min() > 0.0


@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_the_law_of_each_contact_predicts_its_indentation_under_all_forces(model):
    """At the present forces the law is exact for the next step; for the linear body also at other forces."""
    body = slab(model, 0.02)
    many = body.under(2)
    places, forces = [(-0.006, 0.0), (0.006, 0.002)], np.array([0.5, 0.3])
    for _ in range(5):
        laws = many.steps([load(body, p, f) for p, f in zip(places, forces, strict=True)], 1e-3)
    following = forces if model == "nonlinear" else np.array([0.2, 0.6])
    acting = many.own.coupling @ following
    printed = [free + c * a for (c, free, _), a in zip(laws, acting, strict=True)]
    then = many.steps([load(body, p, f) for p, f in zip(places, following, strict=True)], 1e-3)
    assert [law[2] for law in then] == approx(printed, rel=2e-3 if model == "nonlinear" else 2e-5)


def test_a_linear_body_stores_half_the_work_and_cycles_generate_no_energy():
    body = slab("linear", 0.02)
    many, rng = body.under(3), np.random.default_rng(5)
    places, work, before = [(-0.008, 0.0), (0.004, 0.006), (0.012, -0.004)], 0.0, np.zeros(3)
    for _ in range(60):
        forces = rng.uniform(0.0, 1.0, 3) * (rng.uniform(size=3) > 0.2)
        now = np.array(
            [law[2] for law in many.steps([load(body, p, f) for p, f in zip(places, forces, strict=True)], 5e-3)]
        )
        work += forces @ (now - before)
        before = now
        assert work >= many.stored() - 1e-9
    _, depths = (held := pressed(body, places, [0.4, 0.5, 0.2], steps=40))
    assert held[0].stored() == approx(0.5 * np.dot([0.4, 0.5, 0.2], depths), rel=5e-3)


@pytest.mark.parametrize("force", [0.05, 0.4])
def test_an_organ_whose_load_a_finger_pushes_back_stores_half_the_work_of_both(force):
    """Another organ pulls the surface up next to a finger that presses it down: the energy of its load is negative, or
    would be zero where the finger wins, and then that of the finger alone."""
    many = slab("linear").under(2)
    many.own.contacts[1].organ = True
    loads = [load(slab("linear"), (0.0, 0.0), 1.0), load(slab("linear"), (0.010, 0.0), force, (0.0, 0.0, -1.0))]
    for _ in range(3):
        depths = [law[2] for law in many.steps(loads, 1e3)]
    assert (depths[1] < 0.0) == (force == 0.05)
    assert many.stored() == approx(0.5 * np.dot([1.0, force], depths), rel=1e-6)


def test_the_slope_is_the_gradient_of_the_indentation_by_other_contacts():
    body, step = slab("linear"), 2e-4
    many = body.under(2)
    for _ in range(3):
        many.steps([load(body, (0.010, 0.001), 0.0), load(body, (-0.004, 0.0), 0.8)], 1e3)

    def indented(x, y, force=0.0):
        return many.steps([load(body, (x, y), force), load(body, (-0.004, 0.0), 0.8)], 1e3)[0][2]

    expected = [
        (indented(0.010 + step, 0.001) - indented(0.010 - step, 0.001)) / (2 * step),
        (indented(0.010, 0.001 + step) - indented(0.010, 0.001 - step)) / (2 * step),
    ]
    indented(0.010, 0.001, 1e-9)
    found = many.own.drawn[0] / 1e-9
    assert found[:2] == approx(expected, rel=0.12, abs=0.02 * abs(expected[0]))
    assert found[0] < 0.0 and abs(found[2]) < 1e-12  # it is pulled into the indentation of the other


@lru_cache
def curved(surface):
    """A linear organ without viscosity, and the search for its nearest points."""
    node = ReducedFE(surface=surface, position=(0.0, 0.0, 0.0), model="linear", retardation=0.0)
    return CondensedBody.of(node), MeshClosestPoint(node.mesh())


BALL = [  # the finger, and the other one, which presses
    ((0.0, -0.002, 0.021), (0.020, 0.0, -0.005)), ((-0.008, 0.003, 0.019), (0.020, 0.0, -0.005)),
    ((0.002, 0.0, 0.021), (0.012, 0.002, 0.016)),
]  # fmt: skip
KIDNEY = [((0.0, 0.015, 0.015), (0.0, -0.01, 0.02)), ((0.043, 0.001, 0.015), (-0.04, 0.0, 0.01))]


@pytest.mark.parametrize(
    ("surface", "at", "other"), [("sphere", *pair) for pair in BALL] + [("kidney", *pair) for pair in KIDNEY]
)
def test_on_curved_ground_the_slope_is_that_of_the_work_on_both(surface, at, other):
    """The other finger pushes a ball aside on its foundation, by 7 mm/N. While the turn of the normal, and of the force
    that holds a patch, was left out, the slope was up to three times as large, and pointed the other way."""
    (body, closest), step = curved(surface), 5e-4
    many = body.under(2)

    def foot(point):
        found, normal, *_ = closest.find(np.array([point]))
        return found[0], normal[0]

    there, facing = foot(other)
    pushes = load(body, there, 1.0, tuple(facing))

    def joined(point):
        place, normal = foot(point)
        for _ in range(2):
            many.steps([load(body, place, 1e-2, tuple(normal)), pushes], 1e3)
        return many.own.cross[0, 1], place

    here, n = foot(at)
    tangents = np.linalg.svd(n[None])[2][1:]
    expected = []
    for way in tangents:
        (ahead, to), (back, start) = joined(here + step * way), joined(here - step * way)
        expected.append((ahead - back) / np.linalg.norm(to - start))
    joined(here)
    found = tangents @ many.own.drawn[0] / 1e-2
    assert found == approx(expected, abs=0.04 * np.linalg.norm(expected) + 1e-4)


@pytest.mark.parametrize("near", [5e-3, 12e-3])
def test_a_contact_that_has_ended_does_not_move_the_others_when_its_foot_point_leaps(near):
    """The tissue under them recovers as if it had stayed, also when it begins elsewhere; with the correction of the
    present place it rose at once, by 3 % of its indentation."""
    stays, leaps = slab(retardation=0.02).under(2), slab(retardation=0.02).under(2)
    first, second = (-0.02, 0.0), (-0.02 + near, 0.0)

    def steps(body, foot, force, normal=UP):
        return body.steps([load(body, first, 0.6), load(body, foot, force, normal)], 1e-3)[0]

    for k in range(220):
        for body in (stays, leaps):
            before = steps(body, second, 0.6 if k < 200 else 0.0)[2]
    for k in range(40):
        tilted = (0.6 * math.sin(0.1 * k), 0.0, math.sqrt(1.0 - (0.6 * math.sin(0.1 * k)) ** 2))
        right, found = steps(stays, second, 0.0), steps(leaps, (0.02, 0.01 - k * 1e-3), 0.0, tilted)
        assert found[1:] == approx(right[1:], abs=0.01 * (before - right[2]) + 1e-9)
    for _ in range(20):
        right, found = steps(stays, second, 0.0), steps(leaps, (-0.01, 0.0), 1e-6)
        assert found[1:] == approx(right[1:], abs=0.01 * (before - right[2]) + 1e-9)


def test_the_sent_surface_includes_all_contacts():
    body = slab()
    many, depths = pressed(body, [(-0.010, 0.0), (0.010, 0.0)], [0.5, 0.3])
    nodes, moved = many.displaced(*many.own.feet)
    field = np.zeros((len(body.mesh.vertices), 3))
    field[nodes] = moved
    for place, force, depth in ((-0.010, 0.5, depths[0]), (0.010, 0.3, depths[1])):
        at, forces, *_ = load(body, (place, 0.0), force)
        assert (forces * field[at]).sum() / force == approx(depth, rel=0.01)


def cut(apart, cells):
    """Half of the block, with a mesh that follows two patches on y = 0."""
    size = RADIUS / cells
    x = grade_axis(-SIDE / 2, -apart / 2 - RADIUS, apart / 2 + RADIUS, SIDE / 2, size)
    points, corners = grid(
        x, grade_axis(0.0, 0.0, RADIUS, SIDE / 2, size), grade_axis(-SLAB, -0.6 * RADIUS, 0.0, 0.0, size)
    )
    mesh = quadratic(points, bricks(points, corners), np.zeros(6 * len(corners), np.int64))
    high = mesh.points[mesh.faces[:, :3], 2]
    top, under = mesh.faces[(high > -1e-9).all(axis=1)], mesh.faces[(high < 1e-9 - SLAB).all(axis=1)]
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 1] < 1e-9, 1] = True
    units = []
    for place in (-apart / 2, apart / 2):
        fixed[continuum.stuck(mesh.points, place, RADIUS), :2] = True
        units.append(continuum.on_triangles(mesh.points, top, TissueBlock(place=place).pressure))
    return mesh, fixed, under, units


def full(apart, forces, cells, levels):
    """Indentations [m] under both patches of the full model."""
    mesh, fixed, under, units = cut(apart, cells)
    pull = sum(0.5 * f * unit for f, unit in zip(forces, units, strict=True))
    bed = ElasticFoundation(under, BED * YOUNG)
    body = Solver(mesh, {0: neo_hooke(YOUNG, POISSON)}, fixed, loads=lambda s: s * pull, contacts=[bed], settings=STEPS)
    for level in range(levels):
        body.advance((level + 1) / levels)
    return np.array([float(np.sum(unit * body.displacement)) for unit in units])


@pytest.mark.parametrize("apart", [5e-3, 12e-3, 40e-3])
def test_two_light_contacts_agree_with_a_full_model(apart):
    """The full model is coarse and 2 % too stiff. The coupling, 45 to 2.7 % of the compliance, agrees within 3 %. If
    each patch were condensed separately, the coupling over 40 mm would be 8 % too low."""
    exact = full(apart, (0.02, 0.0), 2, 1)
    _, found = pressed(slab(), [(-apart / 2, 0.0), (apart / 2, 0.0)], [0.02, 0.0])
    assert found == approx(exact, abs=0.03 * exact.max())
    assert found[1] == approx(exact[1], rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize("apart", [5e-3, 10e-3, 20e-3])
@pytest.mark.parametrize("forces", [(0.6, 0.6), (0.9, 0.3)])
def test_two_strong_contacts_agree_with_the_full_model_within_3_percent(apart, forces):
    exact = full(apart, forces, 4, math.ceil(max(forces) / 0.15))
    _, found = pressed(slab(), [(-apart / 2, 0.0), (apart / 2, 0.0)], forces)
    assert found == approx(exact, abs=0.03 * exact.max())
