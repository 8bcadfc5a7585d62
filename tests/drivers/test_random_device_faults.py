"""Every driver with random faults of its device, of the machine and of the graph, in virtual time.

`PALPATE_DEVICES=5000 .venv/bin/python -m pytest -m long tests/drivers/test_random_device_faults.py` searches further. A
seed has the same result on each machine.
"""

import math
import os
import random
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from drivers.test_frame_rules import WITHOUT_FRAMES, found_drivers
from msgspec import structs
from support.virtual_devices import BENCHES, Bench, Record, VirtualTime, run

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.guard import FALL, SILENT, STALE, Guard
from palpate.physics.device.falcon import HOME

SHORT, LONG = 12, int(os.environ.get("PALPATE_DEVICES", "100"))
MS = 1_000_000
DURATION = 3.0  # [s]
REACH = 0.02  # [m] from the middle of a Falcon, which forces move by 0.01 m more; farther out its arms may not meet
NARROW = tuple(tuple(h + s * 0.012 for h in HOME) for s in (-1, 1))  # [m] a box that the hand leaves
SEEDS = [*range(SHORT), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(SHORT, LONG))]
HAPTIC = [name for name in BENCHES if name != "NetFTDriver"]
EXAMPLES = {"SliderDriver"}  # of docs/examples, without an emulator


@dataclass(frozen=True)
class Draw:
    """What a seed draws: faults of the device, path of the hand, settings, commands of the graph, stalls."""

    faults: EmulatedFaults
    script: Script
    narrow: bool  # whether the box is `NARROW`
    deadman: int
    ramp: float
    reconnect: bool
    rate: float  # [Hz] of the graph
    size: float  # [1] of the commands, as a share of the largest
    wild: float  # [1] share of the steps of the graph with a command that is no number
    huge: bool  # or far too large instead
    mute: tuple[float, float]  # [s] in which the graph does not step
    stalls: tuple[tuple[float, float, bool], ...]  # [s], duration [s], whether the graph stalls too


def drawn(seed: int) -> Draw:
    draw = random.Random(seed)

    def sometimes(odds: float, value: Any, otherwise: Any) -> Any:
        return value if draw.random() < odds else otherwise

    begin = draw.uniform(0.5, 2.0)
    back = sometimes(0.7, begin + draw.choice([0.008, 0.012, 0.02, 0.1, 0.3, 0.8]), -1.0)
    lost = draw.choice(["", "", "unplug", "silent"])
    faults = EmulatedFaults(
        latency=sometimes(0.4, draw.uniform(0.0, 6e-3), 0.0),
        dropouts=sometimes(0.4, draw.choice([0.01, 0.1, 0.5]), 0.0),
        garbled=sometimes(0.2, draw.choice([0.001, 0.02]), 0.0),
        glitches=sometimes(0.2, draw.choice([0.001, 0.02]), 0.0),
        noise=sometimes(0.3, 0.1, 0.0),
        seed=seed, back=back if lost else -1.0, **({lost: begin} if lost else {}),
    )  # fmt: skip
    points, ends, buttons = [HOME], [], []
    while not ends or ends[-1] < DURATION:
        far = draw.choice([0.005, 0.02, 0.05, 0.15])
        fast = draw.choice([0.05, 0.3, 0.3, 1.0, 3.0])
        to = tuple(h + float(np.clip(draw.uniform(-far, far), -REACH, REACH)) for h in HOME)
        ends.append(
            (ends[-1] if ends else 0.0) + max(math.dist(to, points[-1]) / fast, 0.01) + sometimes(0.3, 0.3, 0.0)
        )
        points.append(to)
        buttons.append(draw.choice([1, 1, 1, 0]))
    script = Script(points=tuple(points), ends=tuple(ends), shapes=(1,) * len(ends), buttons=tuple(buttons))
    mute = draw.uniform(0.5, 2.5)
    stalls = sorted(
        (draw.uniform(0.3, DURATION), draw.choice([0.005, 0.02, 0.1, 0.6]), draw.random() < 0.5)
        for _ in range(draw.choice([0, 0, 1, 3]))
    )
    return Draw(
        faults, script, draw.random() < 0.3, draw.choice([0, 0, 1]), draw.choice([0.0, 0.1, 0.5]), draw.random() < 0.5,
        draw.choice([250.0, 1000.0, 1000.0, 4000.0]), draw.choice([0.02, 0.1, 0.1, 0.5]), sometimes(0.3, 0.05, 0.0),
        draw.random() < 0.3, sometimes(0.3, (mute, mute + draw.choice([0.02, 0.2, 9.0])), (9.0, 9.0)), tuple(stalls),
    )  # fmt: skip


