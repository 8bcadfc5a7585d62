"""The contract of all device nodes, each tested with its emulator."""

import re
import time
from types import SimpleNamespace

import pytest

from palpate.drivers import connected
from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.errors import DeviceError
from palpate.drivers.haply import inverse3
from palpate.drivers.hid import raw
from palpate.drivers.limits import LIMITS
from palpate.launch.load.launchfile import find
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, DeviceState, Force, Torque
from palpate.nodes.device import Falcon, Inverse3, RawHid
from palpate.nodes.sensor import NetFT

FORCE, TORQUE = Force(force=(0.0, 0.0, 1.0), state="contact", energy=0.0), Torque(torques=(0.02, 0.02, 0.02))
KINDS = {
    "falcon": (Falcon, {}, {"torque": TORQUE}),
    "rawhid": (RawHid, {}, {"force": FORCE}),
    "inverse3": (Inverse3, {}, {"force": FORCE}),
    "netft": (NetFT, {}, {}),
}
HAPTIC = ["falcon", "rawhid", "inverse3"]


@pytest.fixture
def made(request):
    """Creates a started node on a bus, and stops it after the test."""
    nodes = []

    def make(name, **settings):
        kind, given, held = KINDS[name]
        node = kind(port="emulator", **given, **settings)
        nodes.append(node)
        return node, FakeBus(node, **held)

    yield make
    for node in nodes:
        node.stop()


def run(bus, seconds, until=lambda message: False):
    """The last message after this running time of the machine [s], or the first for which `until` is true."""
    left, looked = seconds, time.monotonic()
    while left > 0.0:
        (message,) = bus.run(1)
        if until(message):
            return message
        time.sleep(0.001)
        moment = time.monotonic()
        left, looked = left - min(moment - looked, 0.05), moment
    return message


@pytest.mark.parametrize("name", KINDS)
def test_a_node_answers_and_never_blocks_the_loop(name, made):
    node, bus = made(name)
    run(bus, 3.0, lambda m: node.exchange.answers > 20)
    assert node.exchange.answers > 20
    begun = time.thread_time()
    messages = bus.run(300)
    assert time.thread_time() - begun < 0.3, "1 ms of processor time per step, FakeBus included"
    assert all(isinstance(m, DeviceState | Contact) for m in messages)
    assert type(node).hardware and type(node).sink


INFO = raw.pack(raw.Info(0, 3, (1e-5,) * 6, (1e-3,) * 6))
FIRST = '{"inverse3": [{"device_id": "A1"}]}'


