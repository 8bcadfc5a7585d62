"""Nodes at rest sleep: forces and pictures do not change, and nodes wake up without losing a tick."""

import dataclasses

import pytest

from palpate import open as open_recording
from palpate.engine.slot import Slot
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Torque
from palpate.nodes.base import Node
from palpate.records.reader import Recording

AIR = (
    "scene.hand.path=[{hold: 0.05}, {to: [0, 0, 0.1035], time: 0.15}, {to: [0.004, 0, 0.121], time: 0.15}, {hold: 0.5}]"
)
"""A press from 7 mm above, a short drag, and a hold at 12 mm above that is longer than the recovery of the tissue."""
ORDERED = ("contact", "tissue")


@pytest.fixture(params=["MassSpring", "ReducedFE", "MassSpring second order", "ReducedFE second order"])
def runs(request, tmp_path, monkeypatch):
    """The recordings of a run with sleep and of one without, and the counters of the first."""
    counters = {}
    for sleeps in (False, True):
        monkeypatch.setattr(Slot, "sleeps", sleeps)
        body, *second = request.param.split(" ", 1)
        sets = (f"tissue.use=deformation.{body}", AIR, *(f"{node}.second_order=true" for node in ORDERED if second))
        launch = find("kidney").but(place="fused", overrides=sets, duration=0.85)
        result = execute(dataclasses.replace(launch, record=tmp_path / f"{sleeps}.mcap")).result
        assert result.ok
        counters = result.health
    return tmp_path / "True.mcap", tmp_path / "False.mcap", counters


def test_force_and_displayed_surface_are_bit_equal_with_sleep(runs):
    asleep, awake, counters = runs
    assert all(counters[node]["asleep"] > 50 for node in ("contact", "friction", "spread", "tissue"))
    assert all(counters[node]["asleep"] == 0 for node in ("device", "finger", "collision", "controller", "statics"))
    for stream in ("device", "collision", "friction", "controller", "statics"):
        mine, theirs = ([p for _, _, p in Recording(file).payloads(stream)] for file in (asleep, awake))
        assert mine == theirs, stream
    mine, theirs = open_recording(asleep), open_recording(awake)
    assert max(mine.contact.force) > 0.3
    assert list(mine.contact.force) == list(theirs.contact.force)
    deepest = ([abs(moved).max(initial=0.0) for moved in run.tissue.displacement] for run in (mine, theirs))
    # Displacements that decay while the contact sleeps are centred on the foot point at which it fell asleep.
    assert all(abs(a - b) < 5e-9 for a, b in zip(*deepest, strict=True))


class Counter(Node):
    """Rests while the torque is zero; sends the duration of its steps."""

    def start(self) -> None:
        self.steps: list[float] = []
        self.last = 1.0

    def rests(self, torque: Torque) -> bool:
        return torque.torques[0] == self.last == 0.0

    def step(self, torque: Torque, *, dt: float) -> Torque:
        self.steps.append(dt)
        self.last = torque.torques[0]
        return Torque(torques=(self.last, float(len(self.steps)), 0.0))


def test_a_node_wakes_at_the_required_tick_with_one_long_step():
    node = Counter()
    bus = FakeBus(node)
    answers = bus.publish(*(Torque(torques=(x, 0.0, 0.0)) for x in (1.0, 0.0, 0.0, 0.0, 2.0, 2.0)))
    assert [answer.torques[:2] for answer in answers] == [
        (1.0, 1.0), (0.0, 2.0), (0.0, 2.0), (0.0, 2.0), (2.0, 3.0), (2.0, 4.0)
    ]  # fmt: skip
    assert [answer.tick for answer in answers] == list(range(6))
    assert node.steps == pytest.approx([1e-3] * 4)
