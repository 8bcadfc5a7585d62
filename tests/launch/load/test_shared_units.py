"""Shipped classes that can replace one another use the same unit for settings with the same name."""

from itertools import combinations

from palpate.engine.graph import sent_by
from palpate.launch.load.classes import catalogue
from palpate.nodes.base import settings
from palpate.units.quantity import UnitError, parse


def meaning(unit):
    """The dimension of a unit, or its text if the dimension is not fixed (N/m^n)."""
    try:
        return parse(unit)
    except UnitError:
        return unit


def test_shipped_classes_that_can_replace_one_another_agree_on_units():
    for one, other in combinations([entry.cls for entry in catalogue()[0]], 2):
        if set(sent_by(one)) & set(sent_by(other)):
            mine, theirs = settings(one), settings(other)
            for name in mine.keys() & theirs.keys():
                assert meaning(mine[name].unit) == meaning(theirs[name].unit), (name, one, other)
