"""Compiled nodes in one call send the same bytes as one by one, also with other nodes between them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np
import pytest

from palpate.compiler.kernel import kernel
from palpate.engine import segment
from palpate.engine.clock import now
from palpate.engine.segment import CompiledSegment
from palpate.engine.slot import NodeError
from palpate.launch.load.launchfile import find
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.work import worker as workers
from palpate.launch.run.work.loops import run
from palpate.launch.run.work.real import _RealClock
from palpate.launch.run.work.worker import Worker
from palpate.messages import Contact, DeviceState, Force, Friction, Ledger, Pose, Proximity, unpack
from palpate.nodes.base import CompiledNode, Node, Out, Wants
from palpate.nodes.base.block import ENTRY, MARGIN
from palpate.nodes.friction import LuGre
from palpate.records.format.message_head import HEAD, HEAD_LENGTH, MESSAGE

TOUCH = (
    "scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.1}, {to: [0.01, 0, 0.0925], time: 0.1},"
    "{to: [0, 0, 0.113], time: 0.1}]",
)  # fmt: skip


class PythonLuGre(Node):
    """LuGre friction in a custom node, with the settings of the graph: Python between two compiled nodes."""

    given: ClassVar[dict[str, Any]] = {}

    def start(self) -> None:
        self.law = LuGre(**self.given)
        self.law.wanted = frozenset()
        self.law.start()

    def step(
        self,
        contact: Annotated[Contact, Wants("normal", "force")],
        proximity: Annotated[Proximity, Wants("slip", "foot", "normal", "gap")],
        *,
        dt: float,
    ) -> Friction:
        return self.law.step(contact, proximity, dt=dt)


class Spring(CompiledNode):
    """A wall that becomes infinitely stiff, divides by zero or sets a fault, according to `how`."""

    how: Annotated[int, "1"] = 0

    @kernel
    def compute(
        own, contact: Contact | None, friction: Friction | None, pose: Pose, ledger: Ledger | None,
        device: DeviceState | None, out: Out[Force], dt,
    ):  # fmt: skip
        if pose.position[2] < 0.1:
            if own.how == 1:
                out.force[1] = np.inf
            elif own.how == 2:
                out.force[1] = 1.0 / (own.how - 2)
            elif own.how == 3:
                own.fault = 7

    def explain(self, fault, *messages):
        return ValueError(f"too deep: {fault}, {messages[2].position[2] < 0.1}")


def made(overrides: tuple[str, ...] = (), ticks: int = 300, clock: str = "simulated") -> Worker:
    """The kidney graph in this process; each stream has a listener."""
    graph = find("kidney").but(overrides=(*TOUCH, *overrides)).load()
    set_recording(graph, None)
    planned = plan(graph)
    (job,) = jobs(planned, fuse_nodes(planned), clock=clock, ticks=ticks)
    streams = {stream: ("elsewhere",) for node in job.nodes for stream in node.streams}
    return Worker(msgspec.structs.replace(job, external=streams), None, lambda report: None)


def observe_all(worker: Worker) -> None:
    """Deliver each message of a started worker, as for an observer of all streams."""
    for slot in worker.slots:
        slot.period, slot.sends = 1, 0
        for output in slot.outputs:
            output.period = 1
    for part in worker.parts:
        if isinstance(part, CompiledSegment):
            part.listen()


def sent(worker: Worker) -> tuple[dict[str, list[bytes]], dict[str, tuple[int, ...]]]:
    """The payloads of each stream, and the counters of each node."""
    payloads: dict[str, list[bytes]] = {}

    def deliver(output, tick, payload):
        payloads.setdefault(output.stream, []).append(payload)

    worker._deliver_answer = deliver  # type: ignore[method-assign]
    worker._deliver_block = lambda block: [deliver(worker.outputs[s], t, p) for s, t, p in block.messages()]  # type: ignore[method-assign]
    worker.start()
    observe_all(worker)
    run(worker, 0)
    for part in worker.parts:
        if isinstance(part, CompiledSegment):
            part.count()
    counts = {}
    for slot in worker.slots:
        health = slot.health
        lacks = health.lost, health.held, health.absent
        counts[slot.name] = health.step.count + health.counted, health.asleep, *lacks, health.tick
    worker.stop()
    assert set(payloads) == set(worker.outputs)
    return payloads, counts


@pytest.fixture
def one_by_one(monkeypatch) -> Iterator[None]:
    """Step each node separately."""
    monkeypatch.setattr(workers, "segments", lambda slots, make: list(slots))


CASES = [
    (), ("spread.every=2",), ("friction.every=3", "tissue.every=2"), ("effects.friction=off",),
    ("tissue.use=deformation.Rigid",), ("scene.energy.ledger=true",),
]  # fmt: skip


@pytest.mark.parametrize("overrides", CASES, ids=str)
def test_a_segment_sends_the_same_bytes_as_its_nodes_one_by_one(overrides, monkeypatch):
    joined = made(overrides)
    together = sent(joined)
    assert any(isinstance(part, CompiledSegment) and len(part.slots) > 3 for part in joined.parts)
    monkeypatch.setattr(workers, "segments", lambda slots, make: list(slots))
    assert together == sent(made(overrides))


def test_python_between_compiled_nodes_changes_no_bit(monkeypatch):
    worker = made()
    settings = next(slot.job.settings for slot in worker.slots if slot.name == "friction")
    monkeypatch.setattr(PythonLuGre, "given", settings)
    assert sent(worker)[0] == sent(made((f"friction.use={__name__}.PythonLuGre",)))[0]


def test_a_full_journal_is_emptied_and_the_segment_continues(monkeypatch):
    whole = sent(made())
    init = CompiledSegment.__init__

    def small(self, *given):
        init(self, *given)
        self._journal = self._journal[:700]
        self._clock["room"] = 700

    monkeypatch.setattr(CompiledSegment, "__init__", small)
    assert whole == sent(made())


def test_a_receiver_keeps_the_memory_of_a_block_that_it_claims(monkeypatch):
    """One receiver may claim a block. Its memory stays as it is until the receiver drops it; then it is used again."""
    init = CompiledSegment.__init__

    def small(self, *given):
        init(self, *given)
        self._write_to(np.zeros(30_000, np.uint8), np.zeros(100, ENTRY))

    monkeypatch.setattr(CompiledSegment, "__init__", small)
    whole, worker = sent(made())[0], made()
    payloads: dict[str, list[bytes]] = {}
    kept: list[tuple[list[str], np.ndarray, np.ndarray]] = []
    journals, blocks = set(), 0

    def read(streams, entries, memory):
        for number, tick, time, begin, end in entries.tolist():
            head = memory[begin - MARGIN : begin].view(HEAD)[0]
            assert head.tolist() == (MESSAGE, HEAD_LENGTH + end - begin, head["channel"], tick, time, time)
            payloads.setdefault(streams[number], []).append(memory[begin:end].tobytes())

    def keep(block):
        nonlocal blocks
        blocks += 1
        journals.add(block.memory.ctypes.data)
        assert block.claim() and not block.claim()
        kept.append((list(block.streams), block.entries, block.memory[:]))
        if len(kept) == 3:
            read(*kept.pop(0))

    worker._deliver_block = keep  # type: ignore[method-assign]
    worker.start()
    observe_all(worker)
    run(worker, 0)
    worker.stop()
    for block in kept:
        read(*block)
    assert payloads == whole
    assert blocks > 20 and len(journals) <= 5


def test_the_steps_of_nodes_are_timed_at_some_ticks():
    worker = made()
    sent(worker)
    timed = [slot.health.step.count for slot in worker.slots]
    assert all(1 <= count < 50 for count in timed)


@pytest.mark.parametrize(
    ("how", "text"),
    [(1, "Force.force .N.: found inf at index 1"), (2, "division by zero"), (3, "too deep: 7, True")],
)
def test_a_fault_in_compiled_code_names_node_tick_and_cause(how, text):
    worker = made((f"controller.use={__name__}.Spring", f"controller.how={how}"))
    with pytest.raises(NodeError, match=f"node 'controller', step at tick [0-9]+: .*{text}"):
        sent(worker)


@pytest.mark.parametrize("way", ["segment", "one by one"])
def test_on_the_real_clock_no_node_steps_on_a_driving_message_of_an_earlier_tick(way, monkeypatch):
    """The collision stops in a press. The contact must not step on its last position, however short the hold; what
    holds a message may."""
    if way == "one by one":
        monkeypatch.setattr(workers, "segments", lambda slots, make: list(slots))
    worker = made(clock="real")
    worker.start()
    worker.begin(now())
    clock = _RealClock(worker, worker.slots[0])
    for tick in range(90):
        clock.run(tick, tick * 1_000_000)
    slots = {slot.name: slot for slot in worker.slots}
    slots["collision"].blocked = True
    for part in worker.parts:
        if isinstance(part, CompiledSegment):
            part.refresh()
    last = {name: worker.outputs[name].last for name in ("contact", "friction", "spread", "tissue")}
    for tick in range(90, 93):
        clock.run(tick, tick * 1_000_000)
        assert worker.outputs["finger"].last.tick == tick
        for name, before in last.items():
            assert worker.outputs[name].last.tick == before.tick == 89, name
    assert last["contact"].force > 0.1
    slots["collision"].blocked = False
    for part in worker.parts:
        if isinstance(part, CompiledSegment):
            part.refresh()
    clock.run(93, 93_000_000)
    assert worker.outputs["contact"].last.tick == worker.outputs["contact"].last.used[0] == 93
    worker.stop()


def test_on_the_real_clock_messages_for_observers_are_collected_over_several_ticks(monkeypatch):
    """Also where a node in Python steps in the same process, as behind the pointer of `palpate touch`. A node in
    another process awaits its message at once."""

    def blocks(external: bool) -> list[list[tuple[str, int, bytes]]]:
        worker = made((f"friction.use={__name__}.PythonLuGre",), clock="real")
        for output in worker.outputs.values():
            output.external = external
        blocks: list[list[tuple[str, int, bytes]]] = []
        worker._deliver_block = lambda block: blocks.append(list(block.messages()))  # type: ignore[method-assign]
        worker.start()
        worker.begin(now())
        for output in worker.outputs.values():
            output.observed = True
        for part in worker.parts:
            if isinstance(part, CompiledSegment):
                part.listen()
        clock = _RealClock(worker, worker.slots[0])
        for tick in range(100):
            clock.run(tick, tick * 1_000_000)
        worker._flush()
        worker.stop()
        return blocks

    def by_stream(blocks: list[list[tuple[str, int, bytes]]]) -> dict[str, list[bytes]]:
        sent: dict[str, list[bytes]] = {}
        for name, _, payload in (message for block in blocks for message in block):
            sent.setdefault(name, []).append(payload)
        return sent

    at_once, collected = blocks(True), blocks(False)
    assert len(at_once) == 200 and len(collected) < 40  # two segments; bursts of 16 ticks, and heartbeats
    assert by_stream(at_once) == by_stream(collected) and len(by_stream(collected)["contact"]) == 100


def test_a_message_object_is_created_only_on_request(monkeypatch):
    worker = made()
    worker.job = msgspec.structs.replace(worker.job, external={})
    for output in worker.outputs.values():
        output.external = False
        monkeypatch.setattr(output, "_read", lambda memory: pytest.fail("a message was made"))
    worker.start()
    worker.begin(0)
    part = worker.parts[0]
    part.run_many(0, 250)
    monkeypatch.undo()
    contact = worker.outputs["contact"].last
    assert contact.tick == 249 and contact.force > 0.1 and contact.source == "contact"
    assert contact.used == (249, 248)
    worker.stop()


def test_a_segment_restarts_with_its_nodes():
    worker = made()
    first = sent(worker)
    for slot in worker.slots:
        slot.restart()
    worker.tick = -1
    assert first[0] == sent_again(worker)


def sent_again(worker: Worker) -> dict[str, list[bytes]]:
    payloads: dict[str, list[bytes]] = {}
    for part in worker.parts:
        part._deliver = lambda block: [payloads.setdefault(s, []).append(p) for s, _, p in block.messages()]  # type: ignore[union-attr]
    run(worker, 0)
    return payloads


def test_every_message_in_the_journal_can_be_read():
    payloads, _ = sent(made())
    worker = made()
    kinds = {stream: output.kind for stream, output in worker.outputs.items()}
    for stream, messages in payloads.items():
        assert [unpack(payload, kinds[stream]).tick for payload in messages] == list(range(300))
    assert Path(segment.__file__).exists()
