"""The thread that communicates with a device never blocks the loop, and ends with zero force."""

import itertools
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

from palpate.drivers.errors import DeviceError
from palpate.drivers.exchange import Exchange
from palpate.drivers.guard import HORIZON, DeviceSample, Guard
from palpate.drivers.limits import Limits


class Slow:
    """A driver with slow, failing or missing answers."""

    name = "slow thing"
    limits = Limits(command=5.0, power=100.0, speed=10.0, ramp=0.01)
    size = 1

    def __init__(self):
        self.sent, self.opened, self.closed = [], 0, 0
        self.pause, self.answers, self.error = 0.001, True, None
        self.refused = 0

    def open(self):
        if self.refused:
            self.refused -= 1
            raise DeviceError("no such device")
        self.opened += 1
        self.begins = len(self.sent)

    def cycle(self, command):
        if self.error is not None:
            error, self.error = self.error, None
            raise error
        self.sent.append((time.monotonic(), command[0]))
        time.sleep(self.pause)
        return DeviceSample(time.monotonic_ns(), position=(0.0, 0.0, 0.0)) if self.answers else None

    def close(self):
        self.closed += 1


def until(condition, seconds=5.0):
    for _ in range(round(seconds / 0.002)):
        if condition():
            return
        time.sleep(0.002)
    raise AssertionError("the condition did not become true")


@pytest.fixture
def pair():
    driver = Slow()
    exchange = Exchange(driver, Guard(driver.limits))
    exchange.start()
    yield driver, exchange
    exchange.stop()


def press(driver, exchange):
    def pressed():
        exchange.command((2.0,))
        return driver.sent and driver.sent[-1][1] == 2.0

    until(pressed)


def test_a_slow_device_does_not_block_the_loop(pair):
    driver, exchange = pair
    until(lambda: exchange.answers > 3)
    driver.pause, count = 0.5, len(driver.sent)
    until(lambda: len(driver.sent) > count)  # in a slow cycle
    begun = time.thread_time()
    for _ in range(1000):
        exchange.command((1.0,))
        exchange.sample()
    assert time.thread_time() - begun < 0.05
    assert exchange.answers < 1000


def test_the_force_goes_to_zero_when_the_loop_dies(pair):
    driver, exchange = pair
    press(driver, exchange)
    until(lambda: driver.sent[-1][1] == 0.0)
    sent = [c for _, c in driver.sent]
    pressed = sent.index(2.0)
    assert 0.0 in sent[pressed : pressed + 500]  # after 25 ms, in cycles of at least 1 ms


def test_the_force_goes_to_zero_when_answers_are_missing(pair):
    driver, exchange = pair
    press(driver, exchange)
    driver.answers = False

    def gone():
        exchange.command((2.0,))
        return driver.sent[-1][1] == 0.0

    until(gone)


def test_stopping_commands_zero_and_closes(pair):
    driver, exchange = pair
    press(driver, exchange)
    exchange.stop()
    assert [c for _, c in driver.sent[-3:]] == [0.0, 0.0, 0.0] and driver.closed == 1


def test_the_force_fades_when_the_exchange_stops(pair):
    driver, exchange = pair
    press(driver, exchange)
    exchange.stop()
    sent = [c for _, c in driver.sent]
    falls = sent[max(i for i, c in enumerate(sent) if c == 2.0) :]
    assert len(falls) > 5 and all(b <= a for a, b in itertools.pairwise(falls)), "at least 4 commands within 15 ms"


def test_a_driver_that_fails_while_the_force_fades_still_gets_zero(pair):
    """As a device that reports a fault: the command has been sent when the driver raises."""
    driver, exchange = pair
    press(driver, exchange)
    cycle = driver.cycle

    def failing(command):
        answer = cycle(command)
        if any(command):
            raise DeviceError("the device reports a fault.")
        return answer

    driver.cycle = failing
    until(lambda: driver.closed)
    assert [c for _, c in driver.sent[-3:]] == [0.0, 0.0, 0.0]


def test_a_stall_during_the_stop_does_not_prevent_the_zero_command(pair):
    driver, exchange = pair
    press(driver, exchange)
    driver.pause = 0.1
    thread = exchange._thread
    waited = []

    def join(seconds):
        """The first wait ends before the thread can run."""
        waited.append(seconds)
        if len(waited) > 1:
            thread.join(seconds)

    exchange._thread = SimpleNamespace(join=join)
    exchange.stop()
    assert [c for _, c in driver.sent[-3:]] == [0.0, 0.0, 0.0] and driver.closed == 1
    assert sum(waited) == pytest.approx(2.0)


def test_a_lost_device_is_an_error(pair):
    driver, exchange = pair
    until(lambda: exchange.answers > 3)
    driver.error = DeviceError("the device is gone.", lost=True)

    def raised():
        try:
            exchange.sample()
        except DeviceError as error:
            return str(error) == "the device is gone."
        return False

    until(raised)
    until(lambda: driver.closed == 1)


def test_an_exception_of_the_driver_is_an_error_with_its_type(pair):
    driver, exchange = pair
    driver.error = ZeroDivisionError("by zero")
    until(lambda: driver.closed)
    with pytest.raises(DeviceError, match="the driver failed: ZeroDivisionError: by zero"):
        exchange.sample()


