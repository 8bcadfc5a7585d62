"""transport.Delay on any edge: arrival times, types in the loader, replay, placement; and a hand that touches an organ
over a poor network."""

import numpy as np
import pytest

from palpate.engine.faults import GraphError
from palpate.engine.imports import UntrustedError, full_name, load_class, recorded_class
from palpate.launch.load.arguments import describe_run
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Force, Pose, Surface
from palpate.nodes.base import Node, SettingError, inputs, outputs
from palpate.nodes.transport import Delay
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.stepping import Stepper

REMOTE = ("scene.network.delay=10 ms", "scene.network.jitter=5 ms", "scene.network.loss=0.2", "controller.delay=20")


def _long(*given: float):
    return pytest.param(*given, marks=pytest.mark.long)


def arrived(count, **settings):
    """Number of the message that is forwarded at each tick, counted from 0."""
    bus = FakeBus(Delay.of(Pose)(**settings))
    still = {"velocity": (0, 0, 0), "dt": 1e-3}
    sent = (Pose(position=(1e-3 * k, 0, 0), **still) for k in range(count))
    return [round(1e3 * p.position[0]) for p in bus.publish(*sent)]


def test_messages_are_delayed_and_the_first_one_is_used_until_then():
    assert arrived(8, delay=3e-3) == [0, 0, 0, 0, 1, 2, 3, 4]
    assert arrived(8, delay=2.5e-3) == [0, 0, 0, 0, 1, 2, 3, 4]
    assert arrived(4) == [0, 1, 2, 3]


def test_with_jitter_delays_are_uniform_and_messages_stay_in_order():
    came = np.array(arrived(6000, delay=40e-3, jitter=20e-3, seed=3))
    assert (np.diff(came) >= 0).all()
    age = np.arange(6000)[100:] - came[100:]
    assert 20 <= age.min() <= 22
    # Older than a if no message sent up to a ticks ago has arrived, each with the probability (j - 20)/40.
    older = np.cumprod(1.0 - np.clip((np.arange(61) - 20.0) / 40.0, 0.0, 1.0))
    assert age.mean() == pytest.approx(older.sum(), abs=0.4)
    assert (age > 30).mean() == pytest.approx(older[30], abs=0.05)


def test_the_lost_fraction_is_the_probability_and_the_last_message_is_held():
    came = np.array(arrived(4000, loss=0.3, seed=1))
    lost = came != np.arange(4000)
    assert lost.mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.3 * 0.7 / 4000))
    assert (came[1:][lost[1:]] == came[:-1][lost[1:]]).all()
    assert arrived(200, loss=1.0) == [0] * 200


def test_losses_depend_on_the_seed():
    one, again, other = (arrived(500, delay=5e-3, jitter=5e-3, loss=0.1, seed=seed) for seed in (4, 4, 5))
    assert one == again != other


@pytest.mark.parametrize(
    ("sets", "samples"),
    [
        ((), None),
        (("rate=500",), None),
        (("rate=5000",), 200),
        (("scene.network.delay=100 ms",), 200),
        (("scene.network.delay=10 ms", "scene.network.jitter=10 ms", "controller.delay=20"), 40),
        (("controller.delay=0", "controller.passivity=false"), None),
    ],
)
def test_a_controller_with_too_short_a_delay_is_reported(sets, samples):
    """At 5 kHz the 40 samples of the graph are 8 ms, and the force on a held finger oscillated by 0.7 N."""
    notes = [note for note in load("remote", overrides=sets).notes if "network" in note]
    assert len(notes) == (samples is not None)
    assert samples is None or f"--set controller.delay={samples}`" in notes[0]
    assert load("remote", overrides=(*sets, "controller.delay=400")).notes == ()


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"delay": -1e-3}, "'delay'.*-0.001.*>= 0"),
        ({"loss": 1.01}, "'loss'.*1.01.*<= 1"),
        ({"loss": -0.1}, "'loss'.*>= 0"),
        ({"delay": 1e-3, "jitter": 2e-3}, "'jitter'.*0.002, expected at most the delay, 0.001"),
        ({"delay": float("nan")}, "'delay'"),
        ({"delay": 1e9}, "'delay'.*<= 60"),
        ({"seed": -1}, "'seed'"),
    ],
)
def test_impossible_network_settings_are_errors(settings, text):
    with pytest.raises(SettingError, match=text):
        Delay.of(Pose)(**settings)


