"""Consecutive compiled nodes of a worker, run by one call of compiled code (engine/table.py).

Messages between them stay records. A record becomes a message object only for a node in Python, another process, an
observer or the live view. The host gathers messages from other senders, as for any node.
"""

import ctypes
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from time import perf_counter_ns
from typing import Any, NamedTuple

import msgspec
import numpy as np

from palpate.engine.slot import Input, NodeError, Output, RecordOutput, Slot
from palpate.engine.table import CLOCK, INPUT, OUTPUT, RAISED, ROW
from palpate.engine.wire_plan import wire_plan
from palpate.messages import Message, MessageError, check_finite
from palpate.messages.record import blank, layout, reader, writer
from palpate.nodes.base import InputError, inputs
from palpate.nodes.base.block import ENTRY, Block
from palpate.nodes.base.compiled import CompiledNode, code, several

SAMPLE = 61  # ticks between two measurements of each node's duration; a prime, so that no usual divisor shares it


class Entrance(NamedTuple):
    """An input of a segment that comes from another process.

    port    the input;  line  (1,) of `INPUT` in the table
    row     address of the `ROW` of its node
    record  (1,) the record that the segment reads
    writer  writes a message to the memory of a record
    """

    port: Input
    line: np.ndarray
    row: int
    record: np.ndarray
    writer: Callable[[Message, Any], None]

    def write(self, message: Message) -> None:
        """Write a message to the record."""
        self.writer(message, self.record.view(np.uint8).data)

    def message(self) -> Message | None:
        """The message in the record."""
        return _read_message(self.record.ctypes.data, self.port)


