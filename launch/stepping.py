"""A graph that Python code runs tick by tick: values are read, and settings changed, between two ticks.

for tick in steps("kidney", duration=0.5):
    if tick.contact.force > 1.0:
        tick.set("tissue", stiffness=2e3)
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.engine.faults import choices
from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError, Slot
from palpate.launch.calling import described
from palpate.launch.load.placement import fused
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.load.values.units import UnitError, convert
from palpate.launch.run.assign import jobs
from palpate.launch.run.work.simulated import run_tick
from palpate.launch.run.work.worker import Worker
from palpate.messages import Message
from palpate.nodes.base import SettingError, settings
from palpate.nodes.base.node import convert as settled
from palpate.physics.errors import ArgumentError


class Tick:
    """A graph after one of its ticks. The last message of a node is an attribute of its name, `tick.contact.force`, or
    an item where a node sends several streams, `tick["pad.Slip"]`; None where none was sent yet.

    number   of the tick, from 0
    time     [s] on the graph's clock
    streams  names of what is sent
    """

    def __init__(self, worker: Worker, number: int) -> None:
        self._worker = worker
        self.number, self.time = number, nanoseconds(number, worker.job.rate) * 1e-9
        self.streams = list(worker.outputs)

    def __getitem__(self, stream: str) -> Message | None:
        """ArgumentError: there is no such stream; names the nearest."""
        if stream not in self._worker.outputs:
            raise ArgumentError(f"no stream {stream!r}. {choices('Streams', str(stream), self.streams)}")
        return self._worker.outputs[stream].last

    def __getattr__(self, name: str) -> Message | None:
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
        """The settings of a node as they are now, in SI units. ArgumentError: no such node."""
        own = self._slot(node).node
        return {name: getattr(own, name) for name in settings(type(own))}

    def set(self, node: str, **values: Any) -> None:
        """Give a node other settings from the next tick on: numbers in SI units, or texts with a unit. The node is
        started anew with them, so its state is that of the beginning; all others go on.

        ArgumentError: no such node. SettingError: no such setting, or not its value; the old ones stay. NodeError: the
        node does not start with them, which ends the loop.
        """
        slot = self._slot(node)
        own, known = slot.node, settings(type(slot.node))
        new = {}
        for name, value in values.items():
            if name not in known:
                raise SettingError(f"{node}: no setting {name!r}. {choices('Settings', name, known)}")
            new[name] = settled(known[name], _number(node, name, value, known[name].unit))
        try:
            own.stop()
            for name, value in new.items():
                setattr(own, name, value)
            own.start()
        except Exception as error:
            raise NodeError(node, "start", error) from error
        slot.time = None

    def _slot(self, node: str) -> Slot:
        names = {slot.name: slot for slot in self._worker.slots}
        if node not in names:
            raise ArgumentError(f"there is no running node {node!r}. {choices('Nodes', str(node), names)}")
        return names[node]


def steps(
    graph: str | Path,
    *,
    duration: float | str | None,
    scene: str | None,
    sets: Sequence[str],
    nodes: Mapping[str, str | Mapping[str, Any]],
) -> Iterator[Tick]:
    """Run a graph in this process on simulated time, one tick for each step of the loop; arguments as `palpate.run`.

    GraphError, ArgumentError: what is wrong with them. NodeError: a node failed.
    """
    launch = described(graph, scene=scene, duration=duration, sets=sets, nodes=nodes)
    loaded = launch.load()
    set_recording(loaded, None)
    planned = plan(loaded)
    devices = [name for name in planned.order if planned.graph.nodes[name].cls.hardware]
    if devices or launch.clock == "real":
        what = f"{devices[0]!r} drives a device" if devices else "clock: real"
        raise ArgumentError(f"{graph}: stepping needs simulated time, but {what}; run it with palpate.run")
    ticks = None if launch.duration is None else max(1, round(launch.duration * loaded.rate))
    (job,) = jobs(planned, fused(planned), ticks=ticks)
    return _ticks(Worker(job, None, lambda report: None))


def _ticks(worker: Worker) -> Iterator[Tick]:
    try:
        worker.start()
        worker.begin(0)
        for number in itertools.count() if worker.last is None else range(worker.last + 1):
            worker.tick = number
            run_tick(worker, number)
            yield Tick(worker, number)
    finally:
        worker.stop()


def _number(node: str, name: str, value: Any, unit: str) -> Any:
    """A text with a unit as a number in `unit`; all else as it is. SettingError: a unit of something else."""
    if not isinstance(value, str) or (not value[:1].isdigit() and value[:1] not in "+-."):
        return value
    try:
        return convert(value, unit)
    except UnitError as error:
        raise SettingError(f"{node}.{name} [{unit}]: {error}") from None
