"""Completes truncated or damaged recordings, and recordings of sources, whose other messages it recomputes and checks.

A recording of sources has the messages of the sources, and of every other stream one message every 0.2 s as a check. On
the simulated clock the inputs of each step follow from the rules of that clock; on the real clock the file contains the
heads of all messages, which name them.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import msgspec
import numpy as np

from palpate.engine.provenance import made_by, rounding
from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError
from palpate.messages import fields
from palpate.physics.archive import replacing
from palpate.records.differences import ELSEWHERE, Comparer, Difference, NodeReport, Report
from palpate.records.format.attached import copy_attached
from palpate.records.format.head import PROFILE, head_of, is_head
from palpate.records.format.mcap_append import NOTES
from palpate.records.format.mcap_writer import McapWriter
from palpate.records.player import plan_of
from palpate.records.segment_player import live_player
from palpate.records.stored import RecordingError, Stored, report_damage

LAG = 0.5  # [s] limit of the delay between messages of the same tick in the file
Row = tuple[str, int, int, bytes]


def fill(path: Path, file: IO[bytes], tolerance: float | None = None) -> tuple[Report, dict[str, int]]:
    """Write a recording of sources with all messages, up to the last check that agrees.

    tolerance  as for `verify`; None: 0 with the arithmetic of the run, otherwise `ELSEWHERE`

    Returns the result of the checks, and the number of messages per stream. RecordingError: it cannot be computed.
    """
    stored = Stored(path)
    filling = _Filling(stored, tolerance)
    about = {key: value for key, value in stored.about.items() if key != "checked"}
    whole = Stored(path)
    whole.as_whole()
    writer, channels = begin_copy(whole, file, {**about, "computed_from": str(path)})
    counts = dict.fromkeys(whole.streams, 0)
    for name, tick, time, payload in filling.rows():
        if name in channels:
            writer.add_message(channels[name], tick, time, payload)
            counts[name] += 1
            filling.report.until = time * 1e-9
    write_json(writer, "palpate.counts", {name: {"count": count, "lost": 0} for name, count in counts.items()})
    if stored.times:
        write_json(writer, "palpate.times", stored.times)
    writer.finish()
    filling.report.cut = stored.cut
    return filling.report, counts


class _Filling:
    def __init__(self, stored: Stored, tolerance: float | None) -> None:
        self.stored, self.plan = stored, plan_of(stored)
        usual = ELSEWHERE if rounding(stored.about) else 0.0
        self.comparer = Comparer(usual if tolerance is None else tolerance)
        nodes = self.plan.graph.nodes
        self._present = stored.ticks()
        running = [name for name in self.plan.order if not nodes[name].cls.paced]
        self.player = live_player(stored, self.plan, running, self._present)
        self.report = Report({part.name: NodeReport() for part in self.player.parts if part.streams})
        self._simulated = stored.about.get("clock") == "simulated"
        checked = stored.about.get("checked", {})
        self._uncomputed = {
            stream: {field.name for field in fields(kind)}.difference(checked[stream])
            for stream, kind in self.plan.graph.streams.items()
            if stream in checked
        }
        """Fields of each stream that the run did not compute because no node read them."""

    def rows(self) -> Iterator[Row]:
        """All messages up to the last check that agrees. RecordingError: damaged, or a node raised."""
        pending: list[Row] = []
        present = self._present
        last, end = self._end(present)
        self.player.start()
        try:
            for tick, payloads in self._ticks(present):
                if tick > last:
                    why = f"from tick {tick} on: {end!r} of tick {last + 1} is not in the truncated file"
                    node = next(part.name for part in self.player.parts if end in part.streams)
                    self.report.nodes[node].stopped = why
                    break
                now = nanoseconds(tick, self.plan.graph.rate) if self._simulated else None
                sent = self.player.step(tick, payloads, now)
                if self.player.missing is not None:
                    node, stream, lost = self.player.missing
                    if self.stored.cut:  # within this tick, or before earlier messages that were still in transit
                        why = f"from tick {tick} on: {stream!r} of tick {lost} is not in the truncated file"
                        self.report.nodes[node].stopped = why
                    else:  # an input of the step did not reach the logger
                        difference = Difference(stream, lost, "message", "1", f"used by {node!r}", "not in the file")
                        self.report.nodes[node].first = difference
                    break
                agreed = self._check(tick, payloads, sent)
                if self.report.first is not None:
                    pending = []
                    break
                played = {s: p for s, p in payloads.items() if s not in self.player.computed}
                pending += ((name, tick, head_of(data).time, data) for name, data in (played | sent).items())
                if agreed:
                    yield from pending
                    pending = []
        except NodeError as fault:
            raise RecordingError(f"{self.stored.path}: recomputing it failed: {fault}").as_failure() from fault
        finally:
            self.player.stop()
        yield from pending

    def _end(self, present: dict[str, np.ndarray]) -> tuple[float, str]:
        """The last tick of which a file of the real clock has all messages, and the stream that ends there. A truncated
        file lacks messages of the last ticks, which arrive up to `LAG` apart; a stream that ended earlier belongs to a
        dead node."""
        last = {name: int(row[-1]) + self.stored.streams[name].every - 1 for name, row in present.items()
                if len(row) and name in self.player.computed and self.stored.cut and not self._simulated}  # fmt: skip
        ends = [(tick, name) for name, tick in last.items() if tick > max(last.values()) - LAG * self.plan.graph.rate]
        return min(ends, default=(math.inf, ""))

    def _ticks(self, present: dict[str, np.ndarray]) -> Iterator[tuple[int, dict[str, bytes]]]:
        """The ticks of the run, with the stored messages of each."""
        if not self._simulated:
            yield from self.stored.instants(present)
            return
        sources = {name: row for name, row in present.items() if name not in self.player.computed}
        last = min((self._last(name, row) for name, row in sources.items()), default=-1)
        due = 0
        for tick, payloads in self.stored.instants(present):
            while due < min(tick, last + 1):
                yield due, {}
                due += 1
            if tick > last:
                return
            yield tick, payloads
            due = tick + 1
        # after the last message of a source that does not send at each tick
        every = {name: spec.every for name, spec in self.plan.graph.nodes.items()}
        with report_damage(self.stored.path, "its numbers of steps"):
            made = max((int(row["steps"] - 1) * every[name] for name, row in self.stored.times.items()), default=-1)
        for tick in range(due, min(made, last) + 1):
            yield tick, {}

    def _last(self, name: str, row: np.ndarray) -> int:
        """The last tick that can be computed from a source's messages. RecordingError: some are missing."""
        every = self.stored.streams[name].every
        gaps = np.flatnonzero(row != np.arange(len(row)) * every)
        if len(gaps):
            raise RecordingError(f"{self.stored.path}: the source's stream {name!r} has no message of tick "
                                 f"{gaps[0] * every}, so later messages cannot be computed")  # fmt: skip
        return len(row) * every - 1

    def _check(self, tick: int, payloads: dict[str, bytes], sent: dict[str, bytes]) -> bool:
        """Compare the computed messages of this tick with stored checks; True: there were checks, and all agree."""
        whole = {name: data for name, data in payloads.items() if name in self.player.computed and not is_head(data)}
        checked = [(part, output) for part in self.player.parts for output in part.outputs if output.stream in whole]
        for part, output in checked:
            report, message = self.report.nodes[part.name], output.last
            if output.stream not in sent or message is None:
                report.checked += 1
                report.differing += 1
                report.first = report.first or Difference(output.stream, tick, "step", "1", "an answer", "none")
                continue
            if skipped := self._uncomputed.get(output.stream):
                stored = self.stored.decode(output.stream, tick, whole[output.stream], output.kind)
                message = msgspec.structs.replace(message, **{name: getattr(stored, name) for name in skipped})
            self.comparer.compare(report, output.stream, whole[output.stream], message)
        return bool(whole) and self.report.first is None


