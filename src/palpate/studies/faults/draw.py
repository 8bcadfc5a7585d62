"""Random touches of shipped graphs, and random faults of them."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from dataclasses import dataclass

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.studies.faults.chain import Chain
from palpate.studies.faults.fault import CAUSES, KINDS, OF_MESSAGES, Fault
from palpate.studies.faults.touch import Felt

TWO = "palpate-two"
FINGERS = {"index": 9e-3, "middle": -9e-3}  # [m] of this graph: their hands in the scene, and where they touch
GRAPHS = {"kidney": 6, "nodule": 1, "texture": 1}
BODIES = {"MassSpring": 4, "ReducedFE": 2, "BeamBundle": 2, "Rigid": 1}
RATES = {1000: 4, 500: 1, 2000: 1}  # [Hz]
REST = 0.35  # [s] of the last press, held after the last fault has ended
HEIGHT = 0.110  # [m] of the hand over the origin before the touch


@dataclass(frozen=True)
class Touch:
    """A touch of a graph: overrides as `--set` takes them, and its duration [s]. The hand rests at its end."""

    graph: str
    sets: tuple[str, ...]
    duration: float
    rate: float

    def launch(self) -> LaunchFile:
        return find(self.graph).but(overrides=self.sets)

    def command(self) -> str:
        """The same touch without faults."""
        return " ".join([f"palpate run {self.graph} --fused", *(f"--set '{each}'" for each in self.sets)])


def draw_touch(random_: random.Random) -> Touch:
    """Presses, strokes and taps at 0.03 to 0.5 m/s, then a press that is held."""
    graph, body = (random_.choices(list(of), list(of.values()))[0] for of in (GRAPHS, BODIES))
    rate = random_.choices(list(RATES), list(RATES.values()))[0]
    at = [random_.uniform(-0.02, 0.02), random_.uniform(-0.004, 0.004), HEIGHT]
    begin, time = list(at), 0.0
    path: list[dict[str, object]] = []
    for _ in range(random_.choice([1, 2, 3])):
        aside = random_.choice([0.0, 0.0, 1.0])
        to = [
            min(max(at[0] + aside * random_.uniform(-0.03, 0.03), -0.02), 0.02), at[1],
            random_.choice([random_.uniform(0.0925, 0.0965), random_.uniform(0.0925, 0.0965), HEIGHT]),
        ]  # fmt: skip
        time += _move(path, at, to, random_)
    time += _move(path, at, [at[0], at[1], random_.uniform(0.093, 0.096)], random_)
    sets = [
        f"scene.hand.begin={json.dumps(begin)}", f"scene.hand.path={json.dumps(path)}", f"rate={rate}",
        f"tissue.use=deformation.{body}",
    ]  # fmt: skip
    return Touch(graph, tuple(sets), time + REST, float(rate))


def draw_two(random_: random.Random) -> Touch:
    """As `draw_touch`, with two fingers on one tissue, in turns or together."""
    body = random_.choices(list(BODIES), list(BODIES.values()))[0]
    rate = random_.choices(list(RATES), list(RATES.values()))[0]
    middle, end = random_.uniform(-0.01, 0.01), 0.0
    sets: list[str] = []
    for name, aside in FINGERS.items():
        at, time = [middle + aside, 0.0, HEIGHT], random_.choice([0.0, 0.1, 0.3])
        begin = list(at)
        path: list[dict[str, object]] = [{"hold": time}] if time else []
        for _ in range(random_.choice([1, 2, 3])):
            slides = random_.choice([0.0, 0.0, 0.01])
            height = random_.choice([random_.uniform(0.094, 0.103), random_.uniform(0.094, 0.103), HEIGHT])
            time += _move(path, at, [at[0] + random_.uniform(-slides, slides), 0.0, height], random_)
        time += _move(path, at, [at[0], 0.0, random_.uniform(0.096, 0.102)], random_)
        sets += [f"scene.{name}.begin={json.dumps(begin)}", f"scene.{name}.path={json.dumps(path)}"]
        end = max(end, time)
    return Touch(TWO, (*sets, f"rate={rate}", f"tissue.use=deformation.{body}"), end + REST, float(rate))


def _move(path: list[dict[str, object]], at: list[float], to: list[float], random_: random.Random) -> float:
    """Append a segment and a hold to a path; returns their duration [s]."""
    far = max(sum((a - b) ** 2 for a, b in zip(at, to, strict=True)) ** 0.5, 1e-3)
    time, hold = round(far / random_.uniform(0.03, 0.5) + 0.01, 3), random_.choice([0.0, 0.03, 0.15])
    path.append({"to": [round(x, 5) for x in to], "time": time, "shape": random_.choice(["minimum-jerk", "linear"])})
    if hold:
        path.append({"hold": hold})
    at[:] = to
    return time + hold


def draw_faults(run: Chain, touch: Touch, random_: random.Random) -> list[Fault]:
    """One to four faults, alone, together, or caused by the motion. They end `REST` before the touch."""
    ms = touch.rate * 1e-3  # [ticks]
    last = round((touch.duration - REST) * touch.rate)
    begin = random_.randint(round(15 * ms), max(round(16 * ms), last - round(10 * ms)))
    spread = random_.choice([0, 10, 60, 150])
    faults = []
    for _ in range(random_.choice([1, 1, 2, 2, 3, 4])):
        kind = random_.choice(KINDS)
        if random_.random() < 0.3 and kind != "stalls":
            when, words = _caused(random_, ms, last)
        else:
            a = begin + round(random_.randint(0, spread) * ms)
            b = min(a + max(1, round(random_.choice([1, 5, 15, 30, 60, 150, 400]) * ms)), last)
            when, words = _between(a, b), f"{a / ms:g}..{b / ms:g} ms"
        faults.append(_fault(run, kind, when, words, random_, ms))
    return faults


def _between(begin: int, end: int) -> Callable[[int, Felt], bool]:
    return lambda tick, felt: begin <= tick < end


def _fault(
    run: Chain, kind: str, when: Callable[[int, Felt], bool], words: str, random_: random.Random, ms: float
) -> Fault:
    if kind == "stalls":
        length = max(1, round(random_.choice([1, 3, 8, 15, 40, 200]) * ms))
        return Fault(kind, "", "", when, f"for {length / ms:g} ms at the first of {words}", length=length)
    if kind not in OF_MESSAGES:
        return Fault(kind, random_.choice([s.name for s in run.slots if not s.node.paced]), "", when, words)
    stream, reader = random_.choice([(p.stream, slot.name) for slot in run.slots for p in slot.inputs if p.stream])
    reader = random_.choice([reader, ""])
    delay, seed = random_.randint(1, max(1, round(9 * ms))), random_.random()
    how = random_.choice(["all", "single", "turns", "bursts"]) if kind == "lost" else kind
    chance = random_.choice([0.1, 0.3, 0.5, 0.7, 0.9, 0.95])

    def fate(tick: int) -> tuple[int, ...]:
        here = random.Random(f"{seed} {tick}")  # the same for each reader, and for each order of the steps
        gone = {
            "all": True,
            "single": here.random() < chance,
            "turns": tick // delay % 2 == 1,
            "bursts": random.Random(f"{seed} {tick // (4 * delay)}").random() < chance,
            "late": False,
            "copies": here.random() < chance,
        }[how]
        if gone:
            return ()
        if how == "late":
            return (delay,)
        return tuple(here.randint(0, delay) for _ in range(here.randint(1, 2))) if how == "copies" else (0,)

    return Fault(kind, stream, reader, when, f"{words} ({how}, {chance:g}, {delay})", fate)


def _caused(random_: random.Random, ms: float, last: int) -> tuple[Callable[[int, Felt], bool], str]:
    """When a fault lasts that the motion causes: late by some ticks, for some ticks, and then not for some."""
    cause, x = random_.choice(list(CAUSES)), random_.random() ** 2
    late, lasts, pauses = (
        round(random_.choice(among) * ms) for among in ([0, 0, 2, 8, 20], [1, 4, 15, 40], [1, 5, 30, 300])
    )
    due = [0, -1]  # the tick from which it may happen again, and the one at which it begins

    def when(tick: int, felt: Felt) -> bool:
        if not felt.places:
            due[:] = [0, -1]
        if due[1] < 0 and tick >= due[0] and CAUSES[cause](felt, x):
            due[1] = tick + late
        if due[1] >= 0 and tick >= due[1] + max(1, lasts):
            due[:] = [tick + pauses, -1]
        return 0 <= due[1] <= tick < last

    return when, f"{cause} ({x:.2f}), {late} late, for {lasts}, again after {pauses} ticks"
