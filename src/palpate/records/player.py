"""Runs nodes of a plan on the messages of a recording.

A recorded node steps at the ticks and times of its recorded messages, and gets as inputs the messages of the ticks in
their `used`. So late, held, lost and absent messages of a live run are reproduced exactly for any placement. A node
that was not recorded, or has another divisor, follows the rules of simulated time.
"""

import inspect
from collections.abc import Iterable
from time import thread_time_ns

from palpate.engine.faults import GraphError
from palpate.engine.graph import places
from palpate.engine.health import Histogram
from palpate.engine.imports import UntrustedError, check_trusted, modules_of, recorded_class
from palpate.engine.job import node_job
from palpate.engine.plan import Plan, force_path
from palpate.engine.schedule import needed_tick
from palpate.engine.slot import Input, NodeError, Slot
from palpate.engine.tick import run_tick
from palpate.messages import Message, pack
from palpate.nodes.base import SettingError
from palpate.records.format.head import Head, head_of
from palpate.records.stored import RecordingError, Stored

MOST = 65_536  # limit of queued messages of an input: far more than a logger can write out of order


class MissingInput(Exception):
    """A node used a message that the recording does not contain, so an exact check is impossible."""


class ReplaySlot(Slot):
    """One running node, and the mapping of its inputs to the recorded ones."""

    def __init__(self, plan: Plan, name: str, path: set[str], recorded: Plan) -> None:
        job = node_job(plan, name, path)
        try:
            super().__init__(job, plan.make(name), ())
            self.wire({})
            self.near = False  # also a node without inputs steps at its recorded ticks
        except (NodeError, SettingError, TypeError) as error:
            raise RecordingError(
                f"node {name!r} ({job.cls}) no longer fits the recording: {error}. "
                "Its streams can still be played (--only the others), read and exported."
            ) from None
        self.streams = job.streams
        self.as_recorded = _every(recorded, name) in (None, job.every)
        """Whether it steps at its recorded ticks. False: its divisor has changed, so it follows simulated time."""
        self.places = self._places(recorded)
        """Index of each input's tick in `used`; None if the recorded node read another stream there."""
        self.broken = ""
        self.cpu = Histogram()
        """Processor time of this thread in each step, so that other programs do not count."""

    def _places(self, recorded: Plan) -> list[int | None]:
        spec = recorded.graph.nodes.get(self.name)
        if spec is None or self.name not in recorded.edges or not self.as_recorded:
            return [None] * len(self.inputs)
        read = places(spec.cls, recorded.edges[self.name])
        before = {(port.name, edge.stream if edge else ""): place for place, (port, edge) in enumerate(read)}
        same = [port.dead or _every(recorded, port.producer) == port.every for port in self.inputs]
        known = [before.get((port.port.name, port.stream)) for port in self.inputs]
        return [place if kept else None for place, kept in zip(known, same, strict=True)]

    def forget_new_inputs(self, count: int) -> None:
        """Remove inputs beyond the first `count` that were added to the class after the recording was made: nothing is
        connected to them, and `step` has a default."""
        ports = self.inputs
        while len(ports) > count and ports[-1].dead:
            parameter = inspect.signature(type(self.node).step).parameters[ports[-1].port.name]
            if parameter.default is inspect.Parameter.empty:
                break
            ports.pop()
            self.takes(self.counts[:-1])