class CompiledSegment:
    """Slots of compiled nodes, in the order of execution.

    permitted  age [s] up to which a slot may hold an input on the real clock
    deliver    called with blocks of messages of the outputs that have listeners
    """

    def __init__(
        self,
        slots: Sequence[Slot],
        rate: float,
        real: bool,
        permitted: Callable[[Slot, Input], float],
        deliver: Callable[[Block], None],
    ) -> None:
        self.slots = list(slots)
        self._deliver = deliver
        self._streams: list[str] = []
        self._out_lines: list[np.ndarray] = []
        self._kept: list[Any] = []
        self._absent: dict[type[Message], np.ndarray] = {}  # blank records of missing messages, shared by lanes
        self._rows = np.zeros(len(slots), ROW)
        self._clock = np.zeros(1, CLOCK)
        self._clock["rate"], self._clock["real"] = rate, real
        self._clock["last"], self._clock["resume"] = len(slots), -1
        self._claimed: list[tuple[np.ndarray, np.ndarray]] = []  # journals that a receiver keeps, or has kept
        self._write_to(np.zeros(1 << 20, np.uint8), np.zeros(1 << 14, ENTRY))
        for slot in slots:
            for port in slot.inputs:
                port.inside = isinstance(port.output, RecordOutput) and port.output.joined and not port.behind
        self._border = [
            (place, slot) for place, slot in enumerate(slots) if any(not (p.inside or p.dead) for p in slot.inputs)
        ]
        self._repeated = [output for slot in slots for output in slot.outputs if output.repeats]
        self.receives = any(port.behind for slot in slots for port in slot.inputs)
        """Whether the host passes it messages of this worker, so that compiled code cannot run several ticks alone."""
        self.collects = False
        """Whether the messages of several ticks stay in the journal until `hand_over`: no node awaits them."""
        self._inlets: dict[int, list[tuple[Any, Any, Any, Any] | None]] = {}
        self._lines = [self._fill(place, slot, rate, permitted) for place, slot in enumerate(slots)]
        self._run = table_runner(real)
        self.where = self._rows.ctypes.data, self._clock.ctypes.data
        """Addresses of the rows and of the clock."""
        # views of single fields: faster in each tick than a lookup by name
        self._due, self._skip, self._stepped, self._times = (
            self._rows[name] for name in ("due", "skip", "stepped", "time")
        )
        self._failed, self._resume, self._at, self._length, self._count = (
            self._clock[name] for name in ("failed", "resume", "at", "length", "entries")
        )
        for slot in slots:
            slot.renewed, slot.joined = self.refresh, True
        self.listen()

    def _fill(self, place: int, slot: Slot, rate: float, permitted: Callable[[Slot, Input], float]) -> np.ndarray:
        """Fill the row of a slot. Returns the lines of its inputs."""
        row, node = self._rows[place], slot.node
        assert isinstance(node, CompiledNode)
        kind: Any = type(node)
        node.resize([abs(count) for count in slot.counts])
        lines = self._keep(np.zeros(len(slot.inputs), INPUT))
        used = self._keep(np.full(max(len(slot.inputs), 1), -1, np.int64))
        # Arguments of the kernel: the node's record, then a record or a table of records for each port, then outputs.
        ports: list[np.ndarray | None] = []
        at: list[tuple[int, int]] = []  # for each input the number of its argument, and its index in a list
        for form, count in zip(inputs(kind), slot.counts, strict=True):
            table = self._keep(np.zeros(1, several(form.type))) if form.many else None
            if table is not None:
                table["count"] = count
            ports.append(table)
            at += [(len(ports), n if form.many else -1) for n in range(abs(count))]
        outputs = [record_of(output) for output in slot.outputs]
        records = self._keep(np.zeros(1 + len(ports) + len(outputs), np.int64))
        records[0] = node._record.ctypes.data
        for n, table in enumerate(ports):
            if table is not None:
                records[1 + n] = table.ctypes.data
        records[1 + len(ports) :] = [record.ctypes.data for record in outputs]
        self._inlets[place] = self._fill_inputs(slot, lines, records, ports, at, permitted)
        numbers = self._keep(np.array([a for record in outputs for a in _numbers(record)], np.int64))
        row["compute"], row["idle"] = kernels(kind, slot.sleeps)
        row["records"], row["count"] = records.ctypes.data, len(records)
        row["inputs"], row["input"], row["used"] = len(lines), lines.ctypes.data, used.ctypes.data
        row["outputs"], row["output"] = len(outputs), self._lines_of(slot).ctypes.data
        row["numbers"], row["numbered"] = numbers.ctypes.data, len(numbers)
        row["every"], row["nominal"], row["missed"] = slot.every, slot.every / rate, -1
        row["follows"], row["hardware"] = _followed(slot), node.hardware
        for output in slot.outputs:
            assert isinstance(output, RecordOutput)
            output.used, output.source = used[: len(lines)], slot.name
        return lines

    def _fill_inputs(
        self,
        slot: Slot,
        lines: np.ndarray,
        records: np.ndarray,
        ports: list[np.ndarray | None],
        at: list[tuple[int, int]],
        permitted: Callable[[Slot, Input], float],
    ) -> list[tuple[Any, Any, Any, Any] | None]:
        """Fill the lines of the inputs of a slot: the record of the sender, or one that the host fills, whose writer is
        returned.

        records, ports  arguments of the kernel, and the table of each port
        at              for each input the number of its argument, and its index in a list
        """
        inlets: list[tuple[Any, Any, Any, Any] | None] = []
        for n, (port, (argument, nth)) in enumerate(zip(slot.inputs, at, strict=True)):
            line, absent = lines[n], self._absent.setdefault(port.kind, blank(port.kind))
            inlet = None
            if port.inside:
                record = record_of(port.output)
            else:
                record = self._keep(blank(port.kind))
                inlet = writer(port.kind, port.port.wants), record.view(np.uint8).data, record["there"], record
            inlets.append(inlet)
            table = ports[argument - 1]
            put = records.ctypes.data + 8 * argument if table is None else table.ctypes.data + 8 + 8 * nth
            line["record"], line["absent"], line["put"] = record.ctypes.data, absent.ctypes.data, put
            line["every"], line["loop"], line["permitted"] = port.every, port.loop, permitted(slot, port)
            line["optional"] = port.port.optional
            line["drives"] = slot.drives(port)
        return inlets

    def _lines_of(self, slot: Slot) -> np.ndarray:
        """The lines of a slot's outputs."""
        lines = self._keep(np.zeros(len(slot.outputs), OUTPUT))
        for line, output in zip(lines, slot.outputs, strict=True):
            assert isinstance(output, RecordOutput)
            plan = wire_plan(output.kind, slot.name)
            line["record"], line["number"] = output.record.ctypes.data, len(self._streams)
            line["steps"], line["count"] = plan.steps.ctypes.data, len(plan.steps)
            line["literals"], line["most"] = plan.literals.ctypes.data, plan.most
            self._streams.append(output.stream)
        self._out_lines.append(lines)
        return lines

    def _keep(self, array: np.ndarray) -> np.ndarray:
        """Keep memory alive whose address is in the table."""
        self._kept.append(array)
        return array

    def refresh(self) -> None:
        """Copy from the slots which nodes are blocked, which senders are dead, and which node was restarted."""
        for place, (slot, lines) in enumerate(zip(self.slots, self._lines, strict=True)):
            row = self._rows[place]
            row["blocked"], row["skip"] = slot.blocked, False
            lines["dead"] = [port.dead for port in slot.inputs]
            if slot.time is None:
                slot.node.resize([abs(count) for count in slot.counts])  # type: ignore[attr-defined]
                row["begun"], row["due"], row["missed"] = False, 0, -1
            row["follows"] = _followed(slot)
        self.listen()

    def listen(self) -> None:
        """Copy from the slots which outputs have listeners."""
        for slot, lines in zip(self.slots, self._out_lines, strict=True):
            lines["period"] = [
                output.period if output.external or output.observed or output.listeners else 0
                for output in slot.outputs
            ]

    def run(self, tick: int, host: Any) -> None:
        """Run the nodes that step at a tick. NodeError: one failed."""
        for place, slot in self._border:
            if tick < self._due[place] or slot.blocked:
                continue
            messages = host.gather(slot, tick)
            self._skip[place] = messages is None
            if messages is not None:
                self._take(place, slot, messages)
        for output in self._repeated:
            output.previous = output.last  # before the steps of this tick overwrite its record
        self._at[0] = host.at
        if self.measures_nodes(tick):
            self._time_tick(tick)
        else:
            self._call(tick, 1)
        self.deliver_tick(tick, host)

    def measures_nodes(self, tick: int) -> bool:
        """Whether `run` measures the durations of single nodes at a tick."""
        return tick % SAMPLE == 0

    def resume(self, tick: int) -> None:
        """Continue a tick in which the journal was full. NodeError: a node failed."""
        self._clock["first"], self._clock["last"] = 0, len(self.slots)
        self._call(tick, 1)

    def deliver_tick(self, tick: int, host: Any) -> None:
        """After the steps of a tick: deliver the messages of the nodes that stepped, unless it collects them."""
        for place, slot in enumerate(self.slots):
            if self._stepped[place]:
                slot.time, slot.health.tick = int(self._times[place]), tick
                host.take_outputs(slot, tick)
        if not self.collects:
            self.hand_over()

    def alone(self) -> bool:
        """Whether all messages come from the segment itself, so that one call can run many ticks."""
        return not self._border

    def run_many(self, tick: int, ticks: int) -> None:
        """Run `ticks` ticks of the simulated clock, if the segment is `alone`. Their messages may remain in the journal
        until `hand_over`. NodeError: a node failed."""
        self._time_tick(tick)
        if ticks > 1:
            self._call(tick + 1, ticks - 1)
        self.copy_times()

    def copy_times(self) -> None:
        """Copy tick and time of the last step of each node to its slot, after several ticks."""
        begun, last, due = (self._rows[name].tolist() for name in ("begun", "last", "due"))
        for place, (slot, time) in enumerate(zip(self.slots, self._times.tolist(), strict=True)):
            if begun[place]:
                slot.health.tick, slot.time, slot.due = last[place], time, due[place]

    def advance(self, tick: int) -> None:
        """Run one tick of the simulated clock without measuring durations, if the segment is `alone`. NodeError: a node
        failed."""
        self._call(tick, 1)
        self.hand_over()

    def _take(self, place: int, slot: Slot, messages: Sequence[Message | None]) -> None:
        for inlet, port, message in zip(self._inlets[place], slot.inputs, messages, strict=True):
            if inlet is None:
                continue
            write, memory, there, _ = inlet
            if message is None:
                there[0] = False
            else:
                try:
                    write(message, memory)
                except MessageError as error:
                    raise NodeError(port.producer, f"message of tick {message.tick}", error) from None

    def _call(self, tick: int, ticks: int) -> None:
        end = tick + ticks
        while True:
            self._run(*self.where, tick, end - tick)
            if self._failed[0] >= 0:
                self.hand_over()
                raise self.node_error()
            if self._resume[0] < 0:
                return
            tick = int(self._clock["tick"][0])
            if not self.hand_over():  # the journal is too small for one message
                self._claimed = []  # and these too
                self._write_to(np.zeros(2 * len(self._journal), np.uint8), self._entries)

    def node_error(self) -> NodeError:
        """The error of the node that failed."""
        slot = self.slots[int(self._failed[0])]
        return failure(slot, slot.node, *self.where)

    def block(self) -> Block | None:
        """The messages in the journal; None: it is empty."""
        count, journal = int(self._count[0]), self._journal
        return Block(self._streams, self._entries[:count], journal, lambda: self._claim(journal)) if count else None

    def _claim(self, journal: np.ndarray) -> bool:
        """Leave the journal to a receiver, and continue with one that no receiver keeps any more; its pages exist."""
        if journal is not self._journal:
            return False
        self._claimed.append((journal, self._entries))
        unused = [k for k, pair in enumerate(self._claimed) if _references(pair) == _UNUSED]
        if unused:
            self._write_to(*self._claimed.pop(unused[0]))
        else:
            self._write_to(np.zeros(len(journal), np.uint8), np.zeros(len(self._entries), ENTRY))
        return True

    def _write_to(self, journal: np.ndarray, entries: np.ndarray) -> None:
        """Set the memory of the journal."""
        self._journal, self._entries = journal, entries
        self._clock["journal"], self._clock["room"] = journal.ctypes.data, len(journal)
        self._clock["entry"], self._clock["most"] = entries.ctypes.data, len(entries)

    def clear(self) -> None:
        """Empty the journal."""
        self._count[0] = self._length[0] = 0

    def hand_over(self) -> bool:
        """Deliver the messages in the journal, and empty it. Returns whether there were any."""
        block = self.block()
        if block is not None:
            self.clear()  # first: a receiver that waits may call this again
            self._deliver(block)
        return block is not None

    def number(self, stream: str) -> int:
        """Number of an output in the journal; -1: a node of another segment sends it."""
        return self._streams.index(stream) if stream in self._streams else -1

    def entrances(self) -> Iterator[Entrance]:
        """The inputs from other processes."""
        return (entrance for entrance in self.inlets() if entrance.port.feed is not None)

    def inlets(self) -> Iterator[Entrance]:
        """The inputs whose messages the host writes."""
        for place, (slot, lines) in enumerate(zip(self.slots, self._lines, strict=True)):
            for n, port in enumerate(slot.inputs):
                if not (port.dead or port.inside):
                    record, write = self._inlets[place][n][3], self._inlets[place][n][0]  # type: ignore[index]
                    yield Entrance(port, lines[n : n + 1], self.where[0] + place * ROW.itemsize, record, write)

    def _time_tick(self, tick: int) -> None:
        """Run one tick node by node and record the duration of each step."""
        clock = self._clock
        for place, slot in enumerate(self.slots):
            before = self._rows["steps"][place]
            clock["first"], clock["last"] = place, place + 1
            begun = perf_counter_ns()
            self._call(tick, 1)
            duration = perf_counter_ns() - begun
            if self._rows["steps"][place] > before:
                slot.health.step.add(duration)
                self._rows["steps"][place] -= 1
        clock["first"], clock["last"] = 0, len(self.slots)

    def tables(self) -> list[np.ndarray]:
        """All arrays that a run writes or reads addresses from, except those of the nodes: the rows, the clock, the
        others."""
        records = [record_of(output) for slot in self.slots for output in slot.outputs]
        return [self._rows, self._clock, *self._kept, *records]

    def constants(self) -> list[np.ndarray]:
        """The other arrays that a run reads, and no run writes: records of missing messages, and the plans of the wire
        form of the outputs."""
        plans = [wire_plan(output.kind, slot.name) for slot in self.slots for output in slot.outputs]
        return [*self._absent.values(), *(array for plan in plans for array in (plan.steps, plan.literals))]

    def output_lines(self) -> Iterator[tuple[Slot, np.ndarray]]:
        """The nodes and the lines of their outputs in the table."""
        return zip(self.slots, self._out_lines, strict=True)

    def buffers(self) -> list[np.ndarray]:
        """The journal and its entries, which a run only writes."""
        return [self._journal, self._entries]

    def count(self) -> None:
        """Add the counts since the last call to the health of the nodes."""
        for row, slot in zip(self._rows, self.slots, strict=True):
            health = slot.health
            health.counted += int(row["steps"])
            health.asleep += int(row["asleep"])
            health.held += int(row["held"])
            health.absent += int(row["absent"])
            health.lost += int(row["lost"])
            row["steps"] = row["asleep"] = row["held"] = row["absent"] = row["lost"] = 0


