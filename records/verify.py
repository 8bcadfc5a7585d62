"""Whether a recording can be computed again: each message of each node from exactly the messages that it used."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.engine.plan import Plan
from palpate.engine.slot import NodeError
from palpate.records.differences import Difference, NodeReport, Report, compare_one
from palpate.records.instants import instants, last_tick
from palpate.records.player import MissingInput, Player
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def verify(
    recording: Recording,
    plan: Plan,
    *,
    tolerance: float = 0.0,
    show: Callable[[int, int], None] = lambda tick, last: None,
) -> Report:
    """Compute every message of every node again from the recorded messages that it names, and compare.

    tolerance  0: the bytes must be equal. Else numbers may differ by this, relative to the largest magnitude that their
               field has had in the stream so far: for another platform, whose mathematics rounds otherwise
    show       called now and then with the tick and the last tick

    Where the file lacks messages, a node is checked up to there, and on as long as it agrees: after a step that is not
    known, another state is no difference.

    RecordingError: the recording does not fit. A node that raises counts as a difference of its own.
    """
    if recording.computed:
        return recording.compute(tolerance)
    player = Player(recording, plan, plan.order, live=False)
    report = Report({part.name: NodeReport(stopped=part.broken or "") for part in player.parts if part.streams})
    present = recording.ticks()
    for part in player.parts:
        if not part.as_recorded:
            raise RecordingError(
                f"{recording.path}: a check steps every node when it was recorded, so {part.name}.every cannot be "
                "another one. Replay without --check, or leave it out."
            )
    report.cut = not recording.complete or "recovered_from" in recording.about
    for part in player.parts:
        if part.streams and not report.nodes[part.name].stopped:
            report.nodes[part.name].stopped = _cannot(recording, part.streams, part.name)
    parts = [part for part in player.parts if part.streams and not report.nodes[part.name].stopped]
    scales: dict[tuple[str, str], float] = {}
    last = last_tick(present)
    gaps = {part.name: found for part in parts if (found := _gap(recording, part.streams, present)) is not None}
    lossy = any(own.get("lost", 0) for own in recording.counts.values())
    player.start()
    try:
        for tick, payloads in instants(recording, present):
            player.hear(tick, payloads)
            for part in parts:
                own = report.nodes[part.name]
                if own.stopped or part.streams[0] not in payloads:
                    continue
                since, what = gaps.get(part.name, (tick, ""))
                own.gap = own.gap or (what if tick >= since else "")
                try:
                    if not player.run([part], tick, payloads):
                        own.stopped = f"from tick {tick} on: it was recorded without an input that it cannot do without"
                        continue
                except MissingInput as missing:
                    told = f"from tick {tick} on: {missing} is not in the file"
                    own.gap, own.stopped = own.gap or told, "" if lossy else told
                    continue
                except NodeError as fault:
                    own.differing += 1
                    own.first = own.first or Difference(
                        part.streams[0], tick, "step", "1", "an answer", str(fault.cause)
                    )
                    own.stopped = f"from tick {tick} on: the step failed"
                    continue
                before = replace(own)
                for output in part.outputs:
                    payload = payloads.get(output.stream)
                    if payload is not None and output.last is not None:
                        own.checked += 1
                        compare_one(own, output.stream, payload, output.last, tolerance, scales)
                if own.gap and own.differing > before.differing:
                    report.nodes[part.name] = replace(before, stopped=own.gap)
            if not tick % 512:
                show(tick, last)
    finally:
        player.stop()
    return report


def _cannot(recording: Recording, streams: tuple[str, ...], name: str) -> str:
    """Why not all steps of a node can be seen in the file; empty where they can."""
    for stream in streams:
        if lack := recording.lack(stream):
            return f"stream {stream!r} {lack}"
    return ""


def _gap(recording: Recording, streams: tuple[str, ...], present: dict[str, np.ndarray]) -> tuple[int, str] | None:
    """The first tick at which a node may have made a step that the file does not have, and what it lacks; None where it
    lacks nothing. Ticks that the clock left out look the same."""
    found = []
    for stream in streams:
        if lost := recording.counts.get(stream, {}).get("lost", 0):
            every = recording.streams[stream].every
            row = np.concatenate(([-every], present[stream].astype(np.int64), [1 << 40]))
            tick = int(row[np.argmax(np.diff(row) > every)]) + every
            found.append((tick, f"from tick {tick} on: the recording lost {lost} messages of stream {stream!r}, so the "
                                "node's steps are not all known"))  # fmt: skip
    return min(found, default=None)
