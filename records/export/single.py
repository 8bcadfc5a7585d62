"""Shared code of the exports that write one stream to one file."""

from collections.abc import Sequence
from pathlib import Path

from palpate.messages import Message
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def source(recording: Recording, kind: type[Message], streams: Sequence[str], remedy: str) -> str:
    """The first of these streams that has messages of this type. RecordingError: none has; `remedy` follows."""
    found = [name for name in streams or recording.streams if recording.known(name).type is kind]
    if not found:
        raise RecordingError(f"{recording.path}: no stream of {kind.__name__}; {remedy}")
    return found[0]


def check_target(recording: Recording, target: Path, every: int | None) -> None:
    """RecordingError: the target is the recording itself, or messages are to be left out."""
    if every:
        raise RecordingError(f"--every: a file of type {target.suffix} needs every message; leave it out")
    if target.exists() and target.samefile(recording.path):
        raise RecordingError(f"{target} is the recording itself; name another file with --out")
