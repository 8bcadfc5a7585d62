"""A node in a worker: its inputs, its outputs, and its step with checks, errors and counters."""

import inspect
import math
import signal
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from time import perf_counter_ns
from typing import Any

import msgspec
import numpy as np

from palpate.engine.graph import places
from palpate.engine.health import HealthCounters
from palpate.engine.imports import load_class
from palpate.engine.job import InputJob, NodeJob, ObserverJob
from palpate.engine.schedule import needed_tick
from palpate.engine.warm import warm
from palpate.messages import Message, MessageError, fields
from palpate.messages.base import decoder
from palpate.messages.checks import check_finite, check_plausible, finite_check, plausible_check
from palpate.messages.record import blank, reader
from palpate.nodes.base import Block, CompiledNode, InputError, Node, Observer, Port, inputs, outputs
from palpate.physics.errors import PalpateError

_set = msgspec.structs.force_setattr


class NodeError(PalpateError):
    """A node failed; `cause` is its exception. This includes SystemExit: a node cannot end a run.

    A KeyboardInterrupt as cause is raised as it is if it comes from the user: no run handles Ctrl-C, or it is a
    subclass, as for SIGTERM.
    """

    def __init__(self, node: str, where: str, cause: BaseException | str) -> None:
        free = signal.getsignal(signal.SIGINT) is signal.default_int_handler
        if isinstance(cause, KeyboardInterrupt) and (free or type(cause) is not KeyboardInterrupt):
            raise cause
        super().__init__(f"node {node!r}, {where}: {cause}")
        self.node, self.where, self.cause = node, where, cause

    @property
    def hint(self) -> str:
        return "`palpate --debug ...` shows the traceback."


class Output:
    """One output stream: its last two messages and its receivers outside this worker.

    external  whether nodes of other groups read it
    send      sends a payload to them, after the start of the run
    period    divisor of the ticks whose messages are observed, if all observers are in this process
    finite    the fast check of a message; `check` raises MessageError if it is wrong
    repeats   whether a later node of this worker reads the message of the tick before (`Input.behind`)
    """

    __slots__ = (
        "check", "external", "finite", "kind", "last", "listeners", "observed", "period", "previous", "repeats", "send",
        "stream", "topic",
    )  # fmt: skip

    def __init__(self, stream: str, kind: type[Message], external: bool) -> None:
        self.stream, self.kind, self.external = stream, kind, external
        self.finite, self.check = plausible_check(kind), check_plausible
        self.topic = stream.encode() + b"\0"
        self.last: Message | None = None
        self.previous: Message | None = None
        self.observed = self.repeats = False
        self.send: Callable[[bytes], None] | None = None
        self.listeners: list[ObserverSlot] = []
        self.period = 1


class RecordOutput(Output):
    """An output of a compiled node. While a segment runs the node, reading `last` converts the record to a message, and
    `previous` is kept only if the output `repeats`.

    record  the message, written by the kernel
    used    ticks of the inputs that it was computed from
    source  name of the node
    joined  whether a segment runs the node, which then writes the record
    """

    __slots__ = ("_made", "_memory", "_read", "_there", "_tick", "joined", "record", "source", "used")

    def __init__(self, stream: str, kind: type[Message], external: bool) -> None:
        self.record = blank(kind)
        self._memory, self._read = self.record.view(np.uint8).data, reader(kind)
        self._there, self._tick = self.record["there"], self.record["tick"]
        self.used, self.source, self.joined = np.zeros(0, np.int64), "", False
        self._made: Message | None = None
        super().__init__(stream, kind, external)

    @property
    def last(self) -> Message | None:  # type: ignore[override]
        """The last message; None before the first."""
        made = self._made
        if self._there[0] and (made is None or made.tick != self._tick[0]):
            self._made = made = self._read(self._memory)
            _set(made, "source", self.source)
            _set(made, "used", tuple(self.used.tolist()))
        return made

    @last.setter
    def last(self, message: Message | None) -> None:
        self._made = message
        if message is None:
            self._there[0] = False