def _references(arrays: tuple[np.ndarray, np.ndarray]) -> int:
    """Number of references to the arrays of a pair, also of views; `_UNUSED` if there are no others."""
    return sys.getrefcount(arrays[0]) + sys.getrefcount(arrays[1])


_UNUSED = _references((np.zeros(0), np.zeros(0)))


def table_runner(real: bool) -> Callable[..., Any]:
    """The compiled function that runs a table on the real or the simulated clock."""
    from palpate.compiler.entry_point import entry_point
    from palpate.engine.compiled_tick import run_freely, run_table  # the compiler is slow to import

    return entry_point(run_table if real else run_freely, 0, 0, 0, 0)


def kernels(kind: Any, sleeps: bool) -> tuple[int, int]:
    """Addresses of the machine code of a node class: a step, and the test for rest, 0 if it never sleeps."""
    return code(kind, "compute"), code(kind, "idle") if kind.idle is not None and sleeps else 0


def failure(slot: Slot, node: Any, rows: int, clock: int) -> NodeError:
    """The error of the failed node in the table at these addresses."""
    at = view(clock, CLOCK)[0]
    tick, row = int(at["tick"]), view(rows, ROW, int(at["failed"]) + 1)[-1]
    lines = view(row["input"], INPUT, row["inputs"])
    messages = [_read_message(int(line["record"]), port) for line, port in zip(lines, slot.inputs, strict=True)]
    try:
        if at["why"] == RAISED or node.own["fault"]:
            fault, node.own["fault"] = int(node.own["fault"]), 0
            given = _group_by_port(messages, slot.counts)
            if fault:
                raise node.explain(fault, *given)
            node.step(*given, dt=1.0 / float(at["rate"]))  # raises the exception of the compiled code, with its text
            raise ArithmeticError("compiled code raised")
        records = view(row["records"], np.dtype(np.int64), row["count"])[-int(row["outputs"]) :]
        for output, record in zip(slot.outputs, records.tolist(), strict=True):
            check_finite(reader(output.kind)(_memory(record, output.kind)))
        raise ArithmeticError("compiled code failed")
    except InputError as error:
        made = NodeError(error.source or slot.name, f"input of {slot.name!r} at tick {tick}", error)
        made.__cause__ = error
    except BaseException as error:
        made = NodeError(slot.name, f"step at tick {tick}", error)
        made.__cause__ = error
    return made


