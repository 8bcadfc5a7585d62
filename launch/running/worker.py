"""What one worker process holds: its nodes, the ways between them and the bus, its observers, its reports.

The loops over the ticks are apart, one for each clock: `simulated`, `real`; `listen` serves observers alone.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

from palpate.launch.loading.load import load_class
from palpate.launch.running.bus import CONTROL, HEALTH, Bus, frame, order
from palpate.launch.running.clock import now
from palpate.launch.running.ended import Ended
from palpate.launch.running.health import message
from palpate.launch.running.job import Job, NodeJob, ObserverJob
from palpate.launch.running.listen import hand_over, listen
from palpate.launch.running.real import run_real
from palpate.launch.running.simulated import run_simulated
from palpate.launch.running.slot import Input, NodeFault, ObserverSlot, Output, Slot
from palpate.messages import Message, MessageError, pack, unpack
from palpate.nodes.base import Node, Observer, Stream

BURST = 16  # ticks between two bursts to the observers
ORPHANED = 5_000_000_000  # [ns]
REPORT = 200_000_000  # [ns] between two health reports


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
        self.observers = [ObserverSlot(given, self._observer(given)) for given in job.observers]
        self._names = {id(slot.node): slot.name for slot in self.slots}
        self._names |= {id(observer.node): observer.name for observer in self.observers}
        self._real = job.clock == "real"
        self.watch = False
        self.mute: set[str] = set()
        self.stopping = False
        self.last = job.ticks - 1 if job.ticks is not None else None
        self.tick = -1
        self._reported = 0
        self._beat = now()
        self._burst = job.phase % BURST
        self._started: list[Node] = []
        self._told: list[Observer] = []
        self._heard: dict[str, Output] = known
        self._address()

    def _observer(self, job: ObserverJob) -> Observer:
        node = self._node(job)
        if not isinstance(node, Observer):
            raise NodeFault(job.name, "use", f"{job.cls} is not an observer")
        return node

    @staticmethod
    def _node(job: NodeJob | ObserverJob) -> Node:
        try:
            node = load_class(job.cls)(**job.settings)
        except BaseException as error:
            raise NodeFault(job.name, "settings", error) from error
        if isinstance(job, NodeJob) and job.wanted is not None:
            node.wanted = frozenset(job.wanted)
        return node

    # -- life ----------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Start all nodes. NodeFault: one raised."""
        for slot in self.slots:
            self.report({"kind": "starting", "node": slot.name})
            self._started.append(slot.node)
            slot.start()
        for observer in self.observers:
            self._started.append(observer.node)
            heard = tuple(
                Stream(stream, load_class(given.type), given.producer, given.every)
                for stream, given in observer.streams.items()
            )
            try:
                observer.node.listen(heard, self.job.about)
                observer.node.start()
            except BaseException as error:
                raise NodeFault(observer.name, "start", error) from error
            self._told.append(observer.node)
            for stream in observer.streams:
                if stream in self._heard:
                    self._heard[stream].listeners.append(observer)

    @property
    def started(self) -> int:
        """Number of nodes that were started and not stopped yet."""
        return len(self._started)

    def stop(self) -> None:
        """Stop all nodes that were started, the last one first. The first fault is raised when all have stopped."""
        fault = None
        while self._started:
            node = self._started.pop()
            try:
                node.stop()
                self._pass_notes()
            except BaseException as error:
                fault = fault or NodeFault(self._names[id(node)], "stop", error)
        if fault:
            raise fault

    def run(self, origin: int) -> None:
        """Run all ticks. `origin` [ns] is the time of tick 0 on the machine's monotonic clock.

        NodeFault: a node failed.
        """
        self._mark_heard()
        self._tell_observers({slot.name: slot.health.report() for slot in self.slots})
        gc.collect()
        gc.freeze()
        if self.job.clock == "real":
            gc.disable()
        try:
            if not self.slots:
                listen(self)
            elif self.job.clock == "real":
                run_real(self, origin)
            else:
                run_simulated(self, origin)
                if self.bus is not None and self.observers:
                    listen(self)  # what other groups have sent last
        except Ended:
            pass
        finally:
            gc.enable()
            self._report_health()
            self._flush()

    # -- messages ------------------------------------------------------------------------------------------------

    def send(self, slot: Slot) -> None:
        for output in slot.outputs:
            if not (output.external or output.observed or output.listeners):
                continue
            message = output.last
            assert message is not None
            try:
                payload = pack(message)
            except Exception as error:  # a type of the user's own may hold anything
                raise NodeFault(slot.name, f"step at tick {message.tick}", error) from error
            for observer in output.listeners:
                observer.observe(output.stream, message.tick, payload)
            if self.bus is not None and (output.external or output.observed):
                data = output.topic + payload
                if output.external and not output.post(data):
                    self.bus.send(data)
                if output.observed:
                    self.bus.keep(data)

    def _address(self) -> None:
        """Look up the inboxes of those who read the outputs."""
        if self.bus is not None:
            for stream, groups in self.job.external.items():
                self._heard[stream].boxes = self.bus.boxes(groups)

    def receive(self, block: bool) -> None:
        """Take one frame from the inbox and hand it to its ports; control frames act at once."""
        data = self.take(block)
        if not data:
            return
        if self.observers:
            hand_over(self, data)
        at = data.find(0)
        route = self.routes.get(data[: at + 1])
        if route is None:
            return
        try:
            message = unpack(data[at + 1 :], route[0])
        except MessageError as error:
            stream = data[:at].decode(errors="replace")
            if not self._real:  # somebody would wait for this message for ever
                raise NodeFault(route[1][0].producer, f"stream {stream!r}", error) from error
            self.report({"kind": "rubbish", "stream": stream, "text": str(error)})
            return
        arrived = now() if self._real else 0
        for port in route[1]:
            port.put(message, arrived)

    def _look_for_launcher(self) -> None:
        """A worker that was started by hand ends when nothing is heard of the launcher any more."""
        if self.watch and now() - self._beat > ORPHANED:
            raise NodeFault("", "launcher", "nothing was heard of it for 5 s")

    def take(self, block: bool) -> bytes | None:
        """The next frame; None when none came in time, an empty one after a control frame."""
        assert self.bus is not None
        data = self.bus.receive(block)
        if data is None:
            if now() - self._reported > REPORT:
                self._flush()
                self._report_health()
        elif data[0] == CONTROL[0]:
            self._control(order(data))
            return b""
        return data

    def _control(self, given: dict) -> None:
        self._beat = now()
        match given["do"]:
            case "stop" if self.slots:  # observers go on until all senders are gone
                self.stopping = True
            case "close":
                self.stopping = True
            case "end":
                self.last = given["tick"]
            case "dead" | "alive":
                self._bury(set(given["nodes"]), set(given["mute"]), given["do"] == "dead")
            case "quit" if self.slots:
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
        if not dead:
            self._address()

    # -- housekeeping --------------------------------------------------------------------------------------------

    def housekeep(self, tick: int) -> None:
        self._burst += 1
        due = now() - self._reported > REPORT  # slow nodes, too, have to give signs of life
        if self._burst < BURST and not due:
            return
        self._burst = 0
        if self.slots and self.bus is not None and self.bus.waiting():
            # A worker that never has to wait would not hear the launcher. One frame a burst is fewer than it uses up,
            # so that a slow worker still holds back its senders.
            self.receive(block=False)
        self._flush()
        if due:
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
        self._look_for_launcher()
        nodes = {slot.name: {**slot.health.report(), "forces": slot.forces()} for slot in self.slots}
        nodes |= {observer.name: observer.health.report() for observer in self.observers}
        self.report({"kind": "health", "tick": self.tick, "nodes": nodes})
        self._tell_observers(nodes)
        self._pass_notes()

    def _tell_observers(self, nodes: dict[str, dict]) -> None:
        """How the nodes here are doing, to the observers here and elsewhere."""
        far = self.bus is not None and self.bus.heard(HEALTH.encode() + b"\0")
        if not far and not self._told:
            return
        for slot in self.slots:
            last = slot.outputs[0].last if slot.outputs else None
            told = message(slot.name, last.time if last is not None else 0, nodes[slot.name])
            for observer in self._told:
                observer.health(told)
            if far and self.bus is not None:
                self.bus.keep(frame(HEALTH, pack(told)))

    def _pass_notes(self) -> None:
        for observer in self._told:
            for text in observer.notes():
                self.report({"kind": "note", "text": text})
