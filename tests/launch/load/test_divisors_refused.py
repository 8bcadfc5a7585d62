"""Divisors between device and contact are faults: the contact would differentiate the motion of several ticks."""

import pytest

from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find


def faults(*sets: str) -> list[str]:
    launch = find("kidney").but(overrides=tuple(f"{name}.every={n}" for name, n in (s.split("=") for s in sets)))
    try:
        launch.load()
    except GraphError as error:
        return [str(fault) for fault in error.faults]
    return []


@pytest.mark.parametrize("node", ["device", "finger", "collision"])
def test_a_divisor_before_the_contact_is_a_fault_with_a_remedy(node):
    (fault,) = faults(f"{node}=3")
    assert f"node '{node}'" in fault and "every: 3" in fault and f"`{node}: {{every: 1}}`" in fault


def test_all_wrong_divisors_are_reported_at_once():
    assert len(faults("finger=3", "collision=2")) == 2


@pytest.mark.parametrize(
    "sets", [("friction=10", "tissue=5", "spread=2"), ("contact=2",), ("contact=4", "collision=2"), ("band=20",)]
)
def test_a_divisor_behind_or_shared_with_the_contact_is_valid(sets):
    assert not faults(*sets)
