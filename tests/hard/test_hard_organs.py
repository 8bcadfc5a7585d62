"""Organs that touch: hard cases of the contact of two deformable bodies, and of three."""

import dataclasses
import json

import numpy as np
import pytest
from pytest import approx
from scipy.optimize import nnls

from palpate.nodes.base import SettingError
from palpate.nodes.contact import Between
from palpate.physics.contact.organs import between
from palpate.studies import organ_pairs

SIZE, TAU = 40, 5e-3
PATCH = np.stack(np.meshgrid(np.arange(8), np.arange(5)), axis=-1).reshape(-1, 2) * 1e-3


def compliance(young):
    """A half-space under SIZE cells of 1 mm [m/N]."""
    apart = np.linalg.norm(PATCH[:, None] - PATCH[None], axis=2)
    inverse = 1.0 / np.maximum(apart, 1e-3)
    np.fill_diagonal(inverse, 16.0 / (3.0 * np.pi * np.sqrt(1e-6 / np.pi)))
    return (1.0 - 0.45**2) / (np.pi * young) * inverse


def gaps():
    return np.sum((PATCH - PATCH.mean(axis=0)) ** 2, axis=1) / 0.02


def press(depth, steps=60):
    """The opening by a load that closes the bodies smoothly, and rests."""
    return depth * np.minimum(1.0, 0.5 - 0.5 * np.cos(np.pi * np.minimum(np.arange(1, steps + 1) / 30, 1.0)))


def run(first, second, depths, dt=1e-3, taus=(TAU, TAU)):
    made, forces, overlaps = between.pair(gaps(), first, second, taus), [], []
    for depth in depths:
        others = np.stack([np.full(SIZE, -depth), np.zeros(SIZE)])
        assert between.step_pair(made, others, dt, 10_000) == 0
        forces.append(made.active.force.sum())
        overlaps.append(max(-made.opening.min(), 0.0))
    return np.array(forces), np.array(overlaps), made


def by_penalty(first, second, depths, spring, dt=1e-3):
    """The same with a penalty spring [N/m] in each cell, whose force is that of the overlap of the last step."""
    share, moved, forces, overlaps = dt / (dt + TAU), np.zeros((2, SIZE)), [], []
    opening = gaps()
    for depth in depths:
        push = spring * np.maximum(-opening, 0.0)
        moved[0] = share * (first @ push - depth) + (1.0 - share) * moved[0]
        moved[1] = share * (second @ push) + (1.0 - share) * moved[1]
        opening = gaps() + moved.sum(axis=0)
        forces.append(push.sum())
        overlaps.append(max(-opening.min(), 0.0))
    return np.array(forces), np.array(overlaps)


def static(first, second, depth):
    """The force at rest, by non-negative least squares."""
    factor = np.linalg.cholesky(first + second)
    return nnls(factor.T, -np.linalg.solve(factor, gaps() - depth), maxiter=5000)[0].sum()


@pytest.mark.parametrize("ratio", [1.0, 30.0, 1000.0])
def test_stiff_organs_on_soft_ones_neither_overlap_nor_oscillate(ratio):
    """A penalty spring that keeps the overlap below 1 % of the depth diverges at 1 kHz; one that does not leaves more
    than 4 %."""
    first, second, depth = compliance(2e3), compliance(2e3 * ratio), 1e-3
    depths = press(depth, 200)
    soft = (first + second).sum(axis=0).max()
    stable = by_penalty(first, second, depths, 0.9 * (1.0 + TAU / 1e-3) / soft)
    assert stable[1][-1] > 0.04 * depth
    stiff = by_penalty(first, second, depths, 100.0 / np.diag(first + second).max())
    assert np.abs(np.diff(stiff[0]))[-20:].max() > 0.1 * static(first, second, depth)
    forces, overlaps, made = run(first, second, depths)
    assert forces[-1] == approx(static(first, second, depth), rel=1e-6)
    assert overlaps.max() < 1e-12 and (np.diff(forces) >= -1e-9).all()
    assert made.past["generated"][0] <= 1e-9 * made.past["dissipated"][0]


def test_a_soft_organ_on_a_rigid_one():
    soft, rigid = compliance(1e3), np.full((SIZE, SIZE), 1e-9) + 1e-9 * np.eye(SIZE)
    forces, overlaps, _ = run(soft, rigid, press(2e-3, 200))
    assert forces[-1] == approx(static(soft, rigid, 2e-3), rel=1e-6) and overlaps.max() < 1e-12