@pytest.mark.parametrize(
    ("module", "driver", "answer", "late"),
    [(raw, raw.RawHidDriver, INFO, 8), (inverse3, inverse3.Inverse3Driver, FIRST, 1)],
    ids=["rawhid", "inverse3"],
)
def test_a_request_is_repeated_after_a_stall_as_long_as_the_timeout(monkeypatch, module, driver, answer, late):
    """The answer arrives after the stall."""
    clock, answers = [0.0], iter([type(answer)()] * late)

    def read(*_):
        clock[0] += 5.0
        return next(answers, answer)

    for where in (module, connected):
        monkeypatch.setattr(where, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    driver(lambda: SimpleNamespace(write=lambda _: None, read=read)).open()


@pytest.mark.parametrize("name", HAPTIC)
def test_the_force_ramps_up_after_homing(name, made):
    node, bus = made(name, ramp=0.3)
    state = bus.run(1)[0]
    assert node.exchange.guard.gain < 0.5
    if not state.homed:
        assert state.joints == () and state.position == ()
    run(bus, 5.0, lambda m: node.exchange.guard.gain == 1.0)
    assert node.exchange.guard.gain == 1.0
    assert bus.run(1)[0].homed


@pytest.mark.parametrize("name", HAPTIC)
def test_a_silent_device_gets_no_force(name, made):
    node, bus = made(name, ramp=0.0, faults=EmulatedFaults(silent=2.0))
    run(bus, 6.0, lambda m: node.exchange.guard.gain == 1.0)
    assert node.exchange.guard.gain == 1.0
    run(bus, 10.0, lambda m: node.exchange.guard.missed > 10 and node.exchange.guard.gain == 0.0)
    assert node.exchange.guard.why(time.monotonic_ns(), time.monotonic_ns()) == "answers are missing"


@pytest.mark.parametrize("reconnect", [False, True])
@pytest.mark.parametrize("name", KINDS)
def test_a_silent_device_is_an_error_with_its_name(name, reconnect):
    """With `reconnect` too, if it stays silent until the end."""
    kind, given, held = KINDS[name]
    node = kind(port="emulator", reconnect=reconnect, faults=EmulatedFaults(silent=0.3), **given)
    called = rf"DeviceError: the {node.driver().name} does not answer any more: .* [\d.]+ s\. Check"
    bus, notes = FakeBus(node, **held), []

    def answers():
        bus.run(1)
        notes.extend(node.notes())
        return not any("does not answer any more" in note for note in notes)

    try:
        with pytest.raises(Exception) as reported:
            for _ in range(20_000):
                if not answers():
                    break
                time.sleep(0.001)
            assert reconnect
            node.stop()
    finally:
        node.stop()
    text = str(reported.value) if ": DeviceError" in str(reported.value) else f"DeviceError: {reported.value}"
    assert re.search(called, text)
    assert not any("rate" in note for note in notes)


def test_a_silent_device_that_answers_again_is_used_again(made):
    node, bus = made("inverse3", reconnect=True, faults=EmulatedFaults(silent=0.3, back=1.5))
    notes: list[str] = []
    run(bus, 15.0, lambda _: notes.extend(node.notes()) or "The device is back." in notes)
    assert "does not answer any more" in notes[0] and notes[1] == "The device is back."
    assert run(bus, 3.0, lambda m: m.homed).homed


@pytest.mark.parametrize("name", HAPTIC)
def test_a_released_dead_man_button_gives_no_force(name, made):
    node, bus = made(name, ramp=0.0, deadman=0x8000)
    assert run(bus, 30.0, lambda m: m.homed).homed, "from here on only the button blocks the force"
    answers = node.exchange.answers
    run(bus, 30.0, lambda m: node.exchange.answers > answers + 20)
    assert node.exchange.answers > answers + 20 and node.exchange.guard.gain == 0.0


@pytest.mark.parametrize("name", [n for n in KINDS if n != "netft"])  # UDP does not detect a pulled plug
def test_a_pulled_plug_is_an_error_of_one_line(name, made):
    _, bus = made(name, faults=EmulatedFaults(unplug=0.3))
    with pytest.raises(DeviceError, match=r"gone.*(Plug it in|Start it) again") as reported:
        run(bus, 8.0)
    assert reported.value.lost and "\n" not in str(reported.value)


@pytest.mark.parametrize("name", ["falcon", "rawhid"])
def test_a_reconnected_device_is_used_again(name, made):
    node, bus = made(name, reconnect=True, faults=EmulatedFaults(unplug=0.3, back=0.9))
    notes: list[str] = []

    def back(_):
        notes.extend(node.notes())
        return "The device is back." in notes

    run(bus, 15.0, back)
    assert "The device is back." in notes and "gone" in notes[0]
    before = node.exchange.answers
    run(bus, 3.0, lambda m: node.exchange.answers > before + 10)
    assert node.exchange.answers > before + 10


@pytest.mark.parametrize("name", KINDS)
def test_stopping_sends_zero_force_at_any_time(name):
    kind, given, _ = KINDS[name]
    node = kind(port="emulator", **given)
    node.stop()
    node.start()
    node.stop()
    node.stop()
    assert node.exchange._thread is None


def test_a_device_slower_than_the_graph_is_reported_once(made):
    node, bus = made("inverse3", faults=EmulatedFaults(latency=0.0015))
    run(bus, 30.0, lambda m: node.steps > 2000 and node.exchange.rate > 0.0)
    (note,) = node.notes()
    assert re.match(r"the device answers \d+ times a second, the graph asks 1000 times: .*`rate: \d+`", note)
    run(bus, 0.1)
    assert node.notes() == []


@pytest.mark.parametrize(("graph", "names"), [("falcon", ["falcon"]), ("cartesian", HAPTIC[1:])])
def test_the_graphs_have_the_delay_of_their_devices(graph, names):
    plan = find(graph).plan()
    controller = plan.make("controller")
    assert controller.passivity and controller.delay >= max(LIMITS[name].delay for name in names)
