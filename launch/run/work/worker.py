"""One worker: its nodes, their connections to one another and to other workers, its observers and reports.

The loops over the ticks are in `simulated` and `real`, one for each clock; `loops.observe` serves only observers.
"""

import contextlib
import math
import sys
from collections.abc import Callable
from functools import partial

from palpate.engine import clock
from palpate.engine.clock import POLL_INTERVAL, Silence
from palpate.engine.job import Job
from palpate.engine.schedule import nanoseconds
from palpate.engine.segment import CompiledSegment, kernels, segments, table_runner
from palpate.engine.slot import NodeError, Output, RemoteStream, Slot, make
from palpate.launch.run.hop.blocks import picker
from palpate.launch.run.hop.hop import Hop, load, suits
from palpate.launch.run.hop.pauses import Pauses, Task
from palpate.launch.run.reports import Beat, Close, End, Gone, Note, Quit, Report, Starting, Stop
from palpate.launch.run.wire.audience import Audience
from palpate.launch.run.wire.bus import Bus
from palpate.launch.run.wire.inlet import LONGEST_MESSAGE
from palpate.launch.run.work.compiling import compiling
from palpate.launch.run.work.expiry import absences, end_inputs, permitted_age
from palpate.launch.run.work.far_clock import FarClock
from palpate.launch.run.work.heartbeat import Heartbeat
from palpate.messages import MessageError, pack, unpack
from palpate.nodes.base import Block, CompiledNode, Node

OVERHEARD = 1000  # frames for observers handled in a row before the nodes run again
ORPHANED = 5_000_000_000  # [ns] without an order of the launcher, time without scheduling excluded
LOOK = 5_000_000  # [ns] between two polls of orders and readers while messages arrive


class EndedError(Exception):
    """The last tick was run, or the launcher ordered the end."""