class RemoteStream:
    """One stream of another group: its inlet (`launch.run.wire.inlet`), its type, and the ports that read it."""

    __slots__ = ("decode", "inlet", "kind", "ports", "producer", "stream")

    def __init__(self, stream: str, kind: type[Message], producer: str, inlet: Any) -> None:
        self.stream, self.kind, self.producer, self.inlet = stream, kind, producer, inlet
        self.decode = decoder(kind).decode
        self.ports: list[Input] = []


class Input:
    """One input port: its rule for choosing a message, and the queue of messages.

    An edge inside the worker reads the producer's output; one from another worker has a feed, which fills the queue.
    """

    __slots__ = (
        "behind", "dead", "every", "feed", "inside", "kind", "loop", "message", "output", "port", "producer", "queue",
        "quiet", "rank", "stream", "waits",
    )  # fmt: skip

    def __init__(self, job: InputJob | None, port: Port, output: Output | None) -> None:
        self.port, self.kind, self.output = port, port.type, output
        given = job or InputJob("", "", "", waits=False)
        self.stream, self.producer, self.every, self.rank = given.stream, given.producer, given.every, given.rank
        self.loop, self.waits, self.dead = given.loop, given.waits, job is None
        self.quiet = False  # whether another input drives in its place, because its sender is silent
        self.inside = False  # whether a segment of this worker reads it from the record of the sender
        self.behind = False
        """Whether it reads the message of an earlier tick, and the sender runs before its node in this worker, or is
        that node: the record of the sender then has the message of this tick."""
        self.feed: RemoteStream | None = None
        self.queue: deque[Message] = deque()
        self.message: Message | None = None

    def put(self, message: Message) -> None:
        """Append a new message to the queue. Duplicates, and messages older than the last one, are dropped."""
        last = self.queue[-1] if self.queue else self.message
        if last is None or last.tick < message.tick:
            self.queue.append(message)

    def need(self, tick: int) -> int:
        """Tick of the message for a step at `tick` of the simulated clock; -1 in the first ticks of a loop."""
        return tick - self.loop if self.every == 1 else needed_tick(tick, self.every, self.loop)

    def of(self, need: int) -> Message | None:
        """The message of tick `need`, if it has arrived. Older messages are dropped."""
        queue = self.queue
        if queue and queue[0].tick == need:
            self.message = queue.popleft()
            return self.message
        message = self.newest(need)
        return message if message is not None and message.tick == need else None

    def is_lost(self, need: int) -> bool:
        """Whether the message of tick `need` is lost: a later one has arrived, and frames arrive in order."""
        return bool(self.queue) and self.queue[0].tick > need

    def newest(self, limit: int) -> Message | None:
        """The newest message up to tick `limit`; older ones are dropped."""
        if self.output is not None:
            last = self.output.last
            return last if last is None or last.tick <= limit else self.output.previous
        queue = self.queue
        while queue and queue[0].tick <= limit:
            self.message = queue.popleft()
        return self.message