def explain_difference(path: Path, report: Report, about: dict[str, Any]) -> str:
    """Why a recording of sources is not reproduced: the first difference, and the versions then and now."""
    then, now = made_by(about), made_by(None)
    who = f"recorded with {then}, computed with {now}" if then != now else f"both with {now}"
    return "; ".join([
        f"{path}: the recomputed messages differ from the recording: {report.first}", who, *rounding(about),
        f"to write the messages before that: `palpate export {path} --to mcap --full`",
    ])  # fmt: skip


def begin_copy(recording: Stored, file: IO[bytes], about: dict[str, Any]) -> tuple[McapWriter, dict[str, int]]:
    """A writer for a copy of a recording, and the channel number of each stream. `about` replaces the provenance."""
    writer = McapWriter(file, PROFILE)
    write_json(writer, "palpate.about", about)
    copy_attached(recording.path, writer, recording.moved)
    if recording.notes:
        write_json(writer, NOTES, {"notes": recording.notes})
    for node, ticks in recording.restarted.items():
        for tick in ticks:
            writer.add_metadata("palpate.restarted", {"node": node, "tick": str(tick)})
    for node, tick in recording.late.items():
        writer.add_metadata("palpate.late", {"node": node, "tick": str(tick)})
    schemas: dict[str, int] = {}
    channels = {}
    for name, stream in recording.streams.items():
        kind, title = stream.schema["class"], stream.schema["title"]
        if kind not in schemas:
            schemas[kind] = writer.add_schema(title, json.dumps(stream.schema).encode())
        about_stream = {"producer": stream.producer, "every": str(stream.every), "thin": str(stream.thin)}
        if stream.kept:
            about_stream["kept"] = stream.kept
        channels[name] = writer.add_channel(name, "msgpack", schemas[kind], about_stream)
    return writer, channels


