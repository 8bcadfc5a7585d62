"""FakeBus: runs one node in a test, without graph and sockets.

    bus = FakeBus(Series(), body=Surface(...))
    first, second = bus.publish(Proximity(...), Proximity(...))

The node is stepped as in a run, and messages are encoded and decoded both ways. The first input drives: each message of
that type runs a step; messages of other types are held. A multiple input takes a list of messages, or one message.
`drop`, `late`, `twice`, `swap` and `kill` simulate faults.
"""

from collections.abc import Sequence
from typing import Any

import msgspec

from palpate.engine.job import NodeJob
from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError, Slot, counts
from palpate.engine.tick import run_tick
from palpate.messages import Message, pack, unpack
from palpate.nodes.base import Node, Port, inputs, outputs

Given = Message | Sequence[Message | None] | None


class FakeBus:
    """Publishes messages to one node and returns its outputs.

    node  a node; it is started here
    rate  [Hz] base rate: the k-th driving message gets tick k and time k/rate unless it has a tick and time
    held  initial values of the held inputs, by port name
    """

    def __init__(self, node: Node, rate: float = 1000.0, **held: Given) -> None:
        self.node = node
        self.rate = rate
        self.ports = {} if node.paced and not inputs(type(node)) else {p.name: p for p in inputs(type(node))}
        self.held: dict[str, Given] = {name: [] if port.many else None for name, port in self.ports.items()}
        self.tick = self.at = 0
        self._drop = 0
        self._delay = 0.0
        self._twice = self._swap = False
        self._waiting: list[Message] | None = None
        self._dead: set[str] = set()
        name, kinds = type(node).__name__, outputs(type(node))
        streams = (name,) if len(kinds) == 1 else tuple(f"{name}.{kind.__name__}" for kind in kinds)
        self.slot = Slot(NodeJob(name, "", {}, 1, (), streams), node, ())
        try:
            self.slot.start()
        except NodeError as fault:
            raise _cause(fault) from None
        for name, message in held.items():
            self.hold(name, message)

    @property
    def driver(self) -> str | None:
        return None if self.node.paced else next(iter(self.ports), None)

    def hold(self, name: str, message: Given) -> None:
        """Set the value of a held input."""
        if name not in self.ports:
            raise KeyError(f"{type(self.node).__name__} has no input {name!r}; inputs: {', '.join(self.ports)}")
        self.held[name] = _stamp_message(message, self.ports[name])

    def drop(self, count: int = 1) -> None:
        """Lose the next `count` driving messages."""
        self._drop += count

    def late(self, delay: float) -> None:
        """Add `delay` seconds to the time of the next driving message."""
        self._delay = delay

    def twice(self) -> None:
        """Deliver the next driving message twice."""
        self._twice = True

    def swap(self) -> None:
        """Deliver the next two driving messages in reverse order."""
        self._swap = True

    def kill(self, name: str) -> None:
        """Simulate the death of this input's sender: the input stays None."""
        self.hold(name, None)
        self._dead.add(name)

    def publish(self, *messages: Message | list[Message]) -> list[Any]:
        """Send messages, or lists of them to a multiple input, in order; returns the outputs of the steps that they
        run (a tuple if the node has several outputs)."""
        answers: list[Any] = []
        for message in messages:
            port = self._port(message)
            if port != self.driver:
                if port not in self._dead:
                    self.hold(port, message)
                continue
            for arrived in self._arrivals(message):
                answers.append(self._step(arrived))
        return answers

    def run(self, count: int = 1, **held: Given) -> list[Any]:
        """Run `count` steps of a paced node, or of a node on its held inputs."""
        for name, message in held.items():
            self.hold(name, message)
        return [self._step(None) for _ in range(count)]

    def _port(self, message: Message | list[Message]) -> str:
        one = message[0] if isinstance(message, list) else message
        fitting = [p.name for p in self.ports.values() if isinstance(one, p.type)]
        if not fitting:
            takes = ", ".join(f"{p.name}: {p.expects}" for p in self.ports.values())
            raise TypeError(f"{type(self.node).__name__} takes no {type(one).__name__}; inputs: {takes}")
        return fitting[0]

    def _arrivals(self, given: Message | list[Message]) -> list[list[Message]]:
        first = given[0] if isinstance(given, list) else given
        tick = first.tick if first.tick >= 0 else self.tick
        time = first.time if first.time >= 0 else nanoseconds(tick, self.rate)
        self.tick = tick + 1
        time += round(self._delay * 1e9)
        self._delay = 0.0
        several = given if isinstance(given, list) else [given]
        message = [msgspec.structs.replace(each, tick=tick, time=time) for each in several]
        if self._drop:
            self._drop -= 1
            return []
        if self._swap and self._waiting is None:
            self._waiting = message
            return []
        arrivals = [message]
        if self._waiting is not None:
            arrivals, self._waiting, self._swap = [message, self._waiting], None, False
        if self._twice:
            self._twice = False
            arrivals = arrivals * 2
        return arrivals

    def _step(self, driving: list[Message] | None) -> Any:
        given = dict(self.held)
        if driving is not None:
            name, port = next(iter(self.ports.items()))
            given[name] = _stamp_message([*driving] if port.many else driving[0], port)
            tick, self.at = driving[0].tick, driving[0].time
        else:
            tick, self.at = self.tick, nanoseconds(self.tick, self.rate)
            self.tick += 1
        messages = self._inputs = list[Message | None]()
        connected: list[str] = []
        for name, value in given.items():
            several = [value] if value is None or isinstance(value, Message) else value
            messages += several
            connected += [name] * len(several)
        if (given_counts := counts(type(self.node), connected)) != self.slot.counts:
            self.slot.takes(given_counts)
        try:
            run_tick([self.slot], tick, self)
        except NodeError as fault:
            raise _cause(fault) from None
        sent = [unpack(pack(output.last), output.kind) for output in self.slot.outputs if output.last is not None]
        return tuple(sent) if len(sent) != 1 else sent[0]

    def gather(self, slot: Slot, tick: int) -> list[Message | None]:
        """The inputs of a step, for `engine.tick`."""
        return self._inputs

    def take_outputs(self, slot: Slot, tick: int) -> None:
        """Nothing to send: the outputs are read from the slot."""


def _stamp_message(given: Given, port: Port) -> Given:
    if port.many:
        several = [given] if isinstance(given, Message) else given or []
        return [None if each is None else unpack(pack(each), port.type) for each in several]
    assert given is None or isinstance(given, Message), f"{port.name} takes one {port.type.__name__}"
    return None if given is None else unpack(pack(given), port.type)


def _cause(fault: NodeError) -> BaseException:
    return fault.cause if isinstance(fault.cause, BaseException) else TypeError(fault.cause)