class Slot:
    """A node in a worker."""

    sleeps = True
    """Whether nodes at rest sleep; False to measure the gain."""

    def __init__(self, job: NodeJob, node: Node, external: Collection[str]) -> None:
        self.name, self.node, self.every, self.job = job.name, node, job.every, job
        kinds = outputs(type(node))
        if len(kinds) != len(job.streams):
            raise NodeError(job.name, "streams", f"found {len(job.streams)}, expected {len(kinds)}")
        form = RecordOutput if isinstance(node, CompiledNode) else Output
        self.outputs = [form(stream, kind, stream in external) for stream, kind in zip(job.streams, kinds, strict=True)]
        # as in a segment: a compiled law may be outside its range, and reports it
        if isinstance(node, CompiledNode) and type(node).step is CompiledNode.step:
            for output in self.outputs:
                output.finite, output.check = finite_check(output.kind), check_finite
        self.inputs: list[Input] = []
        self.awaited: list[tuple[int, Input]] = []
        """The inputs with their index, the last to arrive first: the others arrive during the wait for it."""
        self.near = False  # whether all inputs come from nodes of this worker that run at each tick
        self.follows = False  # whether the time of a step is that of its driving message, not of the tick
        self.drivers: list[Input] = []
        """Inputs of the first port, if it has several senders and does without each: any of them may drive."""
        self.blocked = False  # whether a required sender has died
        self.health = HealthCounters()
        self.due = 0  # first tick of the next step
        self.missed = -1  # number of the last run, tick // every, that lacked an input
        self.period = 1
        """If all observers are in this process: divisor of the ticks whose outputs they take; 0: they take none."""
        self.sends = 0  # next tick whose output has a receiver
        self.time: int | None = None  # [ns] of the last step; None: none since the start
        self.joined = False  # whether a segment runs the node and delivers its outputs
        self.renewed: Callable[[], None] | None = None  # called after a restart
        self._single = len(self.outputs) == 1
        self.takes(counts(type(node), [port.name for port in inputs(type(node))]))

    def wire(self, known: dict[str, Output]) -> None:
        """Connect the inputs; `known`: the outputs of this worker by stream."""
        for port, job in places(type(self.node), self.job.inputs):
            self.inputs.append(Input(job, port, known.get(job.stream) if job else None))
        self.takes(counts(type(self.node), [given.port for given in self.job.inputs]))
        latest = sorted(range(len(self.inputs)), key=lambda place: -self.inputs[place].rank)
        self.awaited = [(place, self.inputs[place]) for place in latest]
        first = self.inputs[0].port if self.inputs else None
        senders = [each for each in self.inputs if each.port is first]
        if first is not None and first.optional and len(senders) > 1 and not self.node.paced:
            self.drivers = senders
        self.near = all(port.dead or (port.output is not None and port.every == 1) for port in self.inputs)

    def ready(self, tick: int) -> list[Message | None] | None:
        """The messages for a step of a `near` node at `tick` of the simulated clock; None: one is missing."""
        messages: list[Message | None] = []
        for port in self.inputs:
            if port.dead:
                messages.append(None)
                continue
            message = port.output.last  # type: ignore[union-attr]
            if message is None or message.tick != tick - port.loop:
                return None
            messages.append(message)
        return messages

    def takes(self, counts: tuple[int, ...]) -> None:
        """Set the number of messages of each port, see `counts`. Calls are generated with all arguments written out,
        which takes 25 % of the time of unpacking lists."""
        self.counts = counts
        node, dt = self.node, ["dt=dt"] if "dt" in inspect.signature(type(self.node).step).parameters else []
        self._step = _call(node.step, counts, dt)
        self._rests = _call(node.rests, counts, []) if type(node).rests is not Node.rests and self.sleeps else None

    @property
    def driver(self) -> Input | None:
        """The input whose arrival runs the step, the first one, or the first of `drivers` whose sender is neither dead
        nor quiet; None: the clock runs it."""
        if self.node.paced or not self.inputs:
            return None
        return next((each for each in self.drivers if not (each.dead or each.quiet)), self.inputs[0])

    def drives(self, port: Input) -> bool:
        """Whether the node does not step without the message of this tick from an input."""
        return port is self.driver and not self.drivers

    def hear(self, last: int, waited: bool) -> None:
        """Of several drivers: one that has sent a message of the last tick `last` or a later one may drive again. If
        those before one with a later message were `waited` for, it drives in their place."""
        for each in self.drivers:
            sent = each.queue[-1] if each.queue else each.message
            each.quiet = each.quiet and not (sent is not None and sent.tick >= last)
        later = next((k for k, each in enumerate(self.drivers) if each.queue and each.queue[-1].tick > last), 0)
        for each in self.drivers[:later] if waited else ():
            each.quiet = True

    def time_of(self, messages: list[Message | None], at: int) -> int:
        """Time [ns] of a step on these inputs: if it `follows`, that of the newest driving message, else `at`."""
        if not self.follows:
            return at
        if not self.drivers:
            return at if messages[0] is None else messages[0].time
        return max((each.time for each in messages[: len(self.drivers)] if each is not None), default=at)

    def forces(self) -> dict[str, float]:
        """Magnitude [N] of each force in the last outputs by `stream.field`, for the live view."""
        forces: dict[str, float] = {}
        for output in self.outputs:
            if output.last is not None:
                forces |= {f"{output.stream}.{name}": value for name, value in _forces(output.last).items()}
        return forces

    def start(self) -> None:
        """Start the node and warm it up, so that no step of the run compiles. Nodes that act on a device or a file are
        not stepped. NodeError: the node raised."""
        self.begin()
        if not (self.node.hardware or self.node.sink):
            ports = zip(inputs(type(self.node)), self.counts, strict=True)
            warm(self._step, [port for port, count in ports for _ in range(abs(count))])
            self.restart()

    def restart(self) -> None:
        """Stop the node and start it again. NodeError: it raised."""
        with _blame_node(self.name, "stop"):
            self.node.stop()
        self.begin()

    def begin(self) -> None:
        """Start the node, with no earlier step and no last outputs. NodeError: it raised."""
        self.due = 0
        for output in self.outputs:
            output.previous = output.last = None
        with _blame_node(self.name, "start"):
            self.node.start()
        self.forget()

    def forget(self) -> None:
        """Treat the next step as the first one."""
        self.time = None
        if self.renewed is not None:
            self.renewed()

    def step(self, tick: int, at: int, messages: list[Message | None], nominal: float) -> None:
        """Run the node on these inputs and set its outputs. If no time has passed since its last step, because the
        driving message is a duplicate or late, the outputs stay.

        at       [ns] time of the tick on the graph's clock
        nominal  [s]  dt of the first step

        NodeError: the step raised, or its output does not fit its type.
        """
        # Run the node, unless no time has passed or it is idle.
        before, health = self.time, self.health
        answer: object = None
        if before is None or at > before:
            dt = nominal if before is None else (at - before) * 1e-9
            self.time = at
            try:
                if self._rests is not None and before is not None and self._rests(messages, dt):
                    health.asleep += 1
                else:
                    begun = perf_counter_ns()
                    answer = self._step(messages, dt)
                    health.step.add(perf_counter_ns() - begun)
            except NodeError:
                raise
            except InputError as error:
                raise NodeError(error.source or self.name, f"input of {self.name!r} at tick {tick}", error) from error
            except BaseException as error:
                raise NodeError(self.name, f"step at tick {tick}", error) from error
        health.tick = tick
        # Outputs: a new message, or a copy of the last one, with a new header.
        answers = (answer,) if self._single else self._several(answer, tick)
        ticks = []
        for given in messages:
            ticks.append(-1 if given is None else given.tick)
        used = tuple(ticks)
        for place, output in enumerate(self.outputs):
            message = answers[place]
            if message is None and output.last is not None:
                message = output.last.__copy__()  # was checked when it was first sent
            else:
                if type(message) is not output.kind or message.tick != -1:
                    message = self._other(output, message, tick)
                if not output.finite(message):
                    try:
                        output.check(message)
                    except MessageError as error:
                        raise NodeError(self.name, f"step at tick {tick}", error) from None
            _set(message, "tick", tick)
            _set(message, "time", at)
            _set(message, "source", self.name)
            _set(message, "used", used)
            output.previous, output.last = output.last, message

    def _several(self, answer: object, tick: int) -> tuple:
        if answer is None:
            return (None,) * len(self.outputs)
        if not isinstance(answer, tuple) or len(answer) != len(self.outputs):
            kinds = ", ".join(output.kind.__name__ for output in self.outputs)
            description = f"{len(answer)} of them" if isinstance(answer, tuple) else type(answer).__name__
            raise NodeError(self.name, f"step at tick {tick}", f"answered {description}, expected a tuple of {kinds}")
        return answer

    def _other(self, output: Output, message: object, tick: int) -> Message:
        """A copy of a message that was sent before, for example by another node. NodeError: the type is wrong."""
        if isinstance(message, output.kind):
            return msgspec.structs.replace(message)
        description = "None before it had sent a message" if message is None else f"a {type(message).__name__}"
        raise NodeError(self.name, f"step at tick {tick}", f"answered {description}, expected a {output.kind.__name__}")