def ran(name: str, draw: Draw, patch: pytest.MonkeyPatch) -> tuple[Bench, Record]:
    clock = VirtualTime(patch)
    garbled = 0.0 if name == "Inverse3Driver" else draw.faults.garbled  # TCP has checksums
    bench = BENCHES[name](clock, draw.script, structs.replace(draw.faults, garbled=garbled))
    if draw.narrow:
        bench.driver.limits = replace(bench.driver.limits, box=NARROW)
    guard = Guard(bench.driver.limits, draw.deadman, draw.ramp)
    clock.stalls.extend((clock.begun + round(at * 1e9), round(of * 1e9), both) for at, of, both in draw.stalls)
    wild = random.Random(draw.faults.seed + 1)

    def command(t: float) -> tuple[float, ...] | None:
        if draw.mute[0] <= t < draw.mute[1]:
            return None
        most = draw.size * bench.driver.limits.command
        if wild.random() < draw.wild:
            values = [1e300, -1e300, 0.0] if draw.huge else [math.nan, math.inf]
            return tuple(wild.choice(values) for _ in range(3))
        return tuple(most * 0.5 * math.sin(2.0 * math.pi * (0.7 + 0.4 * i) * t + i) for i in range(3))

    def period(t: float) -> int:
        begin, end = draw.mute
        return max(round((end - t) * 1e9), MS) if begin <= t < end else round(1e9 / draw.rate)

    return bench, run(clock, bench, guard, draw.reconnect, DURATION, command, period)


def size_of(bench: Bench, values: np.ndarray) -> np.ndarray:
    """Size of commands as the limit counts it: the largest number, or the length."""
    limits = bench.driver.limits
    return np.abs(values).max(axis=1) if limits.each else np.linalg.norm(values, axis=1)


def check_steps(record: Record, draw: Draw, bench: Bench) -> None:
    """No step of the command is larger than what its fades, its ramp and the command of the graph explain."""
    times, applied, _, wanted = record.arrays()
    dt = np.diff(times) * 1e-9
    writes = np.array(record.writes)
    since = writes[np.maximum(np.searchsorted(writes, times, side="right") - 2, 0)]  # two writes before
    dt = np.maximum(dt, (times - since)[1:] * 1e-9)
    most = draw.size * bench.driver.limits.command
    moves = np.linalg.norm(np.diff(np.nan_to_num(wanted), axis=0), axis=1)
    moves = np.maximum(moves, most * 8.0 * (dt + 0.02))  # its rate is below 8/s of its size
    ramp = dt / draw.ramp if draw.ramp > 0.0 else np.ones(len(dt))
    allowed = 2.0 * most * np.minimum(dt / FALL, 1.0) + most * np.minimum(ramp, 1.0) + moves + 2.0 * bench.quantum
    change = np.linalg.norm(np.diff(applied, axis=0), axis=1)
    worst = int(np.argmax(change - allowed))
    assert change[worst] <= allowed[worst], (times[worst] - times[0], change[worst], allowed[worst])


def held(bad: np.ndarray, times: np.ndarray, length: float) -> np.ndarray:
    """Where a condition has been true for at least this time [s]."""
    last = np.maximum.accumulate(np.where(bad, times[0] - 10**12, times))
    return (times - last) * 1e-9 > length


def slowest(record: Record) -> np.ndarray:
    """Longest time [s] between two commands to the device in the last 0.2 s, at each write."""
    writes = np.array(record.writes)
    gaps = np.diff(writes, prepend=writes[0]) * 1e-9
    return np.array([gaps[max(i - 50, 0) : i + 1].max() for i in range(len(gaps))])


def check_zero(record: Record, draw: Draw, bench: Bench) -> None:
    """Without a command of the graph, with the button released, or outside of the box, the force is zero soon."""
    times, applied, places, _ = record.arrays()
    if not len(record.writes):
        return
    given, writes = np.array(record.given), np.array(record.writes)
    gap = slowest(record)
    at = np.clip(np.searchsorted(writes, times, side="right") - 1, 0, len(writes) - 1)
    faults = draw.faults
    unplugged = np.zeros(len(times), bool)
    if faults.unplug >= 0.0:  # the emulated device keeps its last command without a connection
        unplugged = times >= times[0] + faults.unplug * 1e9
    lag = faults.latency + FALL + 3.0 * gap[at] + 2e-3
    (low, high), late = bench.driver.limits.box, {}
    late["the graph is silent"] = (writes[at] - given) * 1e-9 > STALE + lag - faults.latency  # at the last command
    outside = ((places < low) | (places > high)).any(axis=1)
    if draw.narrow:
        late["it is outside of its box"] = held(outside, times, 0.03 + float(lag.max()))
    if draw.deadman:
        late["no button is held"] = held(np.array(record.pressed) == 0, times, 5e-3 + float(lag.max()))
    force = size_of(bench, applied) > 2.0 * bench.quantum
    for why, where in late.items():
        wrong = where & force & ~unplugged
        assert not wrong.any(), (why, (times[np.argmax(wrong)] - times[0]) * 1e-9, applied[np.argmax(wrong)])