class Player:
    """Runs nodes of a plan on a recording.

    plan     the recorded plan, the recorded plan with other settings, or another one
    running  names of the nodes that run; the streams of the others are played
    live     whether running nodes read the computed messages of one another (True) or the recorded ones (False)

    RecordingError: a node no longer fits the recording, or needs a stream that is neither played nor computed.
    """

    def __init__(self, recording: Stored, plan: Plan, running: Iterable[str], live: bool) -> None:
        self.recording, self.plan, self.live = recording, plan, live
        self.recorded = plan_of(recording)
        chosen = {name for name in running if not plan.graph.nodes[name].cls.hardware}  # a replay moves no device
        path = force_path(plan)
        self.parts = [ReplaySlot(plan, name, path, self.recorded) for name in plan.order if name in chosen]
        self.computed = {stream for part in self.parts for stream in part.streams} if live else set()
        self.played = {name: s.type for name, s in recording.streams.items() if name not in self.computed}
        self._readers: dict[str, list[Input]] = {}
        for part in self.parts:
            for port in part.inputs:
                if not port.dead:
                    self._readers.setdefault(port.stream, []).append(port)
                    self._check_input(part, port)
        self.kinds = {s: kind for s, kind in self.played.items() if s in self._readers}
        self.substituted = 0
        """Number of lost inputs that were replaced by the previous message."""
        self.missing: tuple[str, str, int] | None = None
        """Node, and stream and tick of the message, of the first of them."""
        self.restarts = {name: list(ticks) for name, ticks in recording.restarted.items()}
        self.rate, self.at = plan.graph.rate, 0

    def _check_input(self, part: ReplaySlot, port: Input) -> None:
        lack = self.recording.lack(port.stream)
        if port.stream in self.computed or not lack:
            return
        if self.live:
            raise RecordingError(
                f"node {part.name!r} reads the stream {port.stream!r}, which {lack}. Let {port.producer!r} run as well "
                f"(--only ... {port.producer}), or replay the whole graph."
            )
        if port.stream not in self.recording.streams:
            part.broken = f"stream {port.stream!r}, which it reads, {lack}"

    def start(self) -> None:
        """Start all nodes. NodeError: one raised."""
        for part in self.parts:
            part.start()
            if part.name in self.recording.late:
                part.node.replaces()

    def last(self, node: str) -> list[Message | None]:
        """The newest message of each output of a node, None before its first; empty for a node that does not run."""
        return next(([output.last for output in part.outputs] for part in self.parts if part.name == node), [])

    def notes(self) -> list[str]:
        """Lines of the nodes for the user, without duplicates."""
        return list(dict.fromkeys(text for part in self.parts for text in part.node.notes()))

    def stop(self) -> None:
        for part in self.parts:
            part.node.stop()

    def deliver_messages(self, tick: int, payloads: dict[str, bytes]) -> None:
        """Deliver the recorded messages of one tick. RecordingError: a message does not fit its type."""
        for stream, kind in self.kinds.items():
            payload = payloads.get(stream)
            if payload is not None:
                self._deliver(stream, self.recording.decode(stream, tick, payload, kind))

    def _deliver(self, stream: str, message: Message) -> None:
        for port in self._readers.get(stream, ()):
            port.put(message)
            if len(port.queue) > MOST:
                port.queue.popleft()

    def step(self, tick: int, payloads: dict[str, bytes], now: int | None = None) -> dict[str, bytes]:
        """Run all nodes that step at this tick; returns their encoded messages. NodeError: one raised.

        now  [ns] time of the tick; None: from the payloads
        """
        stepped = self._advance(tick, payloads, now)
        return {output.stream: pack(output.last) for part in stepped for output in part.outputs if output.last}

    def time_step(self, tick: int, payloads: dict[str, bytes]) -> tuple[int, int] | None:
        """Run all nodes that step at this tick; returns the sums of the durations and of the processor times of their
        steps [ns], None without a measurement. NodeError: one raised."""
        before = self._totals()
        if not self._advance(tick, payloads, None):
            return None
        wall, cpu = (after - earlier for after, earlier in zip(self._totals(), before, strict=True))
        return wall, cpu

    def _totals(self) -> tuple[int, int]:
        """Duration and processor time of all steps so far [ns]."""
        return sum(part.health.step.total for part in self.parts), sum(part.cpu.total for part in self.parts)

    def _advance(self, tick: int, payloads: dict[str, bytes], now: int | None) -> list[ReplaySlot]:
        self.deliver_messages(tick, payloads)
        if now is None:
            now = min((head_of(payload).time for payload in payloads.values()), default=0)
        return self.run(self.parts, tick, payloads, now)

    def run(self, parts: Iterable[ReplaySlot], tick: int, payloads: dict[str, bytes], now: int = 0) -> list[ReplaySlot]:
        """Run the nodes that step at this tick, and return them. MissingInput, NodeError."""
        self._payloads, self._now, self._stepped = payloads, now, list[ReplaySlot]()
        run_tick(parts, tick, self)
        return self._stepped

    def gather(self, part: ReplaySlot, tick: int) -> list[Message | None] | None:
        """The inputs of a step; sets its time. None: the node does not step. MissingInput."""
        recorded = [self._payloads[s] for s in part.streams if s in self._payloads] if part.as_recorded else []
        head = None
        if recorded:
            head = head_of(recorded[0])
            part.forget_new_inputs(len(head.used))
        elif self._was_recorded(part) or tick % part.every:
            return None
        messages: list[Message | None] = []
        for index, port in enumerate(part.inputs):
            message = self._input(part, index, port, tick, head)
            drives = head is None and part.drives(port)
            if message is None and (drives or not port.port.optional):
                return None
            messages.append(message)
        self.at = head.time if head else self._now
        if head is None and messages and messages[0] is not None and messages[0].tick == tick:
            self.at = messages[0].time
        due = self.restarts.get(part.name)
        if due and tick >= due[0]:  # the node was restarted here, with a new state
            due.pop(0)
            part.restart()
            part.node.replaces()
        self._wall, self._cpu = part.health.step.total, thread_time_ns()
        return messages

    def take_outputs(self, part: ReplaySlot, tick: int) -> None:
        """Deliver the outputs to the running nodes, and record the processor time."""
        if part.health.step.total > self._wall:  # the node is not asleep
            part.cpu.add(thread_time_ns() - self._cpu)
        self._stepped.append(part)
        for output in part.outputs:
            if self.live and output.last is not None:
                self._deliver(output.stream, output.last)

    def _was_recorded(self, part: ReplaySlot) -> bool:
        """Whether the node repeats its recorded steps, and the file has all of them."""
        known = self.recording.streams
        whole = (known[s].thin == 1 or known[s].kept == "heads" for s in part.streams if s in known)
        return part.as_recorded and any(whole)

    def _input(self, part: ReplaySlot, index: int, port: Input, tick: int, head: Head | None) -> Message | None:
        if port.dead:
            return None
        place = part.places[index]
        if head is not None and place is not None and place < len(head.used):
            wanted = head.used[place]
            if wanted < 0:
                return None
            message = port.of(wanted)
            if message is None and not self.live:
                raise MissingInput(f"{port.stream!r} of tick {wanted}")
            if message is None:
                self.substituted += 1
                self.missing = self.missing or (part.name, port.stream, wanted)
                message = port.newest(wanted)
            return message
        limit = needed_tick(tick, port.every, port.loop)
        return None if limit < 0 else port.newest(limit)


def _every(plan: Plan, node: str) -> int | None:
    """The divisor of a node of a plan; None: unknown node."""
    spec = plan.graph.nodes.get(node)
    return None if spec is None else spec.every


def plan_of(recording: Stored) -> Plan:
    """The plan of a recording. RecordingError: it cannot be read, or a class no longer exists."""
    try:
        spec = recording.about["plan"]
        check_trusted(*modules_of(*(str(node["class"]) for node in spec["nodes"])))
        planned = Plan.from_spec(spec, recorded_class)
        for name in planned.order:
            if planned.graph.nodes[name].observer:
                raise ValueError(f"{name!r} listens and does not run")
    except (GraphError, UntrustedError) as error:
        raise RecordingError(f"{recording.path}: {error}. `palpate info` reads the file without it.") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RecordingError(
            f"{recording.path}: its plan cannot be read ({error!r}); `palpate replay --graph GRAPH` needs none"
        ) from None
    return planned
