"""The order of the lanes of an ensemble changes nothing: permuted lanes give permuted results, notes and errors."""

import random
import warnings

import numpy as np
import pytest
from setting_ends import ends, numeric

import palpate
from palpate.launch.load.graph import load
from palpate.nodes.base import CompiledNode, settings
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.physics.errors import PalpateError

KEEP = ["contact.force", "contact.indentation", "controller.force"]
HAND = "[{hold: 0.02}, {to: [0, 0, 0.0935], time: 0.1}, {hold: 0.05}, {to: [0.03, 0, 0.097], time: 0.1}]"
SETS = [f"scene.hand.path={HAND}", "scene.energy.ledger=on", "scene.finger.band=on"]
SAMPLE = 5
MOST = {"vertices": 20_000}  # its end, two millions, takes a minute


def outcome(path, values, graph="kidney", keep=KEEP):
    """Results, errors and notes of each lane, or the class of the refusal."""
    try:
        ensemble = palpate.Ensemble(graph, len(values), {path: values}, keep, sets=SETS, duration=0.3, every=10)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = ensemble.run(quiet=True)
    except PalpateError as error:
        return type(error).__name__, "lane" in str(error)
    notes = [[] for _ in values]
    for note in ensemble.notes:
        notes[note.lane].append((note.node, note.text))
    return [
        (*(found[name].values[lane].tobytes() for name in keep), str(found["error"].values[lane]), notes[lane])
        for lane in range(len(values))
    ]


def cases():
    """(path, values) of each numeric setting of the nodes of the kidney: its value and the ends of its range."""
    found = []
    for name, spec in load("kidney", overrides=SETS).nodes.items():
        if issubclass(spec.cls, CompiledNode):
            for setting in settings(spec.cls).values():
                usual = spec.settings[setting.name]
                if numeric(setting) and usual is not None:
                    low, high = ends(setting, usual)
                    found.append((f"{name}.{setting.name}", [usual, low, MOST.get(setting.name, high)]))
    return found


def check(path, values):
    order = [2, 0, 1]
    one = outcome(path, values)
    other = outcome(path, [values[place] for place in order])
    assert other == (one if isinstance(one, tuple) else [one[place] for place in order]), (path, values)


def test_permuted_lanes_give_permuted_results_and_notes():
    """A seeded sample of the settings, with each at the ends of its range."""
    for path, values in random.Random(6).sample(cases(), SAMPLE):
        check(path, values)


@pytest.mark.long
def test_every_setting_of_the_kidney_may_have_its_ends_in_any_lane():
    known = cases()
    assert len(known) > 60
    for path, values in known:
        check(path, values)


@pytest.mark.parametrize("values", [[0.0, 0.2], [0.2, 0.0], [0.0, 0.1, 0.2]])
def test_lanes_without_retardation_run_next_to_others(values):
    lanes = outcome("tissue.retardation", values)
    assert [lane[-2] for lane in lanes] == [""] * len(values)
    fast = [any("slides faster than" in text for _, text in lane[-1]) for lane in lanes]
    assert fast == [value > 0.0 for value in values]
    for lane, value in zip(lanes, values, strict=True):
        found = [text for node, text in lane[-1] if node == "tissue" and "slides faster" in text]
        assert all(f"faster than {2.0 / value:.3g} mm/s" in text for text in found)  # R/(4 tau) of 8 mm


def test_an_error_in_a_note_stays_in_its_lane_and_names_its_node(monkeypatch):
    usual = MassSpring.notes

    def notes(self):
        if self.retardation == 0.1 and hasattr(self, "own") and self.own["beyond"]:
            raise ZeroDivisionError("float division by zero")
        return usual(self)

    monkeypatch.setattr(MassSpring, "notes", notes)
    lanes = outcome("tissue.retardation", [0.1, 0.2, 0.05])
    assert "node 'tissue', notes: float division by zero" in lanes[0][-2]
    assert [lane[-2] for lane in lanes[1:]] == ["", ""] and lanes[1][-1] and not lanes[0][-1]
    assert all(np.isfinite(np.frombuffer(lane[0])).all() for lane in lanes)  # its results are valid


def test_a_note_about_the_graph_belongs_to_the_lanes_whose_values_cause_it():
    """As the shell prints it for each of them; the lanes between the extremes are not loaded."""
    values = [500.0, 3e4, 2e4, 1e4, 400.0]
    lanes = outcome("friction.bristle_stiffness", values)
    noted = [[text for node, text in lane[-1] if not node] for lane in lanes]
    for value, lines in zip(values, noted, strict=True):
        assert lines == list(load("kidney", overrides=[*SETS, f"friction.bristle_stiffness={value}"]).notes)
    assert [bool(lines) for lines in noted] == [False, True, True, True, False]