def check_return(record: Record, draw: Draw, bench: Bench) -> None:
    """Where nothing prevents it for longer than the ramp, the device applies the command of the graph."""
    faults = draw.faults
    if faults.dropouts or faults.garbled or faults.glitches or draw.stalls or draw.wild:
        return
    times, applied, places, wanted = record.arrays()
    low, high = bench.driver.limits.box
    speed = np.linalg.norm(np.gradient(places, axis=0), axis=1) / np.maximum(np.gradient(times * 1e-9), 1e-4)
    good = (np.array(record.given) > times - 5e6) & (speed < 0.5 * bench.driver.limits.speed)
    good &= ((places > low) & (places < high)).all(axis=1)
    since = (times - times[0]) * 1e-9
    lost = faults.unplug if faults.unplug >= 0.0 else faults.silent
    if lost >= 0.0:
        good &= since < lost
    if draw.deadman:
        good &= np.array(record.pressed) > 0
    ended = since > DURATION - 0.01
    full = held(good, times, draw.ramp + FALL + 0.35) & ~ended
    most = draw.size * bench.driver.limits.command
    away = np.linalg.norm(applied - np.nan_to_num(wanted), axis=1)
    allowed = most * 8.0 * (1.0 / draw.rate + 0.012 + 2.0 * faults.latency) + 4.0 * bench.quantum
    assert not (full & (away > allowed)).any(), (since[np.argmax(full & (away > allowed))], allowed)


@pytest.mark.parametrize("name", HAPTIC)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_fault_makes_a_force_that_is_too_large_jumps_or_stays(name, seed, monkeypatch):
    draw = drawn(seed)
    bench, record = ran(name, draw, monkeypatch)
    _, applied, _, _ = record.arrays()
    limits = bench.driver.limits
    assert np.isfinite(applied).all()
    assert size_of(bench, applied).max() <= limits.command * (1 + 1e-9) + bench.quantum
    if not (draw.wild and draw.huge) and draw.size < 0.5:  # a large command is also limited by its power
        check_steps(record, draw, bench)
        check_return(record, draw, bench)
    check_zero(record, draw, bench)
    check_end(record, draw, bench)
    check_samples(record, draw)


def check_end(record: Record, draw: Draw, bench: Bench) -> None:
    """The run ends with the device's name if it was lost, else it has lasted; and the device gets zero at the end."""
    faults = draw.faults
    lost = faults.unplug if faults.unplug >= 0.0 else faults.silent
    gone = lost >= 0.0 and faults.back < 0.0
    if record.fault is not None:
        assert bench.driver.name in str(record.fault) or "service" in str(record.fault), record.fault
        assert lost >= 0.0 and not draw.reconnect, record.fault
    elif gone and not draw.reconnect:
        assert lost + bench.driver.limits.silence > DURATION - 1.0, "a lost device ends the run"
    if lost < 0.0 or (faults.back >= 0.0 and faults.back < DURATION - 1.0 and record.fault is None):
        assert not any(record.applied[-1]), "the device keeps a force"
    if draw.reconnect and any("Waiting" in note for note in record.notes) and 0.0 <= faults.back < DURATION - 1.0:
        assert "The device is back." in record.notes


def check_samples(record: Record, draw: Draw) -> None:
    """Every sample is a place where the device was lately, or an extrapolation of it."""
    times, _, places, _ = record.arrays()
    fastest = 3.5  # [m/s] of a drawn path, with its minimum-jerk peak
    for at, sample in record.samples:
        if not sample.homed or not sample.position:
            continue
        assert np.isfinite(sample.position).all() and np.isfinite(sample.joints).all() and sample.age >= 0
        then = at - sample.age
        near = (times <= at + MS) & (times >= then - (draw.faults.latency + 0.012) * 1e9)
        if near.any():
            away = np.linalg.norm(places[near] - sample.position, axis=1).min()
            assert away < 0.006 + 0.005 * fastest, ((at - times[0]) * 1e-9, away)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_force_of_a_sensor_is_the_present_one_or_absent(seed, monkeypatch):
    draw = drawn(seed)
    bench, record = ran("NetFTDriver", draw, monkeypatch)
    times, _, true, _ = record.arrays()
    longest = max(SILENT, 3e-3) + draw.faults.latency + 2e-3  # [s] age of a sample at 1 kHz
    longest += max((of for _, of, _ in draw.stalls), default=0.0)
    seen = [(at, sample.wrench) for at, sample in record.samples if sample.wrench]
    assert len(seen) > 20
    for at, wrench in seen:
        near = true[(times <= at) & (times >= at - longest * 1e9)]
        assert np.abs(near - wrench).max(axis=1).min() < 6.0 * 2.0 * math.pi * 5e-3, (at - times[0]) * 1e-9
    check_end(record, draw, bench)


def test_every_driver_has_an_emulated_device():
    """A driver without one fails here."""
    assert BENCHES.keys() | WITHOUT_FRAMES.keys() == found_drivers().keys() - EXAMPLES
