"""One node inside a worker: its inputs, its outputs, and one step with all that surrounds it."""

from __future__ import annotations

import bisect
import inspect
import math
from collections import deque
from collections.abc import Collection
from operator import attrgetter
from time import perf_counter_ns

import msgspec

from palpate.launch.running.health import Health
from palpate.launch.running.inbox import LARGEST, Box, post
from palpate.launch.running.job import InputJob, NodeJob, ObserverJob
from palpate.messages import Message, MessageError, check_finite, fields
from palpate.messages.checks import finite_check
from palpate.nodes.base import Node, Observer, Port, inputs, outputs

_set = msgspec.structs.force_setattr
_tick = attrgetter("tick")


class NodeFault(Exception):
    """A node of the user's failed; the cause is its own error, `sys.exit` included: a node does not end a run."""

    def __init__(self, node: str, where: str, cause: BaseException | str) -> None:
        super().__init__(f"node {node!r}, {where}: {cause}")
        self.node, self.where, self.cause = node, where, cause


class Output:
    """One output stream: its last two messages, and who reads it.

    boxes  the inboxes of all workers that read it; empty where it goes through ZeroMQ
    """

    __slots__ = ("boxes", "external", "finite", "kind", "last", "listeners", "observed", "previous", "stream", "topic")

    def __init__(self, stream: str, kind: type[Message], external: bool) -> None:
        self.stream, self.kind, self.external = stream, kind, external
        self.finite = finite_check(kind)
        self.topic = stream.encode() + b"\0"
        self.last: Message | None = None
        self.previous: Message | None = None
        self.observed = False
        self.boxes: tuple[Box, ...] = ()
        self.listeners: list[ObserverSlot] = []

    def post(self, data: bytes) -> bool:
        """Write a frame to the readers' inboxes. Returns whether all have taken it. When one was full, the stream stays
        with ZeroMQ, which holds far more, and then holds back the sender."""
        if not self.boxes or len(data) > LARGEST:
            return False
        if not post(self.boxes, data):
            self.boxes = ()
        return bool(self.boxes)


class Input:
    """One input port: the rule by which it picks a message, and the messages that wait.

    An edge inside the worker reads the producer's output; one from outside has a queue that the inbox fills.
    """

    __slots__ = (
        "arrived",
        "dead",
        "every",
        "kind",
        "loop",
        "message",
        "output",
        "port",
        "producer",
        "queue",
        "stream",
        "waits",
    )

    def __init__(self, job: InputJob | None, port: Port, output: Output | None) -> None:
        self.port, self.kind, self.output = port, port.type, output
        self.stream = job.stream if job else ""
        self.producer = job.producer if job else ""
        self.every = job.every if job else 1
        self.loop = bool(job and job.loop)
        self.waits = bool(job and job.waits)
        self.dead = job is None
        self.queue: deque[Message] = deque()
        self.message: Message | None = None
        self.arrived = 0

    def put(self, message: Message, arrived: int) -> None:
        """Take a message that has come."""
        queue = self.queue
        last = queue[-1] if queue else self.message
        if last is None or last.tick < message.tick:
            queue.append(message)
            self.arrived = arrived
        else:
            self._sort_in(message)

    def _sort_in(self, message: Message) -> None:
        """One that came another way than those before it: into its place; a second copy, or one older than what was
        used last, nowhere."""
        if self.message is not None and message.tick <= self.message.tick:
            return
        place = bisect.bisect_left(self.queue, message.tick, key=_tick)
        if place == len(self.queue) or self.queue[place].tick != message.tick:
            self.queue.insert(place, message)

    def at(self, tick: int) -> Message | None:
        """The message that a step at `tick` of the simulated clock uses, if it is here; None where it has not come yet,
        and where there is none (see `absent`). Older ones are dropped."""
        need = tick - 1 if self.loop else tick
        if self.every > 1:
            need -= need % self.every
        output = self.output
        if output is not None:
            message = output.last
            if message is not None and message.tick != need:
                message = output.previous
            return message if message is not None and message.tick == need else None
        queue = self.queue
        while queue and queue[0].tick < need:
            queue.popleft()
        if queue and queue[0].tick == need:
            self.message = queue[0]
        message = self.message
        return message if message is not None and message.tick == need else None

    def absent(self, tick: int) -> bool:
        """Whether no message will come for a step at `tick`: the sender is gone, or it is the first tick of a loop."""
        return self.dead or (self.loop and tick == 0)

    def newest(self, limit: int) -> Message | None:
        """The newest message up to tick `limit`; older ones are dropped."""
        if self.output is not None:
            last = self.output.last
            return last if last is None or last.tick <= limit else self.output.previous
        while self.queue and self.queue[0].tick <= limit:
            self.message = self.queue.popleft()
        return self.message


