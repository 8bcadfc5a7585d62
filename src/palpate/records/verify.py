"""Checks a recording: recomputes each message of each node from exactly the messages that it used."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from palpate.engine.plan import Plan
from palpate.engine.slot import NodeError
from palpate.records.differences import Comparer, Difference, NodeReport, Report
from palpate.records.format.head import head_of
from palpate.records.player import MissingInput, Player, ReplaySlot
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError, last_tick


def verify(
    recording: Recording,
    plan: Plan,
    *,
    tolerance: float = 0.0,
    show: Callable[[int, int], None] = lambda tick, last: None,
) -> Report:
    """Recompute every message of every node from the recorded messages in its `used`, and compare.

    tolerance  0: the bytes must be equal. Otherwise numbers may differ by this fraction of the largest magnitude of
               their field so far, for platforms that round differently
    show       called repeatedly with the tick and the last tick

    If the file lacks messages of a node, the node is checked up to this gap, and after it only while its messages
    agree: a difference there is not an error, because a step that is not in the file may have changed its state.

    RecordingError: the recording does not fit the plan. A node that raises counts as a difference.
    """
    if recording.computed:
        return recording.compute(tolerance)
    # Make the nodes, and find those that cannot be checked, and gaps in the recording.
    player = Player(recording, plan, plan.order, live=False)
    reports = {p.name: NodeReport(stopped=p.broken or _lack(recording, p.streams)) for p in player.parts if p.streams}
    report = Report(reports, recording.cut)
    present = recording.ticks()
    for part in player.parts:
        if not part.as_recorded:
            raise RecordingError(
                f"{recording.path}: a check steps every node at its recorded ticks, so {part.name}.every cannot "
                "change. Replay without --check, or leave it out."
            )
    parts = [part for part in player.parts if part.streams and not reports[part.name].stopped]
    comparer = Comparer(tolerance)
    last = last_tick(present)
    gaps = {part.name: found for part in parts if (found := _gap(recording, part.streams, present)) is not None}
    lossy = any(counts.get("lost", 0) for counts in recording.counts.values())
    # Step each node from its recorded inputs and compare its outputs.
    player.start()
    try:
        for tick, payloads in recording.instants(present):
            player.deliver_messages(tick, payloads)
            for part in parts:
                node = report.nodes[part.name]
                if node.stopped or part.streams[0] not in payloads:
                    continue
                since, what = gaps.get(part.name, (tick, ""))
                node.gap = node.gap or (what if tick >= since else "")
                if not _step(player, part, tick, payloads, node, lossy):
                    continue
                before = replace(node)
                for output in part.outputs:
                    payload = payloads.get(output.stream)
                    if payload is not None and output.last is not None:
                        comparer.compare(node, output.stream, payload, output.last)
                if node.gap and node.differing > before.differing:
                    report.nodes[part.name] = replace(before, stopped=node.gap)
            if report.complete and report.first is None:
                report.until = head_of(next(iter(payloads.values()))).time * 1e-9
            if not tick % 512:
                show(tick, last)
    finally:
        player.stop()
    return report


def _step(
    player: Player, part: ReplaySlot, tick: int, payloads: dict[str, bytes], node: NodeReport, lossy: bool
) -> bool:
    """Step a node from its recorded inputs; returns whether it answers. Otherwise the report states why not.

    lossy  whether the recorder has lost messages: then a missing input does not end the check of the node
    """
    try:
        if player.run([part], tick, payloads):
            return True
        node.stopped = f"from tick {tick} on: it was recorded without a required input"
    except MissingInput as missing:
        text = f"from tick {tick} on: {missing} is not in the file"
        node.gap, node.stopped = node.gap or text, "" if lossy else text
    except NodeError as fault:
        node.differing += 1
        failure = Difference(part.streams[0], tick, "step", "1", "an answer", str(fault.cause))
        node.first = node.first or failure
        node.stopped = f"from tick {tick} on: the step failed"
    return False


def _lack(recording: Recording, streams: tuple[str, ...]) -> str:
    """Why the file does not show all steps of a node; empty if it does."""
    return next((f"stream {stream!r} {lack}" for stream in streams if (lack := recording.lack(stream))), "")


def _gap(recording: Recording, streams: tuple[str, ...], present: dict[str, np.ndarray]) -> tuple[int, str] | None:
    """The first tick at which a step of a node may be missing in the file, and a text; None if none is missing. Ticks
    that the clock left out look the same."""
    found = []
    for stream in streams:
        if lost := recording.counts.get(stream, {}).get("lost", 0):
            every = recording.streams[stream].every
            row = np.concatenate(([-every], present[stream].astype(np.int64), [1 << 40]))
            tick = int(row[np.argmax(np.diff(row) > every)]) + every
            found.append((tick, f"from tick {tick} on: the recording lost {lost} messages of stream {stream!r}, so the "
                                "node's steps are not all known"))  # fmt: skip
    return min(found, default=None)
