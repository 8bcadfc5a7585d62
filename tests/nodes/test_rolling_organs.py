"""Organs that roll on each other, so that the contact leaves the cells of the start: against the same organs that were
set up at the end of the roll."""

import json

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation
from support.rolling_balls import CLOSING, FAR, UP, contact, course, roll, together

from palpate.messages.contact import SIDES
from palpate.nodes.contact.side import Side
from palpate.nodes.deformation import ReducedFE
from palpate.physics.contact.organs.candidates import candidates
from palpate.physics.contact.organs.surface_cells import surface_cells
from palpate.physics.geometry.mesh import plane

CASES = [
    ("MassSpring", 15e-3, 0.0, ((0, 0, 0), (0, 0, 0)), (2600, 2000)),
    ("MassSpring", 30e-3, 2.0, ((0.5, -0.3, 1.0), (1.0, 0.4, 0.0)), (2000, 2600)),
    ("ReducedFE", 15e-3, -1.0, ((1.5, 0.2, 0.0), (0.0, 1.0, 0.3)), (2600, 2000)),
    ("ReducedFE", 30e-3, 0.7, ((0, 0, 0), (0, 0, 0)), (2000, 2600)),
]


@pytest.mark.parametrize("kind, way, heading, turns, vertices", CASES)
def test_organs_that_roll_have_the_contact_of_organs_set_up_there(kind, way, heading, turns, vertices):
    """With the cells of the start the force was 0.00 to 0.13 of the right one."""
    path, place, out, turn = roll(way, heading)
    made = contact(kind, FAR * UP, turns, vertices)
    found = course(made, [*path, *[path[-1]] * 200])
    there = contact(kind, place, (together(turn, turns[0]), turns[1]), vertices)
    down = [(-CLOSING * share * out, 0.0 * UP) for share in [*np.linspace(0.0, 1.0, 300), *[1.0] * 200]]
    end, right = found[-1], course(there, down)[-1]
    assert end.force == approx(right.force, rel=0.015) and end.area == approx(right.area, rel=0.02)
    np.testing.assert_allclose(end.resultant, right.resultant, atol=0.015 * right.force)
    force = np.array([each.force for each in found])
    assert np.abs(np.diff(force[300:])).max() < np.abs(np.diff(force[:300])).max()
    assert end.generated < 1e-12 and min(each.gap for each in found) > -1e-9
    assert not any("end of the region" in each for each in made.notes())
    assert (made._held["track.cell"] >= len(made._held["track.cell"])).sum() > 20


def test_a_roll_there_and_back_returns_to_the_same_contact():
    path, *_ = roll(12e-3, 0.4)
    made = contact("MassSpring", FAR * UP, np.zeros((2, 3)))
    found = course(made, [*path[:300], *[path[299]] * 100, *path[300:], *path[:299:-1], *[path[300]] * 200])
    assert found[-1].force == approx(found[399].force, rel=0.01) and found[-1].area == approx(found[399].area, rel=0.02)
    assert made._held["track.cell"].tolist() != list(range(len(made._held["track.cell"])))


@pytest.mark.parametrize("kind", ["MassSpring", "ReducedFE"])
def test_compliances_after_a_roll_are_those_of_candidates_in_these_cells(kind):
    """All computed again from the shares of the same cells, of which each was computed in some step of the roll."""
    path, *_ = roll(10e-3, 0.3)
    made = contact(kind, FAR * UP, np.zeros((2, 3)), friction=0.3)
    course(made, [*path, *[path[-1]] * 300], loads=[None])
    held = made._held
    names = ["pair.first", "pair.second", "one.response", "two.response", "one.aside", "two.aside", "rub.first",
             "rub.second"]  # fmt: skip
    kept = {name: held[name].copy() for name in names}
    for cell in range(len(held["pair.gap"])):
        made.own["still"][:], held["track.late"][:], held["track.late"][cell] = 1.0, 0.0, 1e3
        course(made, [path[-1]], loads=[None])
    for name, right in kept.items():
        np.testing.assert_allclose(held[name], right, atol=0.02 * np.abs(right).max(), err_msg=name)


def test_exchanged_organs_that_roll_have_the_same_bits():
    path, *_ = roll(8e-3, 0.0)
    one, other = (
        course(contact("MassSpring", FAR * UP, np.zeros((2, 3)), exchanged=exchanged, friction=0.3), path, exchanged)
        for exchanged in (False, True)
    )
    assert [each.force for each in one] == [each.force for each in other]
    assert [each.area for each in one] == [each.area for each in other]