class Slot:
    """A node in a worker."""

    def __init__(self, job: NodeJob, node: Node, external: Collection[str]) -> None:
        self.name, self.node, self.every, self.job = job.name, node, job.every, job
        kinds = outputs(type(node))
        if len(kinds) != len(job.streams):
            raise NodeFault(job.name, "streams", f"found {len(job.streams)}, expected {len(kinds)}")
        self.outputs = [
            Output(stream, kind, stream in external) for stream, kind in zip(job.streams, kinds, strict=True)
        ]
        self.inputs: list[Input] = []
        self.health = Health()
        self.due = 0
        self._time: int | None = None
        self._step = node.step
        self._takes_dt = "dt" in inspect.signature(type(node).step).parameters

    def wire(self, known: dict[str, Output]) -> None:
        """Connect the inputs; `known` holds the outputs of this worker by stream."""
        jobs = {given.port: given for given in self.job.inputs}
        for port in inputs(type(self.node)):
            job = jobs.get(port.name)
            self.inputs.append(Input(job, port, known.get(job.stream) if job else None))

    @property
    def driver(self) -> Input | None:
        """The input whose arrival runs the step; None where the clock does."""
        return None if self.node.paced or not self.inputs else self.inputs[0]

    def forces(self) -> dict[str, float]:
        """Magnitude [N] of each force in the last outputs, for the live view, by `stream.field`."""
        found: dict[str, float] = {}
        for output in self.outputs:
            if output.last is not None:
                found |= {f"{output.stream}.{name}": value for name, value in _forces(output.last).items()}
        return found

    def start(self) -> None:
        """Start the node. NodeFault: it raised."""
        try:
            self.node.start()
        except BaseException as error:
            raise NodeFault(self.name, "start", error) from error

    def begin(self) -> None:
        """Start the node anew, as a new process would: without a step before. NodeFault: it raised."""
        self._time = None
        for output in self.outputs:
            output.previous = output.last = None
        self.start()

    def step(self, tick: int, at: int, messages: list[Message | None], nominal: float) -> None:
        """Run the node on these inputs and set its outputs.

        at       [ns] time of the tick on the graph's clock
        nominal  [s]  dt of the first step

        NodeFault: the step raised, or sent what its type does not allow.
        """
        dt = nominal if self._time is None else (at - self._time) * 1e-9
        self._time = at
        begun = perf_counter_ns()
        try:
            answer = self._step(*messages, dt=dt) if self._takes_dt else self._step(*messages)
        except BaseException as error:
            raise NodeFault(self.name, f"step at tick {tick}", error) from error
        self.health.tick = tick
        self.health.step.add(perf_counter_ns() - begun)
        outputs = self.outputs
        if not outputs:
            return
        used = (-1 if messages[0] is None else messages[0].tick,) if len(messages) == 1 else _ticks(messages)
        answers = (answer,) if len(outputs) == 1 else self._several(answer, tick)
        for output, message in zip(outputs, answers, strict=True):
            if type(message) is not output.kind or message.tick != -1:
                message = self._other(output, message, tick)
            if not output.finite(message):
                self._check(message, tick)
            _set(message, "tick", tick)
            _set(message, "time", at)
            _set(message, "source", self.name)
            _set(message, "used", used)
            output.previous, output.last = output.last, message

    def _several(self, answer: object, tick: int) -> tuple:
        """The answers of a node with several outputs."""
        if answer is None:
            return (None,) * len(self.outputs)
        if not isinstance(answer, tuple) or len(answer) != len(self.outputs):
            kinds = ", ".join(output.kind.__name__ for output in self.outputs)
            found = f"{len(answer)} of them" if isinstance(answer, tuple) else type(answer).__name__
            raise NodeFault(self.name, f"step at tick {tick}", f"answered {found}, expected a tuple of {kinds}")
        return answer

    def _other(self, output: Output, message: object, tick: int) -> Message:
        """A message to send where the answer is not a new one of the right type: a copy, or the last one again."""
        if isinstance(message, output.kind):  # it has been sent before, as a node's input, say
            return msgspec.structs.replace(message)
        if message is None and output.last is not None:
            return msgspec.structs.replace(output.last)
        found = "None before it had sent a message" if message is None else f"a {type(message).__name__}"
        raise NodeFault(self.name, f"step at tick {tick}", f"answered {found}, expected a {output.kind.__name__}")

    def _check(self, message: Message, tick: int) -> None:
        try:
            check_finite(message)
        except MessageError as error:
            raise NodeFault(self.name, f"step at tick {tick}", error) from None


def _ticks(messages: list[Message | None]) -> tuple[int, ...]:
    return tuple([-1 if message is None else message.tick for message in messages])


def _forces(message: Message) -> dict[str, float]:
    """Magnitude [N] of each force in a message that is a number or a vector."""
    found = {}
    for field in fields(type(message)):
        if field.unit == "N" and field.dtype is None:
            value = getattr(message, field.name)
            found[field.name] = math.hypot(*value) if isinstance(value, tuple) else abs(value)
    return found


class ObserverSlot:
    """An observer in a worker: takes the payloads of its streams as they come."""

    def __init__(self, job: ObserverJob, node: Observer) -> None:
        self.name, self.node, self.streams = job.name, node, job.streams
        self.health = Health()
        self.last: dict[str, int] = dict.fromkeys(job.streams, -1)

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        """Hand over one message. NodeFault: the observer raised."""
        begun = perf_counter_ns()
        try:
            self.node.observe(stream, tick, payload)
        except BaseException as error:
            raise NodeFault(self.name, f"stream {stream!r} at tick {tick}", error) from error
        self.health.tick = tick
        self.health.step.add(perf_counter_ns() - begun)
        self.last[stream] = tick
