"""The body that keeps to an error: its levels, its switches, what it estimates."""

import math
from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load, pack
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import Adaptive
from palpate.physics.bodies.fidelity_bases import FidelityBases
from palpate.physics.bodies.fidelity_levels import BLEND, PROBATION, WARM, FidelityLevels, blended
from palpate.physics.bodies.sampled.solve import TOLERANCE
from palpate.physics.bodies.sampled_body import SampledBody
from palpate.physics.contact.spread import Spreader
from palpate.physics.contact.terminal import indentation
from palpate.physics.geometry.mesh import Mesh

UP = (0.0, 0.0, 1.0)
TOP = 9.84e-3
YOUNG = 160.0


@lru_cache
def parts():
    """Basis, levels, and a mesh as coarse as the body."""
    node = Adaptive()
    basis = node.basis()
    return node.levels().cut(basis), node.levels(), Mesh(basis.vertices, basis.triangles)


def switched(error, most=200, retardation=0.0, late=math.inf):
    bases, levels, mesh = parts()
    return FidelityLevels(
        [SampledBody(b, mesh, YOUNG, retardation, 5e-3, 1.0) for b in bases], levels, error, most, late
    )


@lru_cache
def spreader(radius=4.5e-3):
    return Spreader(parts()[2], radius, "biweight")


def load(force, x=0.0, y=-1e-3, dt=1e-3):
    foot, spread = (x, y, TOP), spreader()
    count = spread.spread(foot, UP, (0.1 * force, 0.0, -force)) if force else 0
    return spread.nodes[:count].copy(), spread.forces[:count].copy(), foot, UP, dt


def settled(body, force, **place):
    for _ in range(40):
        law = body.step(*load(force, **place))
        if body.settled:
            break
    return law[3]


@pytest.mark.parametrize("place", [{}, {"x": 3e-3, "y": -5e-3}, {"x": -4e-3, "y": 2e-3}])
def test_a_light_touch_is_answered_the_same_by_each_rung(place):
    bodies = switched(1.0).bodies
    light = [settled(body, 1e-6, **place) for body in bodies]
    assert light == approx([bodies[-1].linear] * len(bodies), rel=1e-2)
    assert [body.linear for body in bodies] == approx([bodies[-1].linear] * len(bodies), rel=1e-4)


def test_under_load_the_rungs_differ_and_more_modes_are_nearer():
    now = np.array([settled(body, 0.1, x=2e-3) for body in switched(1.0).bodies])
    off = np.abs(now / now[-1] - 1.0)
    assert off[0] > 1e-3 and off[-2] < 0.03


@lru_cache
def round_trip(error):
    """Ticks of pressing to 0.3 N, holding and letting go: estimate, modes, indentation, force, and their levels."""
    body, rows = switched(error), []
    for force in np.concatenate([np.linspace(1e-4, 0.3, 120), np.full(30, 0.3), np.linspace(0.3, 1e-4, 150)]):
        law = body.step(*load(force))
        rows.append((body.estimated_error, body.fidelity, law[3], force, body.weight, *law[:3]))
    return np.array(rows)


def test_a_finer_rung_is_taken_under_load_and_a_cheaper_one_when_it_is_enough():
    modes = round_trip(0.06)[:, 1]
    assert len(set(modes)) > 1 and modes.max() > modes[0] and modes[-1] < modes.max()
    strict = round_trip(0.01)[:, 1]
    assert strict.mean() > modes.mean()


def test_what_is_asked_for_is_claimed_but_for_the_ticks_of_a_switch():
    estimated, _, _, force, weight = round_trip(0.06)[:, :5].T
    assert (estimated[(weight == 1.0) & (force > 0.01)] <= 0.06).mean() > 0.9
    assert estimated.min() >= 0.0


def test_the_true_error_is_within_what_is_claimed_on_a_held_out_touch():
    whole, body = switched(1.0).bodies[-1], switched(0.06)
    for force in np.linspace(0.0, 0.25, 26)[1:]:
        for _ in range(4):
            now = body.step(*load(force, x=1.7e-3, y=-3.3e-3))[3]
        assert abs(now / settled(whole, force, x=1.7e-3, y=-3.3e-3) - 1.0) <= body.estimated_error + 1e-3


def test_a_switch_moves_the_indentation_by_its_share_of_the_difference_in_a_tick():
    body, place = switched(1.0), {"x": 2e-3}
    for _ in range(60):
        before = body.step(*load(0.1, **place))[3]
    start, apart = body.fidelity, [settled(level, 0.1, **place) for level in switched(1.0).bodies]
    body.error = 1e-6  # now all modes are asked for
    moved = []
    for _ in range(WARM + BLEND + 1):
        law = body.step(*load(0.1, **place))
        moved.append(abs(law[3] - before))
        before = law[3]
    assert start == 10 and body.fidelity == 80
    gap, whole = abs(apart[-1] - apart[0]), apart[-1]
    assert before == approx(whole, rel=2 * TOLERANCE)
    assert max(moved) <= gap / BLEND + 2 * TOLERANCE * whole < 0.5 * gap + 2 * TOLERANCE * whole


