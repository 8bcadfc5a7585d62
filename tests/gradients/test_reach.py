"""Derivatives by the places of a map of stiffness: those that no finger reaches are exactly 0 and have no lane."""

import warnings

import numpy as np
import pytest

import palpate
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.mass_spring import MassSpring

pytest.importorskip("xarray")
COUNT, DURATION = 60, 0.6


def quiet(function, *given, **named):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        return function(*given, **named)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A map of 60 places all over the kidney, and its factors."""
    file = tmp_path_factory.mktemp("map") / "map.csv"
    vertices = MassSpring(surface="kidney", position=(0.0, 0.0, 0.084), vertices=10000).mesh().vertices
    places, away = [int(vertices[:, 2].argmax())], np.full(len(vertices), np.inf)
    while len(places) < COUNT:  # each as far from the others as possible
        away = np.minimum(away, np.linalg.norm(vertices - vertices[places[-1]], axis=1))
        places.append(int(away.argmax()))
    factors = np.linspace(0.8, 1.2, COUNT)
    head = "x [m],y [m],z [m],factor"
    np.savetxt(file, np.column_stack([vertices[places], factors]), delimiter=",", header=head, comments="")
    return file, factors


def sets(measured):
    file, factors = measured
    return ["scene.hand.ideal=true", f"tissue.measured_map={file}", f"tissue.map_factors={factors.tolist()}"]


@pytest.fixture
def lanes(monkeypatch):
    """Numbers of lanes of each run of a derivative."""
    found, before = [], palpate.Ensemble._other_lanes

    def other_lanes(self, lanes, *given):
        found.append(lanes)
        return before(self, lanes, *given)

    monkeypatch.setattr(palpate.Ensemble, "_other_lanes", other_lanes)
    return found


def derivatives(measured, places=range(COUNT)):
    by = [f"tissue.map_factors[{place}]" for place in places]
    found = quiet(palpate.gradient, "kidney", by, sets=sets(measured), duration=DURATION)
    return found["contact.force.derivative"].values, found["contact.force.error"].values


@pytest.fixture(scope="module")
def separate(measured):
    """Forces (place, 2, time) of runs in which each place has another factor, and their step."""
    factors, step = measured[1], 1e-4
    columns = [factors]
    for place in range(COUNT):
        for sign in (1.0, -1.0):
            moved = factors.copy()
            moved[place] += sign * step
            columns.append(moved)
    over = {"tissue.map_factors": [each.tolist() for each in columns]}
    runs = quiet(palpate.Ensemble, "kidney", len(columns), over, sets=sets(measured), duration=DURATION)
    force = quiet(runs.run, quiet=True)["contact.force"].values
    return force[0], force[1:].reshape(COUNT, 2, -1), step


def check(found, separate, places=range(COUNT)):
    base, moved, step = separate
    moved, (derivative, error) = moved[list(places)], found
    limit = (moved[:, 0] - moved[:, 1]) / (2.0 * step)
    touched = (moved != base).any(axis=(1, 2))
    assert touched.any()
    size = np.sqrt(np.mean(limit[touched] ** 2))
    good = np.isfinite(derivative)
    assert good.mean() > 0.95
    assert (np.abs(derivative - limit) - error)[good].max() < 1e-4 * size
    return touched


def test_places_out_of_reach_are_exactly_zero_and_have_no_lane(measured, separate, lanes):
    found = derivatives(measured)
    touched = check(found, separate)
    assert 3 <= touched.sum() < 0.3 * COUNT
    assert (found[0][~touched] == 0.0).all()
    assert (found[1][~touched] == 0.0).all()
    assert len(lanes) == 2
    assert lanes[0] == 1
    left = (lanes[1] - 2) / 6  # one lane moves nothing, one all that are left out
    assert touched.sum() <= left <= touched.sum() + 4


def test_a_wrong_reach_is_found_and_costs_only_lanes(measured, separate, lanes, monkeypatch):
    """Planted: the body says that no place has an effect."""
    monkeypatch.setattr(MassSpring, "out_of_reach", lambda self, setting, feet: np.ones(COUNT, bool))
    places = range(8)  # the first is at the top, under the finger
    check(derivatives(measured, places), separate, places)
    assert lanes == [1, 2, 1 + 6 * 8]


def test_given_factors_replace_those_of_the_file(measured):
    file, factors = measured
    same = {"surface": "kidney", "position": (0.0, 0.0, 0.084), "vertices": 10000, "measured_map": str(file)}
    body = MassSpring(**same).hardness()
    np.testing.assert_array_equal(MassSpring(**same, map_factors=tuple(factors)).hardness(), body)
    other = MassSpring(**same, map_factors=tuple(2.0 * factors)).hardness()
    np.testing.assert_array_equal(other[body != 1.0], 2.0 * body[body != 1.0])
    for given, text in (
        ((1.0,), f"found 1 factors, expected {COUNT}"),
        ((0.0,) * COUNT, "found 0, expected 0.001 to 1000"),
    ):
        with pytest.raises(SettingError, match=text):
            MassSpring(**same, map_factors=given).hardness()
    with pytest.raises(SettingError, match="expected a measured_map too"):
        MassSpring(surface="kidney", map_factors=(1.0,)).start()
