"""The base class of nodes and the test harness, on a small node of this file."""

from typing import Annotated

import msgspec
import pytest
from pytest import approx

from palpate.launch.load.classes import catalogue, find_class
from palpate.launch.testing import FakeBus
from palpate.messages import Force, Friction, Pose, Torque
from palpate.nodes.base import Node, SettingError, inputs, outputs, settings
from palpate.nodes.base.carrier import Carrier
from palpate.nodes.base.node import convert
from palpate.nodes.deformation import MassSpring


class Drag(Node):
    """Viscous drag [N] on a finger, with its path so far as state."""

    coefficient: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 2.0
    label: Annotated[str, "1"] = "drag"

    def start(self) -> None:
        self.way = 0.0

    def step(self, pose: Pose, torque: Torque | None, *, dt: float) -> Friction:
        self.way += pose.velocity[0] * dt
        return Friction(
            force=[self.coefficient * v for v in pose.velocity],
            bristle=(self.way, 0, 0),
            stick=torque is None,
        )


class Quiet(Node):
    """Sends only one message, at the first step."""

    mute: Annotated[bool, "1"] = False

    def start(self) -> None:
        self.count = 0

    def step(self, pose: Pose) -> Force:
        self.count += 1
        if self.mute or self.count > 1:
            return None
        return Force(force=pose.velocity, state="free", energy=0.0)


def pose(speed: float, tick: int = -1) -> Pose:
    return Pose(position=(0, 0, 0), velocity=(speed, 0, 0), dt=1e-3, tick=tick)


def test_ports_and_settings_come_from_the_class():
    first, second = inputs(Drag)
    assert (first.name, first.type, first.optional) == ("pose", Pose, False)
    assert (second.name, second.type, second.optional) == ("torque", Torque, True)
    assert outputs(Drag) == (Friction,)
    assert settings(Drag)["coefficient"].unit == "N s/m"


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"coeficient": 1.0}, "'coeficient': unknown. Settings: coefficient, label"),
        ({"coefficient": "much"}, "'coefficient' .N s/m.: found 'much'"),
        ({"coefficient": -1.0}, ">= 0"),
    ],
)
def test_a_wrong_setting_is_an_error_with_its_name(given, text):
    with pytest.raises(SettingError, match=text):
        Drag(**given)


def test_a_wrong_word_is_refused_with_the_words_that_are_valid():
    with pytest.raises(SettingError, match=r"found 'bases'.*; expected uniform or basis"):
        MassSpring(stiffness_map="bases")


def test_the_bus_runs_a_step_for_each_driving_message():
    bus = FakeBus(Drag(coefficient=3.0))
    first, second = bus.publish(pose(1.0), pose(2.0))
    assert first.force[0] == 3.0 and second.force[0] == 6.0
    assert (second.tick, second.time, second.used) == (1, 1_000_000, (1, -1))
    assert second.bristle[0] == approx(3e-3)


def test_faults_of_messages_are_simulated():
    bus = FakeBus(Drag(), torque=Torque(torques=(0, 0, 0)))
    bus.drop(2)
    assert bus.publish(pose(1), pose(1)) == []
    (after,) = bus.publish(pose(1))
    assert after.tick == 2
    bus.twice()
    assert [m.tick for m in bus.publish(pose(1))] == [3, 3]
    bus.swap()
    assert [m.tick for m in bus.publish(pose(1), pose(1))] == [5, 4]
    bus.late(0.02)
    (late,) = bus.publish(pose(1))
    assert late.time == 26_000_000
    assert not late.stick
    assert bus.publish(pose(5))[0].force == late.force  # its time is before that of the late one
    bus.kill("torque")
    (orphan,) = bus.publish(pose(1, tick=30))
    assert orphan.stick and orphan.used == (30, -1)


def test_a_repeated_or_late_message_repeats_the_last_output():
    bus, other = FakeBus(Drag()), FakeBus(Drag())
    bus.twice()
    first, again = bus.publish(pose(1.0))
    assert again == first
    bus.swap()
    newer, older = bus.publish(pose(2.0), pose(3.0))
    assert older.force == newer.force == (6.0, 0.0, 0.0) and (newer.tick, older.tick) == (2, 1)
    (after,) = bus.publish(pose(4.0))
    assert after.bristle == other.publish(pose(1.0), pose(3.0, tick=2), pose(4.0, tick=3))[-1].bristle


def test_a_step_without_output_repeats_the_last_one_as_in_a_run():
    bus = FakeBus(Quiet())
    first, second = bus.publish(pose(1.0), pose(2.0))
    assert second.force == first.force == (1.0, 0.0, 0.0) and (second.tick, second.used) == (1, (1,))
    with pytest.raises(TypeError, match="answered None before it had sent a message, expected a Force"):
        FakeBus(Quiet(mute=True)).publish(pose(1.0))


def test_base_classes_are_not_listed():
    assert not {Node, Carrier} & {entry.cls for entry in catalogue()[0]}


@pytest.mark.parametrize("use", [entry.use for entry in catalogue()[0]])
def test_every_default_is_within_its_limits(use):
    for setting in settings(find_class(use)).values():
        if setting.default is not ...:
            convert(setting, setting.default)


@pytest.mark.parametrize("entry", catalogue()[0], ids=lambda entry: entry.use)
def test_a_node_that_never_started_has_no_notes_and_can_be_stopped(entry):
    """A run that fails before its start collects the notes of all its nodes, and stops them."""
    missing = {name: one for name, one in settings(entry.cls).items() if one.default is ...}
    given = {"tuple": ("x",), "float": 1.0}  # else a word
    node = entry.cls(
        **{
            name: next((value for kind, value in given.items() if kind in str(one.type)), "x")
            for name, one in missing.items()
        }
    )
    assert (node.notes(), node.condition(), node.stop(), node.notes()) == ([], "", None, [])
