"""The loop of one worker process: its nodes in order, tick by tick, on the simulated or on the real clock.

Simulated clock: each node waits for exactly the messages that the rules of `schedule` name, so that the answer does
not depend on the placement. Every worker runs its nodes in the graph's order, which excludes deadlock.

Real clock: the paced node sets the time, the others follow the arrival of their driving input. A node waits up to one
period for inputs of the same tick from the force path and holds the newest message of all others; `used` records it.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

from palpate.launch.bus import CONTROL, Bus, order
from palpate.launch.clock import now, sleep_until
from palpate.launch.job import Job
from palpate.launch.load import load_class
from palpate.launch.schedule import nanoseconds, needed, next_run
from palpate.launch.slot import Input, NodeFault, ObserverSlot, Output, Slot
from palpate.messages import Message, MessageError, pack, unpack
from palpate.nodes.base import Node, Observer, Stream

BURST = 16  # ticks between two bursts to the observers
REPORT = 200_000_000  # [ns] between two health reports


class Ended(Exception):
    """The last tick has been run, or the launcher has told us to stop."""


class Worker:
    """The nodes of one group.

    job     what to run
    bus     sockets to the other workers; None when all nodes are here
    report  takes a report (a dict with `kind`) for the launcher
    """

    def __init__(self, job: Job, bus: Bus | None, report: Callable[[dict], None]) -> None:
        self.job, self.bus, self.report = job, bus, report
        self.slots = [Slot(given, self._node(given), job.external) for given in job.nodes]
        known = {output.stream: output for slot in self.slots for output in slot.outputs}
        for slot in self.slots:
            slot.wire(known)
        self.routes: dict[bytes, tuple[type[Message], list[Input]]] = {}
        for slot in self.slots:
            for port in slot.inputs:
                if not port.dead and port.output is None:
                    topic = port.stream.encode() + b"\0"
                    self.routes.setdefault(topic, (port.kind, []))[1].append(port)
        self.observers = [ObserverSlot(given, self._node(given)) for given in job.observers]
        self.mute: set[str] = set()
        self.stopping = False
        self.last = job.ticks - 1 if job.ticks is not None else None
        self.tick = -1
        self._period = 1e9 / job.rate
        self._reported = 0
        self._burst = 0
        self._started: list[Node] = []
        self._heard: dict[str, Output] = known
        self._origin = 0

    @staticmethod
    def _node(job) -> Node:
        try:
            node = load_class(job.cls)(**job.settings)
        except Exception as error:
            raise NodeFault(job.name, "settings", error) from error
        node.wanted = frozenset(job.wanted) if getattr(job, "wanted", None) is not None else None
        return node

    # -- life ----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start all nodes. NodeFault: one raised."""
        for slot in self.slots:
            self.report({"kind": "starting", "node": slot.name})
            self._started.append(slot.node)
            slot.start()
        for observer in self.observers:
            assert isinstance(observer.node, Observer)
            self._started.append(observer.node)
            heard = tuple(
                Stream(stream, load_class(given.type), given.producer, given.every)
                for stream, given in observer.streams.items()
            )
            try:
                observer.node.listen(heard, self.job.about)
                observer.node.start()
            except Exception as error:
                raise NodeFault(observer.name, "start", error) from error
            for stream in observer.streams:
                if stream in self._heard:
                    self._heard[stream].listeners.append(observer)

    def stop(self) -> None:
        """Stop all nodes that were started, the last one first. The first fault is raised when all have stopped."""
        fault = None
        while self._started:
            node = self._started.pop()
            try:
                node.stop()
            except Exception as error:
                name = next(s.name for s in (*self.slots, *self.observers) if s.node is node)
                fault = fault or NodeFault(name, "stop", error)
        if fault:
            raise fault

    def run(self, origin: int) -> None:
        """Run all ticks. `origin` [ns] is the time of tick 0 on the machine's monotonic clock.

        NodeFault: a node failed.
        """
        self._origin = origin
        self._mark_heard()
        gc.collect()
        gc.freeze()
        if self.job.clock == "real":
            gc.disable()
        try:
            if not self.slots:
                self._listen()
            elif self.job.clock == "real":
                self._run_real()
            else:
                self._run_simulated()
        except Ended:
            pass
        finally:
            gc.enable()
            self._flush()
            self._report_health()

    # -- simulated clock -----------------------------------------------------------------------------------------

    def _run_simulated(self) -> None:
        rate, pace = self.job.rate, self.job.pace
        paced = pace is not None and any(slot.node.paced for slot in self.slots)
        nominal = {slot.name: slot.every / rate for slot in self.slots}
        leads = any(slot.node.paced for slot in self.slots)
        tick, begun = 0, now()
        while self.last is None or tick <= self.last:
            self.tick = tick
            if paced:
                sleep_until(self._origin + round(nanoseconds(tick, rate) / pace))
            at = nanoseconds(tick, rate)
            for slot in self.slots:
                if tick % slot.every or slot.name in self.mute:
                    continue
                messages: list[Message | None] = []
                for port in slot.inputs:
                    need = -1 if port.dead else needed(tick, port.every, port.loop)
                    messages.append(None if need < 0 else port.at(need) or self._await(slot, port, need))
                if slot.name not in self.mute:
                    slot.step(tick, at, messages, nominal[slot.name])
                    self._send(slot)
            self._housekeep(tick)
            if leads:
                ended = now()
                self.slots[0].health.age.add(ended - begun)
                begun = ended
                if self.stopping:
                    self._agree_on_the_end(tick)
            tick += 1

    def _await(self, slot: Slot, port: Input, need: int) -> Message | None:
        while True:
            self._receive(block=True)
            if port.dead or slot.name in self.mute:
                return None
            found = port.at(need)
            if found is not None:
                return found
            if self.last is not None and self.tick > self.last:
                raise Ended

    def _agree_on_the_end(self, tick: int) -> None:
        """Every paced worker tells where it is and waits; the launcher names the last tick, the largest of these."""
        self.stopping = False
        self.last = tick if self.bus is None else None
        self.report({"kind": "paused", "tick": tick})
        while self.last is None:
            self._receive(block=True)

    # -- real clock ----------------------------------------------------------------------------------------------

    def _run_real(self) -> None:
        lead = self.slots[0]
        if any(slot.node.paced for slot in self.slots):
            lead = next(slot for slot in self.slots if slot.node.paced)
            begin = self._pace
        else:
            begin = self._follow
        nominal = {slot.name: slot.every / self.job.rate for slot in self.slots}
        while True:
            started = begin(lead)
            if started is None:
                continue
            tick, at, moment = started
            self.tick = tick
            deadline = moment + round(self._period)
            for slot in self.slots:
                if tick < slot.due or slot.name in self.mute:
                    continue
                messages = self._gather(slot, tick, deadline, slot is lead)
                if messages is None:
                    slot.health.lost += 1
                    continue
                slot.due = next_run(tick, slot.every)
                driver = messages[0] if slot.driver is not None else None
                slot.step(tick, driver.time if driver is not None else at, messages, nominal[slot.name])
                self._send(slot)
                slot.health.age.add(max(0, now() - self._origin - at))
            self._housekeep(tick)
            if self.last is not None and tick >= self.last:
                raise Ended

    def _pace(self, lead: Slot) -> tuple[int, int, int] | None:
        """Wait for the next tick of the clock; ticks whose whole period has passed are counted late and left out."""
        tick = self.tick + 1
        late = sleep_until(self._origin + round(tick * self._period))
        if late > self._period:
            skipped = int(late // self._period)
            lead.health.late += skipped
            tick += skipped
        if self.stopping:
            raise Ended
        if self.bus is not None:
            while self.bus.waiting():
                self._receive(block=False)
        moment = now()
        return tick, moment - self._origin, moment

    def _follow(self, lead: Slot) -> tuple[int, int, int] | None:
        """Wait for the next driving message; of several that wait, the newest counts and the others are lost."""
        port = lead.inputs[0]
        if port.dead or lead.name in self.mute:
            self._receive(block=True)
            if self.stopping:
                raise Ended
            return None
        while not port.queue:
            self._receive(block=True)
            if self.stopping:
                raise Ended
            if port.dead:
                return None
        while self.bus is not None and self.bus.waiting():
            self._receive(block=False)
        newest = port.queue[-1]
        if newest.tick <= self.tick:  # a duplicate, or out of order
            port.queue.clear()
            lead.health.lost += 1
            return None
        lead.health.lost += len(port.queue) - 1
        return newest.tick, newest.time, now()

    def _gather(self, slot: Slot, tick: int, deadline: int, leading: bool) -> list[Message | None] | None:
        """The inputs of a step; None when the driving one has not come in time."""
        messages: list[Message | None] = []
        for port in slot.inputs:
            if port.dead:
                messages.append(None)
                continue
            need = needed(tick, port.every, port.loop)
            drives = port is slot.driver
            found = port.newest(tick - 1 if port.loop else tick)
            if (port.waits or drives) and not port.loop and not (leading and drives):
                while (found is None or found.tick < need) and port.output is None and now() < deadline:
                    self._receive(block=True)
                    if port.dead or self.stopping:
                        break
                    found = port.newest(tick)
            if drives and (found is None or (found.tick < need and port.every == 1)):
                return None
            if found is not None and found.tick < need:
                slot.health.held += 1
                limit = max(self.job.stale, 3 * port.every / self.job.rate) * 1e9
                age = now() - port.arrived if port.output is None else (tick - found.tick) * self._period
                if age > limit:
                    found = None
            messages.append(found)
        if any(m is None and not p.port.optional for m, p in zip(messages, slot.inputs, strict=True)):
            return None
        return messages

    # -- observers in a worker of their own ----------------------------------------------------------------------

    def _listen(self) -> None:
        """Take messages for the observers until all streams have come to their end, or the launcher has stopped us
        and no more frames come."""
        assert self.bus is not None
        while not self._heard_all():
            data = self._take(block=True)
            if data:
                topic, _, payload = data.partition(b"\0")
                stream = topic.decode()
                self.tick = unpack(payload, Message).tick
                for observer in self.observers:
                    if stream in observer.streams:
                        observer.observe(stream, self.tick, payload)
            elif data is None and self.stopping:
                return
            self._housekeep(self.tick)

    def _heard_all(self) -> bool:
        """Whether every stream has brought its last message; on the real clock nobody knows which that is."""
        if self.last is None or self.job.clock == "real":
            return False
        return all(
            observer.last[stream] >= needed(self.last, given.every, False)
            for observer in self.observers
            for stream, given in observer.streams.items()
        )

    # -- messages ------------------------------------------------------------------------------------------------

    def _send(self, slot: Slot) -> None:
        for output in slot.outputs:
            if not (output.external or output.observed or output.listeners):
                continue
            message = output.last
            assert message is not None
            payload = pack(message)
            for observer in output.listeners:
                observer.observe(output.stream, message.tick, payload)
            if self.bus is not None and (output.external or output.observed):
                data = output.topic + payload
                if output.external:
                    self.bus.force.send(data)
                if output.observed:
                    self.bus.keep(data)

    def _receive(self, block: bool) -> None:
        """Take one frame from the inbox and hand it to its ports; control frames act at once."""
        data = self._take(block)
        if not data:
            return
        topic, zero, payload = data.partition(b"\0")
        route = self.routes.get(topic + zero)
        if route is None:
            return
        try:
            message = unpack(payload, route[0])
        except MessageError as error:
            self.report({"kind": "rubbish", "stream": topic.decode(errors="replace"), "text": str(error)})
            return
        arrived = now() if self.job.clock == "real" else 0
        for port in route[1]:
            port.put(message, arrived)

    def _take(self, block: bool) -> bytes | None:
        """The next frame; None when none came in time, an empty one after a control frame."""
        assert self.bus is not None
        data = self.bus.receive(block)
        if data is None:
            if now() - self._reported > REPORT:
                self._flush()
                self._report_health()
            return None
        if data[:1] == CONTROL:
            self._control(order(data))
            return b""
        return data

    def _control(self, given: dict) -> None:
        match given["do"]:
            case "stop":
                self.stopping = True
            case "end":
                self.last = given["tick"]
            case "dead" | "alive":
                self._bury(set(given["nodes"]), set(given["mute"]), given["do"] == "dead")
            case "quit":
                raise Ended

    def _bury(self, nodes: set[str], mute: set[str], dead: bool) -> None:
        """These nodes are gone, or back again: their streams end. Nodes that cannot do without them fall silent."""
        self.mute = self.mute | mute if dead else self.mute - mute
        for slot in self.slots:
            for port in slot.inputs:
                if port.producer in nodes | mute:
                    port.dead = dead
                    port.queue.clear()
                    port.message = None

    # -- housekeeping --------------------------------------------------------------------------------------------

    def _housekeep(self, tick: int) -> None:
        self._burst += 1
        if self._burst < BURST:
            return
        self._burst = 0
        self._flush()
        if now() - self._reported > REPORT:
            self._report_health()

    def _flush(self) -> None:
        if self.bus is not None and self.bus.flush():
            self._mark_heard()

    def _mark_heard(self) -> None:
        if self.bus is not None:
            for output in self._heard.values():
                output.observed = self.bus.heard(output.topic)

    def _report_health(self) -> None:
        self._reported = now()
        nodes = {slot.name: slot.health.report() for slot in (*self.slots, *self.observers)}
        self.report({"kind": "health", "tick": self.tick, "nodes": nodes})
