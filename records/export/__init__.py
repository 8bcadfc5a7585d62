"""Exports recordings to formats of other tools."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

FORMATS = {
    "foxglove": ("foxglove", ".foxglove.mcap"),
    "parquet": ("tables", "-parquet"),
    "csv": ("tables", "-csv"),
    "wav": ("vibration", ".wav"),
    "hjif": ("vibration", ".hjif"),
    "nwb": ("nwb", ".nwb"),
    "gltf": ("gltf", ".gltf"),
}
"""Format -> the module with its function `write_FORMAT`, and the ending of the file or folder."""


def export(
    recording: Recording,
    to: str,
    out: Path | None = None,
    streams: Sequence[str] = (),
    *,
    every: int | None = None,
) -> list[Path]:
    """Write a recording in another format; returns the files.

    to       one of FORMATS: foxglove (MCAP with JSON channels), parquet, csv (a file per stream), wav, hjif,
             nwb, gltf
    out      file or folder; None: next to the recording
    streams  streams to write; empty: all
    every    write every n-th message; None: all

    RecordingError: an argument is invalid, or a package is missing.
    """
    if to not in FORMATS:
        raise RecordingError(f"--to: found {to!r}, expected one of {', '.join(FORMATS)}")
    for name in streams:
        recording.known(name)
    module, ending = FORMATS[to]
    write = getattr(import_module(f"{__name__}.{module}"), f"write_{to}")
    target = out or recording.path.with_name(recording.path.stem + ending)
    files: list[Path] = write(recording, target, tuple(streams) or tuple(recording.streams), every)
    return files