def view(address: int, dtype: np.dtype, count: int = 1) -> np.ndarray:
    """The memory at an address as an array."""
    memory: Any = (ctypes.c_char * (int(count) * dtype.itemsize)).from_address(int(address))
    return np.frombuffer(memory, dtype)


def _memory(address: int, kind: type[Message]) -> memoryview:
    return view(address, layout(kind)).view(np.uint8).data


def _read_message(record: int, port: Input) -> Message | None:
    """The message of an input from the record at an address."""
    memory = _memory(record, port.kind)
    message = reader(port.kind)(memory) if memory[0] else None
    if message is not None:
        present = int(memory.cast("q")[3])
        msgspec.structs.force_setattr(message, "source", port.producer)
        # Only whether each input was there is known, which is what a node may read.
        used = tuple(0 if present >> n & 1 else -1 for n in range(present.bit_length()))
        msgspec.structs.force_setattr(message, "used", used)
    return message


def record_of(output: Output | None) -> np.ndarray:
    """The record of a compiled node's output."""
    assert isinstance(output, RecordOutput)
    return output.record


def _followed(slot: Slot) -> int:
    """Number of the first inputs of a slot whose newest time is that of its step; 0: it is that of the tick."""
    return (len(slot.drivers) or 1) if slot.follows else 0