@contextmanager
def _blame_node(node: str, where: str) -> Iterator[None]:
    """Turn any exception into the NodeError of a node."""
    try:
        yield
    except BaseException as error:
        raise NodeError(node, where, error) from error


def counts(cls: type[Node], connected: Sequence[str]) -> tuple[int, ...]:
    """Number of messages of each port of a node, -1 for a port that takes one; `connected`: names of the connected
    ports, one per sender."""
    return tuple([connected.count(port.name) if port.many else -1 for port in inputs(cls)])


def _call(
    function: Callable[..., Any], counts: tuple[int, ...], more: list[str]
) -> Callable[[list[Message | None], float], Any]:
    """A call of `function` with the items of a list of messages; a port that takes many gets a list."""
    arguments, at = [], 0
    for count in counts:
        arguments.append(f"messages[{at}]" if count < 0 else f"messages[{at}:{at + count}]")
        at += abs(count)
    call = f"lambda messages, dt: function({', '.join([*arguments, *more])})"
    return eval(compile(call, __file__, "eval"), {"function": function})


def _forces(message: Message) -> dict[str, float]:
    """Each force [N] in a message: a number, the magnitude of a vector, each number of a list."""
    magnitudes: dict[str, float] = {}
    for field in fields(type(message)):
        if field.unit == "N" and field.dtype is None:
            value = getattr(message, field.name)
            if field.shape and not isinstance(field.shape[0], int):
                magnitudes |= {f"{field.name}[{i}]": each for i, each in enumerate(value)}
            else:
                magnitudes[field.name] = math.hypot(*value) if isinstance(value, tuple) else value
    return magnitudes


