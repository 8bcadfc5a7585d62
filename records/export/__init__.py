"""Exports recordings to formats of other tools."""

from collections.abc import Sequence
from pathlib import Path

from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

FORMATS = ("foxglove", "parquet", "csv", "wav", "hjif", "nwb", "gltf")


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
    ending = {"foxglove": ".foxglove.mcap", "parquet": "-parquet", "csv": "-csv"}.get(to, f".{to}")
    target = out or recording.path.with_name(recording.path.stem + ending)
    what = recording, target, tuple(streams) or tuple(recording.streams), every
    if to == "foxglove":
        from palpate.records.export.foxglove import write_foxglove

        return write_foxglove(*what)
    if to in ("wav", "hjif"):
        from palpate.records.export.vibration import write_hjif, write_wav

        return (write_wav if to == "wav" else write_hjif)(*what)
    if to == "nwb":
        from palpate.records.export.nwb import write_nwb

        return write_nwb(*what)
    if to == "gltf":
        from palpate.records.export.gltf import write_gltf

        return write_gltf(*what)
    from palpate.records.export.tables import write_csv, write_parquet

    return (write_csv if to == "csv" else write_parquet)(*what)
