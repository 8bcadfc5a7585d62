"""Replays a recording: some nodes run, the others are played, at the times of the recorded messages."""

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from palpate.engine.clock import now, sleep_until
from palpate.engine.imports import full_name
from palpate.engine.job import ObserverJob, StreamJob
from palpate.engine.plan import Plan
from palpate.engine.provenance import about
from palpate.engine.slot import ObserverSlot
from palpate.launch.load.dependencies import data_files
from palpate.messages import Health
from palpate.nodes.base import Observer, Stream
from palpate.nodes.logger import Mcap
from palpate.records.changed import sources
from palpate.records.differences import Comparer, NodeReport
from palpate.records.format.head import head_of
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


class Replay:
    """The replay of a recording.

    plan   the recorded, a changed or another plan (see `change_plan`)
    only   nodes that run; None: all but the sources, whose recorded messages drive the graph
    speed  multiple of real time; None: as fast as possible
    begin, end  [s] part of the recording to show. Ticks before `begin` are computed for the state of the nodes, but
           neither paced nor shown
    out    file for a recording of the replay

    After `run`, `reports` has the comparison with the recorded messages for each running node, and `notes` the nodes'
    lines for the user.

    RecordingError: a required stream is missing.
    """

    def __init__(
        self,
        recording: Recording,
        plan: Plan,
        *,
        only: Collection[str] | None = None,
        speed: float | None = None,
        begin: float = 0.0,
        end: float | None = None,
        out: Path | None = None,
    ) -> None:
        self.recording, self.plan, self.speed = recording, plan, speed
        self.begin, self.end = begin, end
        if only is None:
            paced = sources(recording, plan)
            self.running = [name for name in plan.order if name not in paced]
        else:
            self.running = list(only)
            for name in only:
                if name not in plan.order:
                    raise RecordingError(f"there is no running node {name!r}; nodes: {', '.join(plan.order)}")
        self.present = recording.ticks()
        self.observers: list[ObserverSlot] = []
        if out is not None:
            if out.exists() and out.samefile(recording.path):
                raise RecordingError(f"{out} is the file that is replayed; name another one")
            self.observers.append(self._listening("log", Mcap(path=str(out)), list(self._streams())))
        for name, observed in plan.observers.items():
            node = plan.make(name)
            if isinstance(node, Observer) and not isinstance(node, Mcap):
                self.observers.append(self._listening(name, node, [s for s in self._streams() if s.name in observed]))
        self.producers = {s: name for name in plan.order for s in plan.graph.nodes[name].streams}
        self.reports: dict[str, NodeReport] = {}
        self.player: Player | None = None
        self.notes: list[str] = []
        self.seconds = self.wall = 0.0

    def run(self) -> None:
        """Replay once. NodeError: a node raised."""
        # Start the players and the observers.
        player = self.player = Player(self.recording, self.plan, self.running, live=True)
        reports = self.reports = {part.name: NodeReport() for part in player.parts}
        comparer = Comparer(0.0)
        begun, first, time = now(), None, 0
        player.start()
        for observer in self.observers:
            observer.node.start()
        sent_by = dict.fromkeys(self.plan.order, 0)
        begins = {name: list(ticks) for name, ticks in self.recording.restarted.items()}
        since: dict[str, int] = {}
        try:
            for tick, payloads in self.recording.instants(self.present):
                time = head_of(next(iter(payloads.values()))).time
                if self.end is not None and time > self.end * 1e9:
                    break
                # Recompute the tick, and compare the messages with the recorded ones.
                sent = player.step(tick, payloads)
                for part in player.parts:
                    for output in part.outputs:
                        if output.stream in sent and output.stream in payloads and output.last is not None:
                            comparer.compare(reports[part.name], output.stream, payloads[output.stream], output.last)
                if time < self.begin * 1e9:
                    continue
                # Keep the pace of the recording.
                if first is None:
                    first, begun = time, now()
                    for observer in self.observers:
                        observer.node.take_origin(begun - first)
                if self.speed is not None:
                    sleep_until(begun + round((time - first) / self.speed))
                # Show restarts of devices, then the messages of the tick.
                for name, ticks in begins.items():
                    while ticks and tick >= ticks[0]:
                        self._send_health(name, 0, since.setdefault(name, 0))
                        since[name] = ticks.pop(0)
                        sent_by[name] = 0
                        self._send_health(name, 0, since[name])
                played = {s: payload for s, payload in payloads.items() if s not in player.computed}
                self._show(tick, played | sent, sent_by)
        finally:
            # Stop, and show the final counts.
            self.seconds = (time - first) * 1e-9 if first is not None else 0.0
            self.wall = (now() - begun) * 1e-9
            player.stop()
            self.notes = player.notes()
            for name, count in sent_by.items():
                if count:
                    self._send_health(name, count, since.get(name, 0))
            for observer in self.observers:
                observer.node.stop()

    def _show(self, tick: int, messages: dict[str, bytes], sent_by: dict[str, int]) -> None:
        """Pass the messages of one tick to the observers, and count the messages of each node."""
        for name in {self.producers[stream] for stream in messages if stream in self.producers}:
            sent_by[name] += 1
        for observer in self.observers:
            for stream, payload in messages.items():
                if stream in observer.streams:
                    observer.observe(stream, tick, payload)

    def _send_health(self, node: str, steps: int, since: int) -> None:
        """Send observers the health of a node, as a worker would: its first tick and its number of messages."""
        message = Health(
            source=node, since=since, steps=steps, state="replayed", late=0, lost=0, held=0, median=0.0, p99=0.0,
            longest=0.0, age=0.0,
        )  # fmt: skip
        for observer in self.observers:
            observer.node.health(message)

    def _streams(self) -> Iterator[Stream]:
        graph = self.plan.graph
        for name in self.plan.order:
            for stream, kind in graph.nodes[name].streams.items():
                if name in self.running or stream in self.recording.streams:
                    yield Stream(stream, kind, name, graph.nodes[name].every)

    def _listening(self, name: str, node: Observer, streams: list[Stream]) -> ObserverSlot:
        more: dict[str, Any] = {"replay_of": str(self.recording.path), "running": self.running}
        if files := data_files(self.plan.graph):
            more["files"] = files
        provenance = about(self.plan, clock="replay", **more)
        node.listen(tuple(streams), provenance)
        jobs = {s.name: StreamJob(full_name(s.type), s.producer, s.every) for s in streams}
        return ObserverSlot(ObserverJob(name, full_name(type(node)), {}, jobs), node)