def write_json(writer: McapWriter, name: str, data: dict[str, Any]) -> None:
    """Add metadata with JSON values."""
    writer.add_metadata(name, {key: json.dumps(value) for key, value in data.items()})


def recover(path: Path, out: Path | None = None) -> tuple[Path, dict[str, int]]:
    """Write the readable part of a recording to a complete file with an index.

    out  None: next to the file, with `-recovered` in its name

    Returns the new file and the number of messages per stream. RecordingError: nothing to recover.
    """
    recording = Stored(path)
    target = _target(path, out, "recovered")
    counts = dict.fromkeys(recording.streams, 0)
    with replacing(target) as part, open(part, "wb") as file:
        writer, channels = begin_copy(recording, file, {**recording.about, "recovered_from": str(path)})
        for name, tick, time, payload in recording.raw():
            writer.add_message(channels[name], tick, time, payload)
            counts[name] += 1
        if recording.counts and recording.complete:  # losses are known only for a complete file
            write_json(writer, "palpate.counts", recording.counts)
        writer.finish()
    return target, counts


def recover_full(path: Path, out: Path | None = None) -> tuple[Path, dict[str, int], Report]:
    """Write a recording of sources with all messages, up to the last check that agrees; returns file, number of
    messages per stream, and the result of the checks.

    out  None: next to the file, with `-full` in its name

    RecordingError: the file contains all messages, or they cannot be computed.
    """
    if not Stored(path).as_whole():
        cure = "`palpate export --to mcap` without --full repairs a truncated file"
        raise RecordingError(f"{path} contains all messages; {cure}")
    target = _target(path, out, "full")
    with replacing(target) as part, open(part, "wb") as file:
        report, counts = fill(path, file)
    return target, counts, report


def _target(path: Path, out: Path | None, what: str) -> Path:
    target = out or path.with_name(f"{path.stem}-{what}{path.suffix}")
    if target.exists():
        raise RecordingError(f"{target} exists; name another file with --out")
    return target
