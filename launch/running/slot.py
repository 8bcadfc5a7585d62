"""One node inside a worker: its inputs, its outputs, and one step with all that surrounds it."""

from __future__ import annotations

import inspect
import math
import time
from collections import deque

import msgspec

from palpate.launch.running.health import Health
from palpate.launch.running.job import InputJob, NodeJob, ObserverJob
from palpate.messages import Message, MessageError, check_finite, fields
from palpate.nodes.base import Node, Observer, Port, inputs, outputs

_set = msgspec.structs.force_setattr


class NodeFault(Exception):
    """A node of the user's failed; the cause is its own error."""

    def __init__(self, node: str, where: str, cause: BaseException | str) -> None:
        super().__init__(f"node {node!r}, {where}: {cause}")
        self.node, self.where, self.cause = node, where, cause


class Output:
    """One output stream: its last two messages, and who reads it."""

    __slots__ = ("external", "last", "listeners", "observed", "previous", "stream", "topic")

    def __init__(self, stream: str, external: bool) -> None:
        self.stream, self.external = stream, external
        self.topic = stream.encode() + b"\0"
        self.last: Message | None = None
        self.previous: Message | None = None
        self.observed = False
        self.listeners: list[ObserverSlot] = []


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
        """Take a message from the inbox."""
        self.queue.append(message)
        self.arrived = arrived

    def at(self, tick: int) -> Message | None:
        """The message of `tick`, if it is here; older ones are dropped."""
        if self.output is not None:
            for message in (self.output.last, self.output.previous):
                if message is not None and message.tick == tick:
                    return message
            return None
        queue = self.queue
        while queue and queue[0].tick < tick:
            queue.popleft()
        if queue and queue[0].tick == tick:
            self.message = queue[0]
        message = self.message
        return message if message is not None and message.tick == tick else None

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

    def __init__(self, job: NodeJob, node: Node, external: dict[str, int]) -> None:
        self.name, self.node, self.every, self.job = job.name, node, job.every, job
        kinds = outputs(type(node))
        self.outputs = [Output(stream, stream in external) for stream in job.streams]
        if len(kinds) != len(self.outputs):
            raise NodeFault(job.name, "streams", f"found {len(self.outputs)}, expected {len(kinds)}")
        self.inputs: list[Input] = []
        self.health = Health()
        self.due = 0
        self._time: int | None = None
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
        except Exception as error:
            raise NodeFault(self.name, "start", error) from error

    def step(self, tick: int, at: int, messages: list[Message | None], nominal: float) -> None:
        """Run the node on these inputs and set its outputs.

        at       [ns] time of the tick on the graph's clock
        nominal  [s]  dt of the first step

        NodeFault: the step raised, or sent what its type does not allow.
        """
        dt = nominal if self._time is None else (at - self._time) * 1e-9
        self._time = at
        begun = time.perf_counter_ns()
        try:
            answer = self.node.step(*messages, dt=dt) if self._takes_dt else self.node.step(*messages)
        except Exception as error:
            raise NodeFault(self.name, f"step at tick {tick}", error) from error
        self.health.tick = tick
        self.health.step.add(time.perf_counter_ns() - begun)
        if not self.outputs:
            return
        used = tuple([-1 if m is None else m.tick for m in messages])
        if len(self.outputs) == 1:
            answer = (answer,)
        elif answer is None:
            answer = (None,) * len(self.outputs)
        for output, message in zip(self.outputs, answer, strict=True):
            if message is None:  # unchanged
                if output.last is None:
                    raise NodeFault(self.name, f"step at tick {tick}", "answered None before it had sent a message")
                message = msgspec.structs.replace(output.last)
            try:
                check_finite(message)
            except (MessageError, AttributeError, TypeError) as error:
                raise NodeFault(self.name, f"step at tick {tick}", error) from None
            _set(message, "tick", tick)
            _set(message, "time", at)
            _set(message, "source", self.name)
            _set(message, "used", used)
            output.previous, output.last = output.last, message


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
        begun = time.perf_counter_ns()
        try:
            self.node.observe(stream, tick, payload)
        except Exception as error:
            raise NodeFault(self.name, f"stream {stream!r} at tick {tick}", error) from error
        self.health.tick = tick
        self.health.step.add(time.perf_counter_ns() - begun)
        self.last[stream] = tick