@pytest.mark.parametrize("kind", [Contact, Force, Pose, Surface])
def test_the_class_of_a_type_is_found_by_its_name(kind):
    cls = Delay.of(kind)
    assert inputs(cls)[0].type is kind
    assert outputs(cls) == (kind,)
    assert load_class(full_name(cls), Node) is cls is recorded_class(full_name(cls), Node)


def test_a_recording_imports_no_code_for_the_type_of_a_message():
    with pytest.raises(UntrustedError, match="'evil'"):
        recorded_class("palpate.nodes.transport.Delay[evil.code.Message]", Node)


def test_the_type_is_that_of_the_sender_through_a_chain_of_delays(write):
    path = write(
        "g.yaml",
        """\
        extends: kidney
        nodes:
          second:    {use: transport.Delay, in: {message: {from: first}}}
          first:     {use: transport.Delay, delay: 1 ms, in: {message: finger}}
          law:       {use: transport.Delay, delay: 1 ms, in: {message: tissue}}
          load:      {use: transport.Delay, delay: 1 ms, in: {message: spread}}
          collision: {use: collision.Nurbs, in: {pose: second}, with: [$surface, $finger]}
          contact:   {use: contact.Series, in: {proximity: collision, body: law}, with: $finger}
          tissue:    {use: deformation.MassSpring, in: {load: load}, with: [$surface, $tissue]}
        """,
    )
    graph = load(path)
    assert graph.streams["second"] is Pose
    assert graph.streams["law"] is Surface


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("d: {use: transport.Delay, in: {message: contact}}", "expects Pose, but 'd' sends Contact"),
        ("d: {use: transport.Delay, in: {message: d}}", "forwards only its own messages: d -> d"),
        ("d: {use: transport.Delay, in: {message: e}}\n  e: {use: transport.Delay, in: {message: d}}", "d -> e -> d"),
        ("d: {use: transport.Delay, in: {message: fingr}}", "no node 'fingr'(.|\n)*Did you mean 'finger'"),
        ("d: {use: transport.Delay, in: {mesage: finger}}", "'mesage': unknown(.|\n)*Did you mean 'message'"),
        ("d: {use: transport.Delay}", "input, which drives the node, has no sender"),
        ("d: {use: transport.Delay, delay: 1 ms, jitter: 1 s, in: {message: finger}}", "at most the delay"),
        ("d: {use: transport.Delay, delay: 1 N, in: {message: finger}}", "a force; expected a time"),
    ],
)
def test_wiring_faults_are_errors(line, text, write):
    collision = "collision: {use: collision.Nurbs, in: {pose: d}, with: [$surface, $finger]}"
    with pytest.raises(GraphError, match=text):
        find(str(write("g.yaml", f"extends: kidney\nnodes:\n  {line}\n  {collision}\n"))).load()


def test_placement_changes_no_byte_and_a_replay_computes_the_same(tmp_path):
    files = {}
    for place in ("fused", None):
        files[place] = tmp_path / f"{place}.mcap"
        launch = find("remote").but(record=files[place], place=place, duration=0.3, overrides=REMOTE)
        assert execute(launch).result.ok
    one, other = (Recording(file) for file in files.values())
    for stream in ("there", "back", "controller"):
        assert [*one.payloads(stream)] == [*other.payloads(stream)]
    assert verify(one, plan_of(one)).ok
    tick = one.columns("there")
    assert len(np.unique(tick["position"], axis=0)) < 0.95 * len(np.unique(one.columns("finger")["position"], axis=0))