def test_a_lost_device_is_awaited_and_the_force_ramps_up_again():
    driver = Slow()
    exchange = Exchange(driver, Guard(driver.limits), reconnect=True)
    exchange.start()
    try:
        press(driver, exchange)
        driver.refused = 1
        driver.error = DeviceError("the device is gone.", lost=True)
        until(lambda: exchange._notes)
        assert not exchange.sample().homed
        until(lambda: driver.opened == 2)
        press(driver, exchange)
        assert driver.sent[driver.begins][1] == 0.0, "the force starts at zero"
        assert exchange.notes() == ["the device is gone. Waiting until it is back.", "The device is back."]
        assert exchange.notes() == []
    finally:
        exchange.stop()


def answered(driver, exchange, cycles, seconds, every=1):
    """Run the exchange for this number of cycles of `seconds` each on a simulated clock, with an answer in every
    `every`-th cycle (0: no answer)."""
    clock = [0.0]

    def cycle(command):
        number = len(driver.sent) + 1
        driver.sent.append((clock[0], command[0]))
        clock[0] += seconds(number) if callable(seconds) else seconds
        if number >= cycles:
            exchange._stop.set()
        if every and not number % every:
            return DeviceSample(round(clock[0] * 1e9) + 1, position=(0.0, 0.0, 0.0))
        return None

    driver.cycle = cycle
    time_ = SimpleNamespace(monotonic=lambda: clock[0], monotonic_ns=lambda: round(clock[0] * 1e9))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate.drivers.exchange.time", time_)
        exchange._talk()
    return clock[0]


def silent(silence=0.5):
    driver = Slow()
    driver.limits = replace(Slow.limits, silence=silence)
    return driver, Exchange(driver, Guard(driver.limits))


@pytest.mark.parametrize("silence", [0.5, 2.0])
def test_a_device_without_an_answer_for_longer_than_its_limit_is_lost(silence):
    driver, exchange = silent(silence)
    with pytest.raises(DeviceError, match=f"slow thing does not answer .* nothing came for {silence:g} s") as printed:
        answered(driver, exchange, 10_000, 0.004, every=0)
    assert printed.value.lost and driver.sent[-1][0] + 0.004 == pytest.approx(silence, abs=0.005)


def test_a_device_with_rare_answers_is_not_lost():
    answered(*silent(), 10_000, 0.004, every=100)


def test_a_stall_of_the_machine_does_not_count_as_silence():
    """A stall of 10 min in one cycle of 100; every 50th cycle has an answer."""
    answered(*silent(), 1000, lambda number: 600.0 if number % 100 == 7 else 0.001, every=50)


@pytest.mark.parametrize(("cycles", "expected"), [(5000, 500.0), (1300, 500.0)])
def test_an_outage_does_not_change_the_rate(cycles, expected):
    """An answer in each cycle of 2 ms, with outages of 0.3 s at different times of the averaging second."""
    driver, exchange = silent()
    answered(driver, exchange, cycles, lambda number: 0.3 if number % 620 == 0 else 0.002)
    assert exchange.rate == pytest.approx(expected, rel=0.01)


class Moving(Slow):
    """Its grip moves along x at 1 m/s."""

    def cycle(self, command):
        answer = super().cycle(command)
        return answer._replace(position=(answer.time * 1e-9, 0.0, 0.0))


def test_a_sample_is_extrapolated_and_none_exists_before_the_first_answer():
    driver = Moving()
    driver.pause = 0.1
    exchange = Exchange(driver, Guard(driver.limits))
    exchange.start()
    try:
        assert exchange.sample() is None
        until(lambda: exchange.answers > 1)

        def carried():
            sample = exchange.sample()
            return sample.position[0] - sample.time * 1e-9

        until(lambda: carried() == pytest.approx(HORIZON, abs=1e-6))
    finally:
        exchange.stop()


class Moved(Slow):
    """It returns at another position, with slow answers."""

    def open(self):
        super().open()
        self.x, self.pause = (0.0, 0.001) if self.opened == 1 else (0.1, 0.02)

    def cycle(self, command):
        answer = super().cycle(command)
        return answer._replace(position=(self.x, 0.0, 0.0))


def test_after_an_outage_rates_are_reset_and_the_force_ramps_up_from_zero():
    """No rate is computed across the outage, and the force ramps up although the loop has continued to command it."""
    driver = Moved()
    exchange = Exchange(driver, Guard(driver.limits, ramp=10.0), reconnect=True)
    exchange.start()
    try:
        until(lambda: exchange.answers > 20)
        exchange.guard.gain = 1.0
        driver.error = DeviceError("the device is gone.", lost=True)
        places = []

        def back():
            exchange.command((2.0,))
            sample = exchange.sample()
            if driver.opened == 2 and sample.homed:
                places.append(sample.position[0])
            return len(places) > 20 and len(driver.sent) > driver.begins + 5

        until(back)
        assert set(places) == {0.1}
        forces = [command for _, command in driver.sent[driver.begins :]]
        assert forces[0] == 0.0 and max(forces) < 0.5
    finally:
        exchange.stop()


def test_a_missing_device_is_an_error_at_the_start():
    driver = Slow()
    driver.refused = 1
    with pytest.raises(DeviceError, match="no such device"):
        Exchange(driver, Guard(driver.limits)).start()
