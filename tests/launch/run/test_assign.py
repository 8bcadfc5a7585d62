"""The cores and priorities of the processes of a run."""

import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run import assign
from palpate.launch.run.assign import PRIORITY, jobs


def cores(monkeypatch, count: int, place: str, clock: str) -> dict[str, tuple[int, ...] | None]:
    """The cores of each group on a machine with this number of cores."""
    monkeypatch.setattr(assign, "usable_cores", lambda: list(range(count)))
    planned = plan(find("palpate-two").load())
    launch = find("palpate-two").but(place=place)
    return {job.group: job.core for job in jobs(planned, launch.placement(planned), clock=clock)}


@pytest.mark.parametrize("count", [2, 8])
def test_on_the_real_clock_a_device_has_a_core_that_the_force_path_cannot_fill(monkeypatch, count):
    given = cores(monkeypatch, count, "apart", "real")
    devices = {name for name in given if name.startswith("device")}
    assert len(devices) == 2 and all(given[name] == (count - 2,) for name in devices)
    path = {core for name, core in given.items() if name not in {*devices, "log"}}
    assert path == {(count - 1,)} and given["log"] == tuple(range(count - 1))


@pytest.mark.parametrize(
    ("count", "place", "clock", "core"),
    [
        (2, "apart", "simulated", (1,)),  # it wakes the next node at each tick
        (2, "auto", "real", (1,)),  # the device is part of the force path's process
        (1, "apart", "real", None),
        (2, "fused", "real", None),
    ],
)
def test_otherwise_the_force_path_has_one_core(monkeypatch, count, place, clock, core):
    given = cores(monkeypatch, count, place, clock)
    assert {c for name, c in given.items() if name not in ("log", "rest")} == {core}


def test_paced_nodes_have_the_highest_priority():
    planned = plan(find("kidney").load())
    given = jobs(planned, find("kidney").placement(planned), clock="real")
    assert {job.group: job.priority for job in given if job.group in ("device", "finger", "log")} == {
        "device": PRIORITY + 1, "finger": PRIORITY, "log": None,
    }  # fmt: skip


def test_a_group_that_joins_gets_the_cores_of_its_machine(monkeypatch):
    """It was pinned to a core of the launcher, which the other machine may lack."""
    planned = plan(find("kidney").load())
    monkeypatch.setattr(assign, "usable_cores", lambda: list(range(64)))
    given = jobs(planned, find("kidney").placement(planned), clock="real", joined=["tissue"])
    assert {job.group: job.core for job in given if job.group in ("contact", "tissue")} == {
        "contact": (63,), "tissue": None,
    }  # fmt: skip
