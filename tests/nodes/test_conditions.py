"""What a node reports of itself: its condition, from fields of its state, and its notes, also before the start."""

import pytest

from palpate.launch.load.classes import catalogue
from palpate.nodes.base import CompiledNode, settings
from palpate.nodes.base.compiled import record

CLASSES = {
    entry.use: entry.cls
    for entry in catalogue()[0]
    if issubclass(entry.cls, CompiledNode) and all(s.default is not ... for s in settings(entry.cls).values())
}
REPORTING = {
    "collision.Mesh": ("outside", "outside its range"),
    "collision.Nurbs": ("outside", "outside its range"),
    "deformation.MassSpring": ("excess", "outside its range"),
    "deformation.ReducedFE": ("beyond", "outside its range"),
    "ledger.Energy": ("tripped", "tripped"),
    "spread.Kernel": ("rigid", "outside its range"),
}


@pytest.mark.parametrize("use", CLASSES)
def test_a_node_that_has_not_started_has_no_condition_and_no_notes(use):
    node = CLASSES[use]()
    assert node.condition() == "" and node.notes() == []


def test_the_conditions_of_all_classes_are_these():
    assert len(CLASSES) > 20
    found = {use: next(iter(cls.conditions.items())) for use, cls in CLASSES.items() if cls.conditions}
    assert found == REPORTING
    for use, (field, _) in REPORTING.items():
        assert field in record(CLASSES[use]).names


@pytest.mark.parametrize("use", ["collision.Nurbs", "ledger.Energy", "spread.Kernel"])
def test_a_field_of_the_state_is_the_condition_while_it_is_positive(use):
    node = CLASSES[use]()
    node.start()
    (field, words) = REPORTING[use]
    assert node.condition() == ""
    node.own[field] = 1
    assert node.condition() == words
    node.own[field] = 0
    assert node.condition() == ""