def test_ten_kilohertz_has_the_forces_of_a_thousand_steps():
    """The same press at 1, 10 and 100 kHz: the force converges with the step, at first order."""
    first, second = compliance(5e3), compliance(15e3)
    found = []
    for rate in (1e3, 1e4, 1e5):
        times = np.arange(1, round(0.06 * rate) + 1) / rate
        depths = 1e-3 * (0.5 - 0.5 * np.cos(np.pi * np.minimum(times / 0.03, 1.0)))
        found.append(run(first, second, depths, 1.0 / rate, (TAU, 0.03))[0][round(0.02 * rate) - 1])
    assert abs(found[1] - found[2]) < 0.15 * abs(found[0] - found[2]) < 0.02 * found[2]


@pytest.mark.parametrize("through", [0.3, 0.9])
def test_a_thin_organ_between_two_settles_on_the_solution_of_all(through):
    """Its upper and lower contact are solved one after the other, each with the force of the other of the last step.
    The more the thin organ moves as a whole (`through`), the more steps it takes; they never diverge."""
    outer, own = compliance(20e3), compliance(5e3)
    # displacement of a side by a force on the other: as a plate on a soft elastic foundation
    across = through * own.mean() * np.ones((SIZE, SIZE))
    thin = own + across
    pairs = [between.pair(gaps(), outer, thin, (0.0, 0.0)) for _ in range(2)]
    forces, depth = [], 1e-3
    for _ in range(400):
        for one, other in ((pairs[0], pairs[1]), (pairs[1], pairs[0])):
            # the upper organ is pressed down by the depth; the other side pushes the thin organ away
            moved = np.stack([np.full(SIZE, -depth if one is pairs[0] else 0.0), -across @ other.active.force])
            between.step_pair(one, moved, 1e-3, 10_000)
        forces.append([p.active.force.sum() for p in pairs])
    forces = np.array(forces)
    whole = np.block([[outer + thin, -across], [-across, outer + thin]])
    factor = np.linalg.cholesky(whole)
    gap = np.concatenate([gaps() - depth, gaps()])
    expected = nnls(factor.T, -np.linalg.solve(factor, gap), maxiter=20_000)[0]
    assert forces[-1] == approx([expected[:SIZE].sum(), expected[SIZE:].sum()], rel=1e-6, abs=1e-12)
    for made in pairs:
        assert made.past["generated"][0] <= 1e-9 * made.past["dissipated"][0] + 1e-15
    late = np.abs(forces - forces[-1])
    assert (late[1:] <= late[:-1] * (1.0 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize("depth", [0.05e-3, 1e-3, 8e-3])
def test_organs_that_overlap_at_the_start_are_refused_with_the_depth(depth):
    case = organ_pairs.case(3, seed=2)
    sides = [dict(case.upper), dict(case.lower)]
    high = sides[0]["surface"]["position"]
    moved = {"position": (high[0], high[1], high[2] - case.gap - depth)}
    sides[0]["surface"] = sides[0]["surface"] | moved
    with pytest.raises(SettingError, match=r"the bodies overlap by [0-9.]+ mm at the start"):
        Between(bodies=json.dumps(sides)).start()


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_jumps_of_an_organ_leave_no_force_that_pulls_and_no_overlap_that_is_not_counted(friction):
    """The lower body jumps by up to 3 mm in a step, in four random pairs of bodies."""
    rng, pressed = np.random.default_rng(1), 0
    for number in range(60, 64):
        case = dataclasses.replace(organ_pairs.case(number, seed=2), friction=friction, viscous=0.0)
        contact = organ_pairs.nodes_of(case, False)[2]
        for _ in range(40):
            x, y, z = rng.uniform(-3e-3, 3e-3, 3).tolist()
            way = np.array([0.3 * x, 0.3 * y, case.gap + z])
            organs = contact.step([], [], second_support=organ_pairs.support_at(way), dt=1e-3)
            pull = np.linalg.norm(organs.friction)
            assert np.isfinite([organs.force, pull, organs.generated, organs.dissipated]).all() and organs.force >= 0.0
            assert organs.left > 0 or organs.gap > -1e-9
            assert pull <= friction * organs.force * (1.0 + 1e-9)
            pressed += organs.force > 0.0
    assert pressed > 40
