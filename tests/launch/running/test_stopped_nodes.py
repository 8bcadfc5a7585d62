"""A node that stops without a word: the rule for the age of inputs takes the torque from the device in time.

Each node of a graph runs by the rules of the real clock as in a process of its own, without processes and on a clock
that stands: only the numbers of the ticks count, so that the answer does not depend on the machine.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from types import SimpleNamespace

import pytest
from graphs_for_runs import write_graph

from palpate.launch.loading.launchfile import LaunchFile, find
from palpate.launch.loading.plan import plan
from palpate.launch.running import real
from palpate.launch.running.assign import jobs
from palpate.launch.running.execute import set_recording
from palpate.launch.running.slot import Slot, make
from palpate.messages import Message, Torque

LAST = 20  # [ticks of 1 ms] promised between the last message of a node and a device without torque


class Chain:
    """The nodes of a launch file, one message of a tick after the other; `late`: ticks that a message takes to come."""

    def __init__(self, launch: LaunchFile, late: int = 0) -> None:
        graph = launch.load()
        set_recording(graph, None)
        job = next(job for job in jobs(plan(graph), launch.placement(plan(graph)), clock="real") if job.leads)
        assert {given.name for given in job.nodes} == set(plan(graph).order)
        self.slots = [Slot(given, make(given), ()) for given in job.nodes]
        for slot in self.slots:
            slot.wire({})
            for port in slot.inputs:
                port.feed = object()  # from elsewhere; nothing more comes while a step waits
            slot.start()
        self.worker = SimpleNamespace(job=job, wait=self._pass, stopping=False)
        self.late, self.way = late, deque[tuple[int, str, Message]]()
        self.tick, self.clock = 0, 0
        self.ran = {slot.name: -1 for slot in self.slots}

    def _pass(self, feed: object, deadline: int = 0) -> None:
        self.clock += 1_000_000

    def now(self) -> int:
        return self.clock

    def run(self, ticks: int, stopped: str = "") -> None:
        for _ in range(ticks):
            self._arrive()
            for slot in self.slots:
                if slot.name != stopped:
                    self._step(slot)
                    self._arrive()
            self.tick += 1

    def _arrive(self) -> None:
        while self.way and self.way[0][0] <= self.tick:
            _, stream, message = self.way.popleft()
            for slot in self.slots:
                for port in slot.inputs:
                    if port.stream == stream:
                        port.put(message, 0)

    def _step(self, slot: Slot) -> None:
        driver = slot.driver
        tick = self.tick
        if driver is not None:
            if not driver.queue or driver.queue[-1].tick <= self.ran[slot.name]:
                return
            tick = driver.queue[-1].tick
        messages = real._gather(self.worker, slot, tick, self.clock + 1_000_000, leading=True)
        if messages is not None:
            slot.step(tick, tick * 1_000_000, messages, 1e-3)
            self.ran[slot.name] = tick
            self.way.extend((self.tick + self.late, output.stream, output.last) for output in slot.outputs)

    def torque(self) -> float:
        """What the device works with, in its last step."""
        port = next(slot for slot in self.slots if slot.node.paced).inputs[0]
        used = next(slot for slot in self.slots if slot.node.paced).outputs[0].last.used[0]
        message = port.message
        assert message is None or isinstance(message, Torque)
        return max(map(abs, message.torques)) if used >= 0 and message is not None else 0.0


@pytest.fixture
def chain(monkeypatch):
    def made(launch: LaunchFile, late: int = 0) -> Chain:
        chain = Chain(launch.but(place="fused"), late)
        monkeypatch.setattr(real, "now", chain.now)
        return chain

    return made


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("node", ["finger", "collision", "contact", "spread", "tissue", "controller", "statics"])
def test_the_device_is_without_torque_soon_after_any_node_has_stopped(chain, node, late):
    """Whatever stops, and even where each hop takes a tick; only friction is done without."""
    run = chain(find("kidney"), late)
    run.run(700)
    assert run.torque() > 0.03
    silent = 0
    while run.torque() > 0.0:
        run.run(1, node)
        silent += 1
        assert silent < LAST


def test_without_friction_the_contact_goes_on(chain):
    run = chain(find("kidney"))
    run.run(700)
    run.run(100, "friction")
    assert run.torque() > 0.03


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("links", [1, 2, 3, 5])
def test_nodes_that_hold_one_another_s_messages_share_the_time(chain, tmp_path, links, late):
    """Each of them needs what it holds, so one falls silent after the other."""
    names = ["first", *(f"n{i}" for i in range(links))]
    held = "".join(
        f"  {name}: {{use: nodes_for_runs.Hold, in: {{pose: source, force: {before}}}}}\n"
        for before, name in pairwise(names)
    )
    graph = write_graph(
        tmp_path,
        "nodes:\n  source: {use: nodes_for_runs.Source, in: {torque: end}}\n"
        "  first: {use: nodes_for_runs.Spring, in: {pose: source}}\n"
        f"{held}  end: {{use: nodes_for_runs.Turn, in: {{force: n{links - 1}}}}}\n",
    )
    run = chain(LaunchFile(graph=graph), late)
    run.run(50)
    assert run.torque() == 1.0
    silent = 0
    while run.torque() > 0.0:
        run.run(1, "first")
        silent += 1
        assert silent < LAST
