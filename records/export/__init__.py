"""Recordings in the formats that other tools open."""

from collections.abc import Callable, Sequence
from pathlib import Path

from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

FORMATS = ("foxglove", "rerun", "parquet", "csv")
ENDINGS = {"foxglove": ".foxglove.mcap", "rerun": ".rrd"}


def export(
    recording: Recording,
    to: str,
    out: Path | None = None,
    streams: Sequence[str] = (),
    *,
    every: int | None = None,
    tell: Callable[[str], object] = lambda _: None,
) -> list[Path]:
    """Write a recording in another format; the files written.

    to       one of FORMATS: foxglove (MCAP with JSON channels and a scene), rerun (.rrd), parquet, csv (a file per
             stream)
    out      file or folder; None: beside the recording
    streams  to write; none: all that fit
    every    each n-th message only; None: all numbers, 30 surfaces in a second
    tell     gets a line for each thing that is left out of a scene

    RecordingError: what does not fit, or which package is missing.
    """
    if to not in FORMATS:
        raise RecordingError(f"--to: found {to!r}, expected one of {', '.join(FORMATS)}")
    for name in streams:
        recording.known(name)
    target = out or recording.path.with_name(recording.path.stem + ENDINGS.get(to, f"-{to}"))
    what = recording, target, tuple(streams) or tuple(recording.streams), every
    # Each file imports what its format takes.
    if to == "foxglove":
        from palpate.records.export.foxglove import write_foxglove

        return write_foxglove(*what, tell=tell)
    if to == "rerun":
        from palpate.records.export.rerun import write_rerun

        return write_rerun(*what, tell=tell)
    from palpate.records.export.tables import write_csv, write_parquet

    return (write_csv if to == "csv" else write_parquet)(*what)