def test_each_organ_that_rolls_gets_its_load_with_the_normal_in_its_axes():
    """Organs of finite elements yield to the part of a load along its normal. Rolled by 82 degrees against each other;
    also with organs exchanged, so that each is the second one once."""
    path, _, out, turn = roll(15e-3, 0.5)
    right = np.array([Rotation.from_rotvec(turn).inv().apply(-out), out])  # outwards, of upper and lower organ
    found = []
    for exchanged in (False, True):
        made = contact("ReducedFE", FAR * UP, np.zeros((2, 3)), (1000, 800), exchanged)
        given = json.loads(made.bodies)
        sides = [Side(side=side, **each["surface"]) for side, each in zip(SIDES, given, strict=True)]
        organs = [ReducedFE(**each["settings"]) for each in given]
        for node in (*sides, *organs):
            node.start()
        answers = course(made, [*path, *[path[-1]] * 300], exchanged)
        for answer in answers[-100:]:
            loads = [side.step(answer, dt=1e-3)[0] for side in sides]
            surfaces = [organ.step([load], dt=1e-3) for organ, load in zip(organs, loads, strict=True)]
        assert answers[-1].across_normal.shape == (3,) and answers[-1].force > 0.05
        order = slice(None, None, -1 if exchanged else 1)
        found.append((loads[order], surfaces[order]))
    for loads, _ in found:
        for k in range(2):
            np.testing.assert_allclose(loads[k].normal, right[k], atol=0.02)
            force = np.sum(loads[k].forces, axis=0)
            np.testing.assert_allclose(loads[k].normal, -force / np.linalg.norm(force), atol=5e-3)
    (one, yields), (other, answers) = found
    for k in range(2):
        assert one[k].nodes.tolist() == other[k].nodes.tolist()
        for name in ("normal", "foot", "forces"):
            a, b = np.array(getattr(one[k], name)), np.array(getattr(other[k], name))
            np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(a).max(), err_msg=name)
        a, b = yields[k].displacement, answers[k].displacement
        assert np.abs(a).max() > 1e-4
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(a).max())


def test_a_roll_that_is_too_fast_lacks_force_with_a_note_and_recovers():
    path, *_ = roll(15e-3, 0.0, speed=0.3)
    made = contact("MassSpring", FAR * UP, np.zeros((2, 3)))
    found = course(made, [*path, *[path[-1]] * 400])
    slow, *_ = roll(15e-3, 0.0)
    right = course(contact("MassSpring", FAR * UP, np.zeros((2, 3))), [*slow, *[slow[-1]] * 200])[-1]
    assert found[len(path) - 1].force < 0.5 * right.force and found[-1].force == approx(right.force, rel=0.02)
    assert any("end of the region" in each for each in made.notes())
    assert found[-1].generated < 1e-12 and min(each.gap for each in found) > -1e-9


@pytest.mark.parametrize("rate", [1000, 8000])
@pytest.mark.parametrize("vertices, closing, settings, least", [
    ((8000, 6000), 1.8e-3, {"reach": 2e-3, "cells": 60}, 0.90),
    ((2600, 2000), 2.5e-3, {"reach": 3e-3, "cells": 40}, 0.90),
])  # fmt: skip
def test_few_candidates_that_are_all_close_follow_a_roll(rate, vertices, closing, settings, least):
    """Where only those that were open by 1 mm could move, 0.66 to 0.84 of the right force was left after 20 mm. The
    force changes by less than 3 % in a tick, at each rate; at 8 kHz it was 13 %."""
    path, place, out, turn = roll(20e-3, 0.4, rate=rate, closing=closing)
    made = contact("MassSpring", FAR * UP, np.zeros((2, 3)), vertices, **settings)
    found = course(made, [*path, *[path[-1]] * (3 * rate // 10)], rate=rate)
    there = contact("MassSpring", place, (turn, np.zeros(3)), vertices, **settings)
    down = [(-closing * share * out, 0.0 * UP) for share in [*np.linspace(0.0, 1.0, 300), *[1.0] * 200]]
    right = course(there, down)[-1]
    force = np.array([each.force for each in found])
    assert least * right.force < found[-1].force < 1.01 * right.force
    assert np.abs(np.diff(force[3 * rate // 10 :])).max() < 0.03 * right.force
    assert found[-1].generated < 1e-12 and min(each.gap for each in found) > -1e-9


def test_a_press_moves_no_candidate_to_another_cell():
    path, *_ = roll(1e-3, 0.0)
    made = contact("MassSpring", FAR * UP, np.zeros((2, 3)))
    course(made, [*path[:300], *[path[299]] * 50])
    assert made._held["track.cell"].tolist() == list(range(len(made._held["track.cell"])))


def test_fine_cells_cover_the_surface_once_and_know_their_neighbours():
    one, other = plane(40e-3, 900), plane(40e-3, 400)
    bowl = type(one)(one.vertices + np.outer(1e-3 + 20.0 * (one.vertices[:, :2] ** 2).sum(axis=1), UP),
                     one.triangles[:, ::-1].copy())  # fmt: skip
    found = candidates(bowl, other, 6e-3, 60)
    assert not found.swapped and len(found.gap) <= 60
    cells, count = surface_cells(bowl, found), len(found.gap)
    owner = np.repeat(np.arange(len(cells.area)), np.diff(cells.begins))
    leaves = cells.child[owner] < 0
    assert sorted(cells.vertices[leaves]) == np.flatnonzero(bowl.areas > 0.0).tolist()
    assert cells.area[cells.child < 0].sum() == approx(bowl.areas.sum(), rel=1e-12)
    for parent in np.flatnonzero(cells.child >= 0):
        parts = np.flatnonzero(cells.parent == parent)
        assert parts[0] == cells.child[parent] and len(parts) > 1
        inside = np.isin(owner, parts)
        assert sorted(cells.vertices[inside]) == sorted(cells.vertices[owner == parent])
        assert cells.area[parts].sum() == approx(cells.area[parent], rel=1e-12)
    assert (cells.child >= 0).sum() > 5 and (cells.parent[:count] < 0).all()
    ends = np.repeat(np.arange(len(cells.area)), np.diff(cells.near_at))
    pairs = set(zip(ends.tolist(), cells.near.tolist(), strict=True))
    assert pairs == {(b, a) for a, b in pairs} and all(a != b for a, b in pairs)
    assert not any(cells.parent[a] == b for a, b in pairs)
    first = {(a, b) for a, b in pairs if a < b < count}
    assert first == set(map(tuple, found.borders.cells.tolist()))
