"""Nodes are stepped in one place: messages available in the process are those that the rules of each clock select."""

from dataclasses import replace
from itertools import count

import pytest

from palpate.engine.clock import now
from palpate.engine.slot import Slot
from palpate.engine.tick import run_tick
from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs
from palpate.launch.run.hop.pauses import BURST
from palpate.launch.run.reports import Alive
from palpate.launch.run.work import real
from palpate.launch.run.work.heartbeat import REPORT
from palpate.launch.run.work.simulated import SimulatedClock
from palpate.launch.run.work.worker import Worker
from palpate.messages import pack

TICKS = 400


def touch(monkeypatch, clock: str, ready: bool) -> tuple[list[dict[str, bytes]], list[tuple[int, int, int]]]:
    """The messages of the kidney graph at each tick in one process, and the numbers of steps, losses and holds;
    `ready`: nodes may use the messages available in the process."""
    launch = replace(find("kidney").but(place="fused", overrides=["friction.every=3", "tissue.every=2"]), record=None)
    graph = launch.load()
    graph.nodes["log"].off = "nothing is recorded"
    planned = plan(graph)
    [job] = jobs(planned, launch.placement(planned), clock=clock, ticks=TICKS)
    worker = Worker(job, None, lambda report: None)
    worker.start()
    if not ready:
        for slot in worker.slots:
            slot.near = False
    times = count(step=100_000)
    monkeypatch.setattr(real.clock, "now", lambda: next(times))
    monkeypatch.setattr(real.clock, "sleep_until", lambda deadline: 0)
    sent = []

    def housekeep(ticks: int = 1) -> None:
        sent.append({stream: pack(output.last) for stream, output in worker.outputs.items() if output.last})

    monkeypatch.setattr(worker, "housekeep", housekeep)
    try:
        if clock == "real":
            real.run_real(worker)
        else:
            simulated = SimulatedClock(worker)
            for tick in range(TICKS):
                simulated.run(tick)
    finally:
        worker.stop()
    return sent, [(slot.health.step.count, slot.health.lost, slot.health.held) for slot in worker.slots]


@pytest.mark.parametrize("clock", ["simulated", "real"])
def test_available_messages_equal_the_gathered_ones(monkeypatch, clock):
    ready, gathered = touch(monkeypatch, clock, True), touch(monkeypatch, clock, False)
    assert len(ready[0]) == TICKS and ready == gathered


class Host:
    """Has no inputs for the nodes, and records which ones step."""

    rate, at = 1000.0, 7

    def __init__(self) -> None:
        self.stepped: list[tuple[str, int]] = []

    def gather(self, slot: Slot, tick: int) -> list | None:
        return None if slot.name == "lacks" else []

    def take_outputs(self, slot: Slot, tick: int) -> None:
        self.stepped.append((slot.name, tick))


class Node:
    """The attributes of a slot that `run_tick` uses."""

    near = follows = blocked = False
    every = 2

    def __init__(self, name: str, due: int = 0, **given: object) -> None:
        self.name, self.due, self.steps = name, due, []
        vars(self).update(given)

    def step(self, *given: object) -> None:
        self.steps.append(given)

    def time_of(self, messages: object, at: int) -> int:
        return at


def test_a_node_steps_if_it_is_due_and_not_blocked_and_has_its_inputs():
    host, node = Host(), Node("steps")
    run_tick([node, Node("later", due=6), Node("dead", blocked=True), Node("lacks")], 5, host)
    assert host.stepped == [("steps", 5)] and node.steps == [(5, 7, [], 2e-3)]


@pytest.mark.parametrize("late", [False, True])
def test_a_late_worker_marks_its_nodes_as_restarted(late):
    launch = replace(find("kidney").but(place="fused"), record=None)
    planned = plan(launch.load())
    [job] = jobs(planned, launch.placement(planned), clock="real", ticks=TICKS)
    worker = Worker(job, None, lambda report: None)
    worker.start()
    worker.begin(now() + (-1_000_000_000 if late else 1_000_000_000))
    [controller] = [slot.node for slot in worker.slots if slot.name == "controller"]
    assert controller.own["replaces"] == late
    worker.stop()


@pytest.mark.parametrize("period", [0.01, 1.0], ids=["parts in time", "parts slower than heartbeats"])
@pytest.mark.parametrize("rate", [1000.0, 5000.0])
def test_a_pause_between_two_ticks_has_one_job(monkeypatch, period, rate):
    """To hand messages over, to send them, or to send a part of a heartbeat: two of them take longer than a tick at
    5 kHz. A slow heartbeat ends before the next one begins."""
    launch = replace(find("kidney").but(place="fused", overrides=[f"rate={rate}"]), record=None)
    planned = plan(launch.load())
    [job] = jobs(planned, launch.placement(planned), clock="real", ticks=TICKS)
    done: list[str] = []

    def part(node: object) -> str:
        done.append("part")
        return ""

    worker = Worker(job, None, lambda report: done.append("heartbeat") if isinstance(report, Alive) else None)
    worker.start()
    worker.begin(now())
    moments = count(now() + 2 * REPORT, round(period * REPORT))
    monkeypatch.setattr("palpate.launch.run.work.worker.clock.now", lambda: next(moments))
    monkeypatch.setattr(worker, "_flush", lambda **given: done.append("messages"))
    for slot in worker.slots:
        monkeypatch.setattr(type(slot.node), "condition", part)
    pauses = []
    for _ in range(300):
        done.clear()
        if not worker.pauses.unsent:  # as the hop does
            worker.pauses.handed = True
            done.append("hands over")
        worker.housekeep(BURST)
        pauses.append({"part" if kind == "heartbeat" else kind for kind in done})
        pauses[-1] |= {"heartbeat"} & set(done)
    worker.stop()
    kinds = [pause - {"heartbeat"} for pause in pauses]
    if rate > 1000.0:
        assert max(map(len, kinds)) == 1
    else:
        assert not any({"messages", "part"} <= pause for pause in kinds)
    for kind in ("hands over", "messages"):
        assert sum(kind in pause for pause in kinds) >= 100, kind
    assert sum("heartbeat" in pause for pause in pauses) > 1
