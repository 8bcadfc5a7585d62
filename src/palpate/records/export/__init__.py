"""Exports recordings to formats of other tools."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

from palpate.messages import Message
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

FORMATS = {
    "foxglove": ("foxglove", ".foxglove.mcap"),
    "parquet": ("tables", "-parquet"),
    "csv": ("tables", "-csv"),
    "lerobot": ("lerobot", "-lerobot"),
    "wav": ("vibration", ".wav"),
    "hjif": ("vibration", ".hjif"),
    "nwb": ("nwb", ".nwb"),
    "gltf": ("gltf", ".gltf"),
}
"""Format -> the module with its function `write_FORMAT`, and the ending of the file or folder."""
THINNED = ("foxglove", "parquet", "csv")
"""Formats that can leave out messages."""


def export(
    recording: Recording,
    to: str,
    out: Path | None = None,
    streams: Sequence[str] = (),
    *,
    every: int | None = None,
    subject: Mapping[str, str] | None = None,
    fps: int | None = None,
    touch_rate: float | None = None,
    camera: bool = False,
) -> list[Path]:
    """Write a recording in another format; returns the files.

    to       one of FORMATS: foxglove (MCAP with JSON channels), parquet, csv (a file per stream), wav, hjif,
             nwb, gltf, lerobot (a folder)
    out      file or folder; None: next to the recording
    streams  streams to write; empty: all
    every    write every n-th message; None: all
    subject  nwb: what is known of the subject, by the names of NWB (subject_id, age, sex, species, ...)
    fps, touch_rate  lerobot: rates of the frames and of the touch samples [Hz]; None: 30 and 150
    camera   lerobot: a picture of each frame from the side

    RecordingError: an argument is invalid, or a package is missing.
    """
    if to not in FORMATS:
        raise RecordingError(f"--to: found {to!r}, expected one of {', '.join(FORMATS)}")
    for name in streams:
        recording.find_stream(name)
    module, ending = FORMATS[to]
    write = getattr(import_module(f"{__name__}.{module}"), f"write_{to}")
    target = out or recording.path.with_name(recording.path.stem + ending)
    if every and to not in THINNED:
        raise RecordingError(f"--every: --to {to} needs every message; leave it out")
    if target.exists() and target.samefile(recording.path):
        raise RecordingError(f"{target} is the recording itself; name another file with --out")
    if subject and to != "nwb":
        raise RecordingError(f"--subject: found --to {to}, expected --to nwb; other formats have no subject")
    given: dict[str, object] = {"subject": subject or {}} if to == "nwb" else {}
    framed = {"fps": fps, "touch_rate": touch_rate, "camera": camera or None}
    framed = {name: value for name, value in framed.items() if value is not None}
    if framed and to != "lerobot":
        option = next(iter(framed)).replace("_", "-")
        raise RecordingError(f"--{option}: found --to {to}, expected --to lerobot; other formats have no frames")
    given |= framed
    return write(recording, target, tuple(streams) or tuple(recording.streams), every, **given)


def source(recording: Recording, kind: type[Message], streams: Sequence[str], remedy: str) -> str:
    """The first of these streams that has messages of this type. RecordingError: none has; `remedy` follows."""
    found = [name for name in streams or recording.streams if recording.find_stream(name).type is kind]
    if not found:
        raise RecordingError(f"{recording.path}: no stream of {kind.__name__}; {remedy}")
    return found[0]