def _numbers(record: np.ndarray) -> list[int]:
    """Addresses of the floating-point numbers of a message's record."""

    def float_addresses(dtype: np.dtype, at: int) -> list[int]:
        if dtype.fields is not None:
            return [a for form, offset, *_ in dtype.fields.values() for a in float_addresses(form, at + offset)]
        base, shape = dtype.subdtype or (dtype, ())
        return [at + 8 * i for i in range(math.prod(shape))] if base.kind == "f" else []

    return float_addresses(record.dtype, record.ctypes.data)


def segments(slots: Sequence[Slot], make: Callable[[list[Slot]], CompiledSegment]) -> list[Slot | CompiledSegment]:
    """Join consecutive compiled slots of a worker into segments. A node that waits for a message of another process
    begins a new segment, because this message may be the response to an earlier node."""
    parts: list[Slot | list[Slot]] = []
    sent: set[Output] = set()  # by the nodes so far
    for slot in slots:
        sent.update(slot.outputs)
        for port in slot.inputs:
            port.behind = port.loop and port.output in sent
            if port.behind and port.output is not None:
                port.output.repeats = True
        compiled = isinstance(slot.node, CompiledNode) and type(slot.node).step is CompiledNode.step
        for output in slot.outputs:
            if isinstance(output, RecordOutput):
                output.joined = compiled
        waits = any(not (p.dead or p.loop) and p.output is None for p in slot.inputs)
        if compiled and not waits and parts and isinstance(parts[-1], list):
            parts[-1].append(slot)
        else:
            parts.append([slot] if compiled else slot)
    return [make(part) if isinstance(part, list) else part for part in parts]


def _group_by_port(messages: list[Any], counts: Sequence[int]) -> list[Any]:
    """Group messages by port: one message, or a list of them."""
    given, at = [], 0
    for count in counts:
        given.append(messages[at] if count < 0 else messages[at : at + count])
        at += abs(count)
    return given
