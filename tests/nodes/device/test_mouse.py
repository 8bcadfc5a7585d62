"""A pointer of another program, and the hand that follows it."""

import contextlib
import math
import socket
import threading

import msgspec
import numpy as np
import pytest
from falcon_arrays import forward, torque
from graphs_for_runs import until_it_has
from pytest import approx
from scipy.integrate import solve_ivp

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Force, Pointed, Torque
from palpate.nodes.base import SettingError
from palpate.nodes.device import Mouse, Pointer
from palpate.records.changed import change_plan
from palpate.records.reader import Recording
from palpate.records.verify import verify

BEGIN = (0.0, 0.0, 0.116)
AIM = (0.01, -0.005, 0.105)
T = 1e-3


def send(path, data: bytes) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as outlet:
        outlet.sendto(data, str(path))


@pytest.fixture
def pointer(tmp_path):
    node = Pointer(socket=str(tmp_path / "pointer"), begin=BEGIN)
    node.start()
    yield node
    node.stop()


def test_a_pointer_sends_its_start_and_then_the_newest_sample(pointer):
    assert pointer.step(dt=T) == Pointed(position=BEGIN)
    for number in (1, 2, 3):
        send(pointer.socket, msgspec.msgpack.encode([number, [0.0, 0.0, 0.1 * number], 1]))
    newest = pointer.step(dt=T)
    assert (newest.sample, newest.buttons) == (3, 1)
    assert newest.position == approx((0.0, 0.0, 0.3))
    assert pointer.step(dt=T).sample == 3


@pytest.mark.parametrize(
    "data",
    [b"", b"\xff", *(msgspec.msgpack.encode([1, [0.0, x, 0.0]]) for x in (math.nan, -math.inf, 1e23)), b"x" * 2000],
)
def test_invalid_samples_are_dropped_reported_once_and_counted(pointer, data):
    notes = []
    for _ in range(20):
        send(pointer.socket, data)
        assert pointer.step(dt=T).position == BEGIN
        notes += pointer.notes()
    assert [note.partition(",")[0] for note in notes] == ["the pointer's socket: 1 dropped"]
    pointer.stop()
    (note,) = pointer.notes() + pointer.notes()
    assert note.startswith("the pointer's socket: 20 dropped")


def test_valid_samples_are_not_reported(pointer):
    send(pointer.socket, msgspec.msgpack.encode([1, [0.0, 0.0, 0.1], 0]))
    pointer.step(dt=T)
    pointer.stop()
    assert pointer.notes() == []


def test_a_socket_that_cannot_be_created_is_an_error(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    for path in (tmp_path / "notes.txt", tmp_path / "none" / "pointer", tmp_path / ("x" * 120)):
        with pytest.raises(SettingError, match="socket"):
            Pointer(socket=str(path)).start()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_the_hand_follows_its_equations():
    """Two linear equations, solved separately; the target is linear over each step, with an error of T^2."""
    node = Mouse(begin=BEGIN, speed=2.0, resolution=0.0)
    bus = FakeBus(node)
    ways = [bus.publish(Pointed(position=AIM))[0].position for _ in range(80)]

    def motion(_, state):
        x, v, p = state[:3], state[3:6], state[6:]
        rate = (np.array(AIM) - p) / node.lag
        pull = node.hand_stiffness * (p - x) + node.hand_damping * (rate - v) - node.damping * v
        return np.concatenate([v, pull / node.mass, rate])

    exact = solve_ivp(motion, (0, 80 * T), [*BEGIN, 0, 0, 0, *BEGIN], rtol=1e-10, atol=1e-13).y[:3, -1]
    assert np.abs(np.array(ways[-1]) - exact).max() < 2e-6


def test_a_pointer_that_jumps_moves_the_goal_at_the_speed_of_a_hand():
    node = Mouse(begin=BEGIN, speed=0.1)
    bus = FakeBus(node)
    bus.publish(Pointed(position=BEGIN))
    before = node.own["goal"].copy()
    bus.publish(Pointed(position=(1e6, 0.0, 0.116)))
    assert np.linalg.norm(node.own["goal"] - before) == approx(0.1 * T)


@pytest.mark.parametrize("kind", ["force", "torque"])
def test_a_force_moves_the_arm_by_force_over_stiffness(kind):
    node = Mouse(begin=BEGIN, hand_stiffness=400.0, hand_damping=15.0, resolution=0.0)
    push = np.array([0.0, 0.3, 2.0])
    bus = FakeBus(node)
    (state,) = bus.publish(Pointed(position=BEGIN))
    for _ in range(600):
        if kind == "force":
            bus.hold("force", Force(force=tuple(push.tolist()), state="contact", energy=0.0))
        else:
            bus.hold("torque", Torque(torques=tuple(torque(push, state.position)[0].tolist())))
        (state,) = bus.publish(Pointed(position=BEGIN))
    assert np.array(state.position) - BEGIN == approx(push / 400.0, abs=1e-6)
    assert forward(state.joints)[0] == approx(state.position, abs=1e-9)


def test_out_of_reach_the_grip_stops_and_stays_finite():
    bus = FakeBus(Mouse(begin=BEGIN))
    for _ in range(2000):
        (state,) = bus.publish(Pointed(position=(5.0, -7.0, 1e3)))
    assert forward(state.joints)[1]
    assert np.isfinite([*state.joints, *state.position]).all()
    with pytest.raises(SettingError, match="begin"):
        Mouse(begin=(1.0, 0.0, 0.0)).start()


def test_a_steered_touch_replays_bit_for_bit(tmp_path):
    """A whole graph on the real clock, steered by another program during the run; the replay includes the hand."""
    inlet, record = tmp_path / "pointer", tmp_path / "touch.mcap"
    graph = tmp_path / "touch.yaml"
    graph.write_text(f"""extends: kidney
nodes:
  pointer: {{use: device.Pointer, socket: {inlet}, begin: [0, 0, 0.112]}}
  device:  {{use: device.Mouse, in: {{pointer: pointer, torque: statics}}, with: $hand}}
""")
    ended = threading.Event()

    def steer() -> None:
        number = 0
        while not ended.wait(0.005):
            number += 1
            with contextlib.suppress(OSError):
                send(inlet, msgspec.msgpack.encode([number, [1e-4 * (number % 50), 0.0, 0.100]]))

    thread = threading.Thread(target=steer)
    thread.start()
    try:
        outcome = execute(
            LaunchFile(graph=graph, clock="real", record=record), watch=until_it_has(contact=("steps", 900))
        )
    finally:
        ended.set()
        thread.join()
    assert outcome.result.ok, outcome.result.deaths
    recording = Recording(record)
    report = verify(recording, change_plan(recording))
    assert report.ok
    assert report.complete
    assert report.nodes["device"].checked > 100
    assert max(message.sample for message in recording.messages("pointer")) > 10
    assert max(message.force for message in recording.messages("contact")) > 0.1
