"""Making a complete recording: of one that was cut off or damaged, or of one that holds its sources only."""

from __future__ import annotations

import os
from pathlib import Path

from palpate.records.differences import Report
from palpate.records.fill import begin_copy, fill, write_json
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError, Stored


def recover(path: Path, out: Path | None = None) -> tuple[Path, dict[str, int]]:
    """Write what can be read of a recording to a complete file, with its index.

    out  None: beside the file, with `-recovered` in its name

    Returns the new file and the number of messages per stream. RecordingError: there is nothing to recover.
    """
    recording = Stored(path)
    target = _target(path, out, "recovered")
    counts = dict.fromkeys(recording.streams, 0)
    part = target.with_name(target.name + ".part")
    with open(part, "wb") as file:
        writer, channels = begin_copy(recording, file, {**recording.about, "recovered_from": str(path)})
        for name, tick, time, payload in recording.raw():
            writer.add_message(channels[name], tick, time, payload)
            counts[name] += 1
        if recording.counts and recording.complete:  # what was lost on the way is only known for a whole run
            write_json(writer, "palpate.counts", recording.counts)
        writer.finish()
    os.replace(part, target)
    return target, counts


def recover_full(path: Path, out: Path | None = None) -> tuple[Path, dict[str, int], Report]:
    """Write a recording of sources with all messages, as far as they agree with its checks; also how these came out.

    out  None: beside the file, with `-full` in its name

    RecordingError: it holds all messages, or cannot be computed.
    """
    if not Recording(path).computed:
        raise RecordingError(f"{path} holds all messages; `palpate recover` without --full mends one that is cut off")
    target = _target(path, out, "full")
    part = target.with_name(target.name + ".part")
    with open(part, "wb") as file:
        report, counts = fill(path, file)
    os.replace(part, target)
    return target, counts, report


def _target(path: Path, out: Path | None, what: str) -> Path:
    target = out or path.with_name(f"{path.stem}-{what}{path.suffix}")
    if target.exists():
        raise RecordingError(f"{target} exists; name another file with --out")
    target.parent.mkdir(parents=True, exist_ok=True)
    return target
