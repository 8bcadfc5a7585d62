"""A device or service that floods the host: commands continue, the newest state counts, and old ones are ignored."""

import json

import pytest

from palpate.drivers.guard import Guard
from palpate.drivers.haply import inverse3
from palpate.drivers.hid import raw
from palpate.drivers.sensors import netft
from palpate.drivers.transport.burst import MOST

MS = 1_000_000


def state(x: float) -> str:
    """A message of the Inverse service with the cursor at x [m]."""
    place = {"x": x, "y": 0.0, "z": 0.1}
    return json.dumps({"inverse3": [{"device_id": "A", "state": {"cursor_position": place}}]})


def sampled(number: int) -> bytes:
    """A sample of a Net F/T: `number` counts along x."""
    return netft.SAMPLE.pack(number, number, 0, number, 0, 0, 0, 0, 0)


def at(number: int) -> bytes:
    """A state of a raw-HID device: `number` counts along x."""
    return raw.pack(raw.RawState(number, 0, raw.HOMED, 3, 0, (number, 0, 0, 0, 0, 0), 0))


class Far:
    """The peer of a connection. `waiting`: data already sent; `flood`: makes the data that it sends continuously."""

    def __init__(self, waiting=(), flood=None):
        self.waiting, self.flood, self.reads, self.sent = list(waiting), flood, 0, 0

    def write(self, data):
        self.sent += 1

    def read(self, *given):
        self.reads += 1
        if self.flood is not None:
            assert self.reads < 100 * MOST, "the driver reads the whole backlog"
            return self.flood(self.reads)
        return self.waiting.pop(0) if self.waiting else ""

    def close(self):
        pass


def service(far):
    driver = inverse3.Inverse3Driver(lambda: far)
    far.waiting.insert(0, state(0.0))
    flood, far.flood = far.flood, None
    driver.open()
    far.flood = flood
    return driver


def sensor(far):
    driver = netft.NetFTDriver("nowhere")
    driver.port, driver.scale, driver.asked = far, netft.Scale(1.0, 1.0), 0.0
    return driver


def board(far):
    driver = raw.RawHidDriver(lambda: far)
    driver.begin()
    driver.port = far
    driver.info = raw.Info(0, 3, (1.0,) * 6, (1.0,) * 6)
    return driver


KINDS = {
    "inverse3": (service, state),
    "netft": (sensor, sampled),
    "rawhid": (board, at),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_flood_does_not_block_a_cycle(name):
    make, flood = KINDS[name]
    far = Far(flood=flood)
    driver = make(far)
    for _ in range(5):
        driver.cycle((0.0,) * driver.size)


@pytest.mark.parametrize(
    ("make", "waiting", "newest"),
    [
        (service, [state(float(i)) for i in range(5)], lambda s: s.position[0] == 4.0),
        (sensor, [*(sampled(i) for i in range(5)), b"foreign"], lambda s: s.wrench[0] == 4.0),
        (board, [at(1), at(2), at(3), b"rubbish"], lambda s: s.position[0] == 3.0),
    ],
    ids=["inverse3", "netft", "rawhid"],
)
def test_of_several_states_the_newest_counts(make, waiting, newest):
    driver = make(Far())
    driver.port.waiting += waiting
    assert newest(driver.cycle((0.0,) * driver.size))


def test_an_earlier_state_is_not_a_new_one():
    driver = board(Far([at(1)]))
    assert driver.cycle((0.0,) * 3) is not None
    driver.port.waiting.append(at(1))
    assert driver.cycle((0.0,) * 3) is None


def test_states_of_a_flood_are_stale_until_the_backlog_is_read():
    driver = service(Far(flood=state))
    assert [driver.cycle((0.0,) * 3) for _ in range(3)] == [None] * 3
    far, answers = driver.port, []
    far.flood = None
    for i in range(inverse3.CALM + 2):
        far.waiting.append(state(float(i)))
        answers.append(driver.cycle((0.0,) * 3))
    first = next(i for i, sample in enumerate(answers) if sample is not None)
    assert 0 < first <= inverse3.CALM and None not in answers[first:]
    assert answers[-1].position[0] == inverse3.CALM + 1


def test_in_a_flood_the_force_goes_to_zero_and_commands_continue():
    driver = service(Far())
    guard, far, now, sent = Guard(driver.limits, ramp=0.0), driver.port, 0, []
    for k in range(1, 60):
        now = k * MS
        command = guard.apply((1.0, 0.0, 0.0), now, now)
        sent.append(command[0])
        if k == 20:
            far.flood = state
        far.waiting.append(state(0.0))
        sample = driver.cycle(command)
        guard.note_answer(None if sample is None else sample._replace(time=now))
    assert sent[15] == 1.0 and sent[-1] == 0.0
    assert far.sent == 59