FEW = 32  # number of messages below which taking them one by one is faster than as a block


class ObserverSlot:
    """An observer in a worker, with the payloads of its streams that it has yet to take."""

    def __init__(self, job: ObserverJob, node: Observer) -> None:
        self.name, self.node, self.streams = job.name, node, job.streams
        self.health = HealthCounters()
        self.last: dict[str, int] = dict.fromkeys(job.streams, -1)
        self.pending: list[tuple[str, int, bytes]] = []

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        """Pass one message. NodeError: the observer raised."""
        self.pending.append((stream, tick, payload))
        self.take()

    def take(self) -> None:
        """Pass all pending messages, which takes half of the time of one call per message, and count each with the
        mean duration. NodeError: the observer raised."""
        if not self.pending:
            return
        observe, last, stream, tick = self.node.observe, self.last, "", -1
        begun = perf_counter_ns()
        try:
            for stream, tick, payload in self.pending:
                observe(stream, tick, payload)
                last[stream] = tick
        except BaseException as error:
            raise NodeError(self.name, f"stream {stream!r} at tick {tick}", error) from error
        finally:
            count = len(self.pending)
            self.pending.clear()
        self._count(tick, begun, count)

    def take_block(self, block: Block) -> None:
        """Pass all pending messages, then those of its streams in a block; a few are added to the pending ones.
        NodeError: the observer raised."""
        if len(block.entries) < FEW:
            self.pending += [message for message in block.messages() if message[0] in self.streams]
            return
        self.take()
        used, entries = [stream in self.streams for stream in block.streams], block.entries
        if not all(used):
            entries = entries[np.array(used)[entries["number"]]]
        if not len(entries):
            return
        begun, tick = perf_counter_ns(), int(entries["tick"][-1])
        try:
            self.node.observe_block(block._replace(entries=entries))
        except BaseException as error:
            raise NodeError(self.name, f"messages up to tick {tick}", error) from error
        last = np.full(len(block.streams), -1)
        last[entries["number"]] = entries["tick"]  # ascending
        self.last |= {s: t for s, t in zip(block.streams, last.tolist(), strict=True) if t >= 0}
        self._count(tick, begun, len(entries))

    def _count(self, tick: int, begun: int, count: int) -> None:
        self.health.tick = tick
        self.health.step.add((perf_counter_ns() - begun) // count, count)


def make(job: NodeJob | ObserverJob) -> Node:
    """Create the node of a job. NodeError: its class or its settings are wrong."""
    with _blame_node(job.name, "settings"):
        kind: type[Node] = Observer if isinstance(job, ObserverJob) else Node
        node = load_class(job.cls, kind)(**job.settings)
    if isinstance(job, NodeJob) and job.wanted is not None:
        node.wanted = frozenset(job.wanted)
    return node