def test_a_custom_message_is_forwarded(tmp_path, write, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(
        "ownlab_delay.py",
        """\
        from typing import Annotated
        from palpate.messages import Message
        from palpate.nodes.base import Node

        class Temperature(Message):
            kelvin: Annotated[float, "K"]

        class Probe(Node):
            paced = True
            def start(self): self.n = 0
            def step(self, *, dt: float) -> Temperature:
                self.n += 1
                return Temperature(kelvin=float(self.n))

        class Seen(Node):
            def step(self, temperature: Temperature) -> Temperature:
                return Temperature(kelvin=-temperature.kelvin)
        """,
    )
    graph = write(
        "own.yaml",
        """\
        nodes:
          probe: {use: ownlab_delay.Probe}
          late:  {use: transport.Delay, delay: 4 ms, in: {message: probe}}
          seen:  {use: ownlab_delay.Seen, in: {temperature: late}}
          log:   {use: logger.Mcap, in: all}
        """,
    )
    launch = find(str(graph)).but(record=tmp_path / "own.mcap", duration=0.02, clock="simulated")
    assert execute(launch).result.ok
    recording = Recording(tmp_path / "own.mcap")
    assert recording.columns("seen")["kelvin"].tolist() == [-1.0] * 5 + [-float(k) for k in range(2, 17)]
    assert verify(recording, plan_of(recording)).ok


# -- a hand that touches an organ over a poor network -----------------------------------------------------------------


def felt(delay, jitter, loss, known=True, passivity=True, drag=2.0):
    """Energy [J] generated by the display, alone and beyond the dissipation of the drag [N s/m]; oscillation [m] of the
    grip while the hand is still, forces on the hand [N] (k,3), and the range of the contact force [N]."""
    sets = [f"scene.network.delay={delay}", f"scene.network.jitter={jitter}", f"scene.network.loss={loss}"]
    sets += [f"controller.delay={round(2e3 * delay) if known else 0}", f"controller.passivity={str(passivity).lower()}"]
    launch = describe_run("remote", scene=None, duration=None, sets=[*sets, f"controller.drag={drag}"], nodes={})
    stepper = Stepper(launch)
    stepper.start()
    device = stepper.node("device")
    force, place = [], []
    for _ in range(3000):
        force.append(stepper.tick().controller.force)
        place.append(device.own["motion"]["position"].copy())
    stepper.stop()
    force, moved = np.array(force), np.diff(place, axis=0)
    work = -np.cumsum((force[:-1] * moved).sum(axis=1))
    dragged = np.cumsum(drag * (moved * moved).sum(axis=1) / 1e-3)
    return -work.min(), -(work + dragged).min(), np.ptp(np.array(place)[1500:2000, 2]), force


@pytest.mark.parametrize(
    ("delay", "jitter", "loss"),
    [_long(0.1, 0.0, 0.2), (0.1, 0.05, 0.9), (0.1, 0.1, 0.3), _long(0.02, 0.02, 0.3)],
)
def test_over_100_ms_with_losses_the_hand_comes_to_rest_without_injected_energy(delay, jitter, loss):
    generated, beyond, swing, force = felt(delay, jitter, loss)
    assert beyond < 1e-6
    assert generated < 2e-3
    assert swing < 0.1e-3
    assert 0.0 < np.abs(force).max() < 9.0
    assert np.abs(np.diff(force, axis=0)).max() <= 5.0 + 1e-9


@pytest.mark.parametrize("delay", [_long(0.005), 0.02, _long(0.1)])
def test_with_the_drag_of_the_device_alone_the_display_generates_nothing(delay):
    generated, *_ = felt(delay, 0.0, 0.0, drag=0.2)
    assert generated < 1e-6


def test_a_controller_without_the_delay_is_not_passive():
    """Shows why the graph sets the delay, and that the tests above can fail."""
    bare, *_ = felt(0.02, 0.0, 0.0, passivity=False)
    unknown, *_ = felt(0.02, 0.0, 0.0, known=False)
    assert bare > 0.05
    assert 0.01 < unknown < bare
