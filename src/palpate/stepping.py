"""`palpate.steps`: run a graph tick by tick, read values and change settings between two ticks.

for tick in steps("kidney", duration=0.5):
    if tick.contact.force > 1.0:
        tick.set("tissue", stiffness=2e3)
"""

import itertools
import sys
from collections.abc import Iterator, Mapping
from typing import Any, NoReturn

from palpate.bases import build_missing
from palpate.engine.faults import choices
from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError, Slot
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.load.values.settings import in_si
from palpate.launch.run.assign import jobs
from palpate.launch.run.notes import RunNote, warn
from palpate.launch.run.reports import Note, Report
from palpate.launch.run.work.simulated import SimulatedClock
from palpate.launch.run.work.worker import Worker
from palpate.messages import Message
from palpate.nodes.base import Node, SettingError, settings
from palpate.nodes.base.node import convert
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError


class Tick:
    """A graph after one of its ticks. The attribute with a node's name is the node's last message,
    `tick.contact.force`; a node with several streams has an item for each, `tick["pad.Slip"]`. None: no message yet.

    number   number of the tick, from 0
    time     time on the graph's clock [s]
    """

    def __init__(self, worker: Worker, number: int) -> None:
        self._worker = worker
        self.number, self.time = number, nanoseconds(number, worker.job.rate) * 1e-9

    @property
    def streams(self) -> list[str]:
        """Names of all streams."""
        return list(self._worker.outputs)

    def __getitem__(self, stream: str) -> Message | None:
        """The last message of a stream. ArgumentError: the stream does not exist; suggests the nearest name."""
        if stream not in self._worker.outputs:
            raise ArgumentError(f"no stream {stream!r}. {choices('Streams', str(stream), self.streams)}")
        return self._worker.outputs[stream].last

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except ArgumentError as error:
            raise AttributeError(str(error)) from None

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in self.streams if name.isidentifier())})

    def __repr__(self) -> str:
        return f"<tick {self.number} at {self.time:.6g} s: {', '.join(self.streams)}>"

    def settings(self, node: str) -> dict[str, Any]:
        """The current settings of a node, in SI units. ArgumentError: the node does not exist."""
        return _settings(slot_of(self._worker, node).node)

    def set(self, node: str, **values: Any) -> None:
        """Change settings of a node from the next tick on: numbers in SI units, or texts with a unit. The node restarts
        from its initial state; all other nodes continue.

        ArgumentError: the node does not exist. SettingError: unknown setting or invalid value; nothing changes.
        NodeError: the node fails to start with them, which ends the loop.
        """
        slot = slot_of(self._worker, node)
        new = convert_settings(slot, values)
        try:
            slot.node.stop()
            for name, value in new.items():
                setattr(slot.node, name, value)
            slot.node.start()
        except Exception as error:
            raise NodeError(node, "start", error) from error
        slot.forget()


class Stepper:
    """A graph in this process on simulated time: `tick` advances it by one tick, `restart` resets it.

    GraphError, ArgumentError: the graph is invalid or cannot be stepped.
    """

    def __init__(self, launch: LaunchFile) -> None:
        graph = launch.load()
        build_missing(graph, quiet=not sys.stderr.isatty())
        set_recording(graph, None)
        self.plan = plan(graph)  # the nodes that run
        devices = [name for name in self.plan.order if graph.nodes[name].cls.hardware]
        if devices or launch.clock == "real":
            what = f"{devices[0]!r} drives a device" if devices else "clock: real"
            name = graph.path.stem
            raise ArgumentError(f"{name}: stepping needs simulated time, but {what}; run it with palpate.run")
        ticks = max(1, round(launch.duration * graph.rate)) if launch.duration is not None else None
        (self.job,) = jobs(self.plan, fuse_nodes(self.plan), ticks=ticks)  # of all nodes that run
        self.graph_notes = [RunNote(text) for text in graph.notes]
        """The notes about the graph that `notes` has yet to return."""
        self._notes: list[RunNote] = []
        self._worker = Worker(self.job, None, self._keep_note)
        self._clock = SimulatedClock(self._worker)
        self.rate, self.last = graph.rate, self._worker.last
        self._own = {slot.name: _settings(slot.node) for slot in self._worker.slots}

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        """ArgumentError: a copy would share the state of the compiled nodes."""
        name = self.plan.graph.path.stem
        raise ArgumentError(f"{name}: a graph that is stepped cannot be copied or pickled; make another one like it")

    def node(self, name: str) -> Node:
        """A running node. ArgumentError: it does not exist."""
        return slot_of(self._worker, name).node

    def start(self) -> None:
        """Start all nodes. NodeError: one of them failed; `stop` releases the resources of the others."""
        self._worker.start()
        self._worker.begin(0)

    def restart(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        """Reset to before the first tick, with the settings of the graph and these changes in the form of `Tick.set`.

        ArgumentError, SettingError: unknown node or setting, or invalid value; nothing changes. NodeError: a node
        failed.
        """
        new = {name: convert_settings(slot_of(self._worker, name), values) for name, values in changes.items()}
        for slot in self._worker.slots:
            for name, value in (self._own[slot.name] | new.get(slot.name, {})).items():
                setattr(slot.node, name, value)
            slot.restart()
        self._worker.tick = -1

    def tick(self) -> Tick:
        """Run one tick. NodeError: a node failed."""
        number = self._worker.tick + 1
        self._clock.run(number)
        return Tick(self._worker, number)

    def notes(self) -> list[RunNote]:
        """The new lines for the user, about the graph and of the nodes; each is returned once. `restart` discards those
        of the nodes that were not yet returned."""
        self._worker.pass_notes()
        notes = self.graph_notes + self._notes
        self.graph_notes, self._notes = [], []
        return notes

    def stop(self) -> None:
        """Stop all nodes."""
        self._worker.stop()

    def _keep_note(self, report: Report) -> None:
        if isinstance(report, Note):
            self._notes.append(RunNote(report.text, report.node, report.time))


def ticks(stepper: Stepper) -> Iterator[Tick]:
    """Run a graph in this process, one tick per iteration. At the end the first note of each kind is a PalpateWarning.

    NodeError: a node failed."""
    try:
        stepper.start()
        for _ in itertools.count() if stepper.last is None else range(stepper.last + 1):
            yield stepper.tick()
    finally:
        warn(stepper.notes())
        stepper.stop()


def slot_of(worker: Worker, node: str) -> Slot:
    """A running node. ArgumentError: it does not exist."""
    names = {slot.name: slot for slot in worker.slots}
    if node not in names:
        raise ArgumentError(f"there is no running node {node!r}. {choices('Nodes', str(node), names)}")
    return names[node]


def _settings(node: Node) -> dict[str, Any]:
    return {name: getattr(node, name) for name in settings(type(node))}


def convert_settings(slot: Slot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert given settings to the values that the node stores. SettingError: unknown setting or invalid value."""
    known = settings(type(slot.node))
    new = {}
    for name, value in values.items():
        if name not in known:
            raise SettingError(f"{slot.name}: no setting {name!r}. {choices('Settings', name, known)}")
        try:
            new[name] = convert(known[name], in_si(known[name].type, value, known[name].unit))
        except UnitError as error:
            raise SettingError(f"{slot.name}.{name} [{known[name].unit}]: {error}") from None
    return new