class Worker:
    """The nodes of one group.

    job     its nodes and observers
    bus     sockets to the other workers; None: all nodes are here
    report  takes a report for the launcher
    alone   started by hand: it ends without heartbeats of the launcher
    """

    def __init__(self, job: Job, bus: Bus | None, report: Callable[[Report], None], alone: bool = False) -> None:
        self.job, self.bus, self.report, self._alone = job, bus, report, alone
        self.slots = [Slot(given, make(given), job.external) for given in job.nodes]
        self.outputs = {output.stream: output for slot in self.slots for output in slot.outputs}
        self.feeds: dict[str, RemoteStream] = {}
        for slot in self.slots:
            slot.wire(self.outputs)
            self._feed(slot)
        self.parts: list[Slot | CompiledSegment] = list(self.slots)
        """What runs, in order: after the start, consecutive compiled nodes are merged into segments."""
        self.audience = Audience(job, bus.end_group if bus is not None else None)
        self._real = job.clock == "real"
        self.stopping = False
        self.last = job.ticks - 1 if job.ticks is not None else None
        self.agreed = True  # whether the last tick is known: not between `Paused` and `End`
        self.tick = -1
        self.awaits: tuple[str, int] | None = None
        """Stream and tick of the message that it waits for, from the first `POLL_INTERVAL` on."""
        self.since = 0
        self._polled = 0
        self.heartbeat = Heartbeat(self)
        self._launcher = Silence()
        self.launcher_clock = FarClock() if alone else None
        self.origin = 0
        """[ns] Time of tick 0 on the clock of this machine."""
        self.pauses = Pauses(job)
        self._started: list[tuple[str, Node]] = []
        self.hop: Hop | None = None
        """Set at tick 0 if all nodes are compiled and all connections stay on this machine."""
        if bus is not None:
            bus.sends(self.outputs)

    def _feed(self, slot: Slot) -> None:
        for port in slot.inputs:
            if port.dead or port.output is not None or self.bus is None:
                continue
            if port.stream not in self.feeds:
                self.feeds[port.stream] = RemoteStream(
                    port.stream, port.kind, port.producer, self.bus.inlet(port.stream)
                )
            port.feed = self.feeds[port.stream]
            port.feed.ports.append(port)

    # -- life ----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start all nodes. NodeError: one raised."""
        names = [slot.name for slot in self.slots[:1]]

        def begin(name: str, node: Node, start: Callable[[], None]) -> None:
            """Start one node or observer; if it fails, stop it, so that it releases its resources."""
            names.append(name)
            try:
                start()
            except BaseException:
                with contextlib.suppress(BaseException):  # also SystemExit, which would replace the fault
                    node.stop()
                raise
            self._started.append((name, node))

        compiled = sum(isinstance(slot.node, CompiledNode) for slot in self.slots)
        with compiling(lambda count: self.report(Starting(names[-1], count)), self._compilations()):
            if compiled > 1:
                table_runner(self._real)  # before the second process begins, as both need its kernels
            for slot in self.slots:
                self.report(Starting(slot.name))
                begin(slot.name, slot.node, slot.start)
            for observer in self.audience.slots:
                begin(observer.name, observer.node, partial(self.audience.start, observer, self.outputs))
            job, ages = self.job, partial(permitted_age, self.job)
            self.parts = segments(
                self.slots, lambda own: CompiledSegment(own, job.rate, self._real, ages, self._deliver_block)
            )
            if self.bus is not None and self.bus.local and suits(self.parts):
                load(self._real)
                picker()
        if self.bus is None and not self._real:
            for slot in self.slots:
                for output in slot.outputs:
                    output.period = math.gcd(*(taken.node.period(output.stream) for taken in output.listeners))
                slot.period = math.gcd(*(output.period for output in slot.outputs))
                slot.sends = 0 if slot.period else sys.maxsize

    def _compilations(self) -> list[Callable[[], object]]:
        """Calls for a second process, which compile the kernels: first those of nodes that `start` does not step,
        then of the others from the last backwards."""
        unstepped: list[Callable[[], object]] = []
        others: list[Callable[[], object]] = []
        for slot in self.slots:
            kind, acts = type(slot.node), slot.node.hardware or slot.node.sink
            if issubclass(kind, CompiledNode):
                (unstepped if acts else others).append(partial(kernels, kind, slot.sleeps))
            elif kind.__module__.startswith("palpate.nodes.") and not acts and len(self.slots) > 1:
                others.append(slot.start)
        return unstepped + others[::-1]

    @property
    def started(self) -> int:
        """Number of running nodes and observers."""
        return len(self._started)

    def stop(self) -> None:
        """Stop all started nodes, the last one first, then raise the first fault."""
        fault = None
        for observer in self.audience.begun:
            try:
                observer.take()
            except NodeError as error:
                fault = fault or error
        while self._started:
            name, node = self._started.pop()
            try:
                node.stop()
                self.pass_notes()
            except NodeError as error:
                fault = fault or error
            except BaseException as error:
                fault = fault or NodeError(name, "stop", error)
        if fault:
            raise fault

    def begin(self, origin: int) -> None:
        """Prepare tick 0: senders, subscriptions, and the first health reports. `origin` [ns]: time of tick 0."""
        self.origin = origin
        if self.bus is not None:
            for feed in self.feeds.values():
                feed.inlet = self.bus.inlet(feed.stream)
            for stream in self.job.external:
                self.outputs[stream].send = self.bus.sender(stream, self.poll).send
            if self.bus.local and suits(self.parts):
                hop = Hop(self)
                self.hop = hop if hop.usable else None
        self._mark_heard()
        for slot in self.slots:
            slot.follows = self._real and slot.driver is not None
        for part in self.parts:
            if isinstance(part, CompiledSegment):
                part.refresh()
                # for observers in other processes: a block of many ticks costs little more than one of a single tick
                outputs = [output for slot in part.slots for output in slot.outputs]
                part.collects = self._real and not self.audience.begun and not any(o.external for o in outputs)
        for observer in self.audience.begun:
            observer.node.take_origin(origin)
        if self._real:
            self.since = max(0, int((clock.now() - origin) * 1e-9 * self.job.rate))
            self.tick = max(self.tick, self.since - 1)  # ignore messages from before a restart
            if self.since > 0:
                for slot in self.slots:
                    slot.node.replaces()
        for slot in self.slots:
            self.heartbeat.tell_observers(slot, slot.health.report())

    def end_streams(self) -> None:
        """After the last step: send all messages, and the last health of the nodes."""
        self._flush()
        self.heartbeat.send()
        if self.bus is not None:
            self.bus.final = [pack(self.heartbeat.health(slot, slot.health.report())) for slot in self.slots]

    def offer_end(self) -> None:
        """Send the end of the streams to observers that have room for it, while the observers here still receive."""
        if self.bus is not None:
            self.bus.offer_end()

    def finish(self) -> None:
        """Send buffered frames and the last report; observers first, so that the report counts all their messages."""
        self.end_streams()
        for slot in self.slots:
            if slot.health.absent:
                self.report(Note(absences(slot), slot.name))
        self._flush()

    # -- messages ------------------------------------------------------------------------------------------------

    def send(self, slot: Slot) -> None:
        """Send the outputs of a step; a segment delivers those of its nodes itself."""
        if slot.joined:
            return
        if slot.period > 1:
            slot.sends = slot.health.tick - slot.health.tick % slot.period + slot.period
        for output in slot.outputs:
            if not (output.external or output.observed or output.listeners):
                continue
            message = output.last
            assert message is not None
            if output.period != 1 and (not output.period or message.tick % output.period):
                continue
            try:
                payload = pack(message)
            except Exception as error:  # a custom type may contain anything
                raise NodeError(slot.name, f"step at tick {message.tick}", error) from error
            self._deliver_answer(output, message.tick, payload)

    def _deliver_answer(self, output: Output, tick: int, payload: bytes) -> None:
        """Pass an encoded message to its readers."""
        for observer in output.listeners:
            observer.pending.append((output.stream, tick, payload))
            if self._real:  # a burst would delay the next tick
                observer.take()
        if self.bus is not None:
            self._publish(self.bus, output, tick, payload)

    def _deliver_block(self, block: Block) -> None:
        """Pass the messages of a segment to their readers."""
        if self.bus is not None:
            for stream, tick, payload in block.messages():
                output = self.outputs[stream]
                if output.send is not None:
                    self.check_length(output, tick, payload)
                    output.send(payload)
        self.show(block)

    def show(self, block: Block) -> None:
        """Pass the messages of a segment to the observers, here and in other processes."""
        for observer in self.audience.begun:
            observer.take_block(block)
            if self._real:
                observer.take()
        if self.bus is not None:
            self.bus.keep_block(block, [self.outputs[stream] for stream in block.streams])

    def _publish(self, bus: Bus, output: Output, tick: int, payload: bytes) -> None:
        """Send an encoded message to its readers in other processes."""
        if output.send is not None:
            self.check_length(output, tick, payload)
            output.send(payload)
        if output.observed:
            bus.keep(output.topic + payload)

    def check_length(self, output: Output, tick: int, payload: bytes) -> None:
        """NodeError: the message is longer than a reader accepts."""
        if len(payload) > LONGEST_MESSAGE:
            text = f"a {output.kind.__name__} of {len(payload)} bytes, longest {LONGEST_MESSAGE}"
            raise NodeError(output.stream.partition(".")[0], f"step at tick {tick}", text)

    def now(self) -> int:
        """The time of the machine [ns]."""
        return clock.now()

    def wait(self, feed: RemoteStream, deadline: int | None = None) -> bool:
        """Wait for a message of a stream, for about `POLL_INTERVAL` or until a deadline [ns]; returns whether one
        arrived. Otherwise poll all sockets."""
        if self.hop is not None:
            self.hop.release()
        payloads = feed.inlet.wait() if deadline is None else feed.inlet.wait_until(deadline)
        if not payloads:
            self.poll()
            return False
        for payload in payloads:
            self.deliver(feed, payload)
        return True

    def drain(self) -> None:
        """Read all received messages."""
        if self.hop is not None:
            self.hop.release()
        if self.bus is not None:
            for inlet in self.bus.sweep():
                feed = self.feeds[inlet.stream]
                for payload in inlet.take():
                    self.deliver(feed, payload)

    def listen(self) -> None:
        """After ticks in compiled code: serve readers, note orders, and connect again to senders that have ended."""
        if self.bus is not None and self.hop is not None:
            self.bus.sweep()
            if self.hop.lacks_sender():
                self.drain()

    def deliver(self, feed: RemoteStream, payload: bytes) -> None:
        """Pass a received message to the ports that read it."""
        try:
            message = feed.decode(payload)
        except Exception:  # not of the stream's type; on the real clock it counts as lost
            if not self._real:  # a node would wait for this message forever
                try:
                    unpack(payload, feed.kind)
                except MessageError as error:
                    raise NodeError(feed.producer, f"stream {feed.stream!r}", error) from error
            return
        for port in feed.ports:
            port.put(message)

    def overhear(self, wait: bool) -> bool:
        """Pass one frame of another worker to the observers here; returns whether there was one."""
        assert self.bus is not None
        data = self.bus.overheard(wait)
        if data is None:
            return False
        tick = self.audience.handle_frame(data)
        if not self.slots:
            self.tick = max(self.tick, tick)
        return True

    # -- polling -------------------------------------------------------------------------------------------------

    def poll(self) -> None:
        """While no node can run: read messages and orders, and send heartbeats. EndedError: `Quit` was ordered."""
        # Read all streams: the awaited message may depend on a sender that this worker blocks.
        self.drain()
        self.check_orders()
        self._overhear_some()
        if self.heartbeat.due(clock.now()):
            self._flush()
            self.heartbeat.send()

    def pause(self) -> None:
        """Wait up to `POLL_INTERVAL` for an order."""
        self.check_orders(POLL_INTERVAL)
        self.poll()

    def check_orders(self, wait: int = 0) -> None:
        """Execute the orders that have arrived or arrive within `wait` [ms]. EndedError: `Quit`."""
        if self.bus is None:
            return
        while (order := self.bus.order(wait)) is not None:
            self._launcher.reset()
            wait = 0
            match order:
                case Stop():  # observers continue until all senders have ended
                    self.stopping = self.stopping or bool(self.slots)
                case Close(lost):
                    self.stopping = True
                    self.audience.lost |= set(lost)
                case End(tick):
                    self.last, self.agreed = tick, True
                case Gone(nodes, blocked, back):
                    self._handle_deaths(set(nodes), set(blocked), back)
                case Quit() if self.slots:
                    raise EndedError
                case Beat() if self.launcher_clock is not None:
                    self.launcher_clock.hear(order.sent)
                    self.origin = self.launcher_clock.corrected(self.origin)
        if self._alone and self._launcher.poll() > ORPHANED:
            raise NodeError("", "launcher", "nothing was heard of it for 5 s")

    def _handle_deaths(self, nodes: set[str], blocked: set[str], back: bool) -> None:
        """End the streams of dead nodes, or resume those of restarted ones; block or unblock nodes that need them."""
        if self.hop is not None:
            self.hop.release()
        end_inputs(self.slots, nodes, blocked, back)
        for part in self.parts:
            if isinstance(part, CompiledSegment):
                part.refresh()

    def _overhear_some(self) -> None:
        if self.bus is not None and self.audience.slots:
            for _ in range(OVERHEARD):
                if not self.overhear(wait=False):
                    break

    # -- housekeeping --------------------------------------------------------------------------------------------

    def housekeep(self, ticks: int = 1) -> None:
        """After some ticks: every few ticks send to observers and launcher. EndedError: `Quit` was ordered."""
        task = self.pauses.choose(ticks, self.heartbeat.begun)
        if task is Task.WAIT:
            return
        if task is Task.SIGN:
            self.heartbeat.send_part()
            return
        moment = clock.now()
        due = self.heartbeat.due(moment)  # slow nodes must also send heartbeats
        if task is Task.NONE and not due:
            return
        self.pauses.begin_burst()
        if moment - self._polled > LOOK:
            self._polled = moment
            if self.slots:
                if self.bus is not None:
                    self.bus.sweep()
                self.check_orders()
                self._overhear_some()
            if self.bus is not None and self.bus.update_listeners():
                self._mark_heard()
        self._flush(hand_over=not self.pauses.unsent, rest=False)
        self.pauses.unsent = False
        if due and self._real:
            self.heartbeat.begin()
        elif due:
            self.heartbeat.send()

    def _flush(self, hand_over: bool = True, rest: bool = True) -> None:
        """Send the buffered messages to the observers; `hand_over`: also those in the journals; `rest`: see
        `Bus.flush`."""
        for part in self.parts:
            if isinstance(part, CompiledSegment) and hand_over:
                part.hand_over()
        for observer in self.audience.begun:
            observer.take()
        if self.bus is not None:
            self.bus.flush(self._poll_while_full, rest)

    def _poll_while_full(self) -> None:
        """While the buffers of observers are full: handle orders and send heartbeats."""
        awaits, self.awaits = self.awaits, None  # the message may have arrived
        try:
            if self.bus is not None:
                self.bus.sweep()
            self.check_orders()
            if self.heartbeat.due(clock.now()):
                self.heartbeat.send()
        finally:
            self.awaits = awaits

    def _mark_heard(self) -> None:
        if self.bus is not None:
            for output in self.outputs.values():
                output.observed = self.bus.has_reader(output.stream)
            for part in self.parts:
                if isinstance(part, CompiledSegment):
                    part.listen()

    def pass_notes(self) -> None:
        """Report the new notes of all nodes."""
        time = nanoseconds(self.tick, self.job.rate) * 1e-9 if self.tick > 0 else 0.0
        nodes = [*((s.name, s.node) for s in self.slots), *((s.name, s.node) for s in self.audience.begun)]
        for name, node in nodes:
            try:
                notes = node.notes()
            except Exception as error:
                raise NodeError(name, "notes", error) from error
            for text in notes:
                self.report(Note(text, name, time))