def test_a_blended_law_answers_between_the_two_and_is_either_at_its_ends():
    a, b, force = (900.0, 1.2, 1e-4, 2e-3), (4e3, 1.5, 2e-4, 1.8e-3), 0.3
    ends = [indentation(force, 1e-3, k, n, 0.0, free, now) for k, n, free, now in (a, b)]
    for weight in (0.0, 0.3, 1.0):
        stiffness, exponent, free, now = blended(a, b, weight, force)
        expected = (1.0 - weight) * ends[0] + weight * ends[1]
        assert indentation(force, 1e-3, stiffness, exponent, 0.0, free, now) == approx(expected, rel=1e-6)
        assert now == approx((1.0 - weight) * a[3] + weight * b[3])


def test_pressing_and_letting_go_gives_no_energy_beyond_the_error_of_the_switches():
    _, modes, now, force = round_trip(0.06)[:, :4].T
    assert (np.diff(modes) != 0).sum() >= 2
    work = float(np.sum(force[1:] * np.diff(now)))
    assert work >= -0.06 * 0.3 * now.max()


def test_most_leaves_the_finer_rungs_out_and_the_claim_says_so():
    body = switched(0.001, most=20)
    for force in np.linspace(0.01, 0.2, 60):
        body.step(*load(force))
    assert body.fidelity == 20 and body.estimated_error > 0.001


def test_a_late_step_takes_one_rung_less_and_a_second_in_time_gives_it_back():
    body, free = switched(1e-3, late=1.5e-3), switched(1e-3)
    for _ in range(200):
        body.step(*load(0.1))
        free.step(*load(0.1))
    assert body.fidelity == free.fidelity == 80  # none was late
    told, before = [], body.step(*load(0.1))[3]
    apart = abs(settled(switched(1.0).bodies[-2], 0.1) - settled(switched(1.0).bodies[-1], 0.1))
    for k in range(1 + WARM + BLEND):
        now = body.step(*load(0.1, dt=2e-3 if k < 3 else 1e-3))[3]  # a switch that is under way costs time: one level
        assert abs(now - before) <= apart / BLEND + 2 * TOLERANCE * now
        before = now
    assert body.fidelity == 60 and body.estimated_error > free.estimated_error and body.estimated_error > 1e-3
    for _ in range(round(PROBATION / 1e-3) + WARM + BLEND):
        body.step(*load(0.1))
        told.append(body.fidelity)
    assert told[round(0.9 * PROBATION / 1e-3)] == 60 and told[-1] == 80


def test_steps_that_are_always_late_end_at_the_cheapest():
    body = switched(1e-3, late=1.5e-3)
    for _ in range(8 * (WARM + BLEND)):
        body.step(*load(0.1, dt=3e-3))
    assert body.fidelity == 10


def test_the_same_messages_give_the_same_bytes_and_tell_claim_and_fidelity():
    loads = []
    for force in (0.0, *np.linspace(0.001, 0.2, 25)):
        nodes, forces, foot, normal, _ = load(force)
        loads.append(Load(nodes=nodes, forces=forces, foot=foot, normal=normal))
    setting = {"error": 0.06, "vertices": 400, "position": (0.0, 0.0, 0.0)}
    runs = [FakeBus(Adaptive(**setting)).publish(*loads) for _ in range(2)]
    assert [pack(s) for s in runs[0]] == [pack(s) for s in runs[1]]
    assert (
        runs[0][0].estimated_error == 0.0
        and runs[0][-1].estimated_error > 0.0
        and runs[0][-1].fidelity in (10, 20, 40, 60, 80)
    )


@pytest.mark.parametrize(
    "setting, told",
    [
        ({"error": 0.0}, "setting 'error' \\[1\\]: found 0.0"),
        ({"most": 5}, "setting 'most' \\[1\\]: found 5, expected at least 10"),
        ({"model": "linear"}, "setting 'model'"),
        ({"deadline": -1e-3}, "setting 'deadline' \\[s\\]: found -0.001"),
        ({"surface": "kidney"}, "no reduced basis is stored"),
    ],
)
def test_wrong_settings_are_told_in_a_line(setting, told):
    with pytest.raises(SettingError, match=told) as error:
        FakeBus(Adaptive(**setting))
    assert "\n" not in str(error.value)


def test_levels_of_another_basis_are_refused_with_the_command_that_makes_them(monkeypatch, tmp_path):
    levels, about = parts()[1], {"basis": "another"}
    levels.save(tmp_path / "other.npz", about)
    assert (FidelityBases.load(tmp_path / "other.npz")[0].kappa == levels.kappa).all()
    monkeypatch.setattr("palpate.nodes.deformation.adaptive.beside", lambda path: tmp_path / "other.npz")
    command = "palpate reduce --levels --set model=sampled --set surface=fingertip"
    with pytest.raises(SettingError, match=f"fidelity levels of basis another.*{command}"):
        Adaptive().levels()
    monkeypatch.setattr("palpate.nodes.deformation.adaptive.beside", lambda path: tmp_path / "none.npz")
    with pytest.raises(SettingError, match=r"none.npz: not the fidelity levels"):
        Adaptive().levels()
