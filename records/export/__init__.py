"""Recordings in the formats that other tools open."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

FORMATS = ("foxglove", "rerun", "parquet", "csv", "vtk")
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
             stream), vtk (a series of surfaces for ParaView)
    out      file or folder; None: beside the recording
    streams  to write; none: all that fit
    every    each n-th message only; None: all of a table, 30 surfaces in a second
    tell     gets a line for each thing that is left out of a scene

    RecordingError: what does not fit, or which package is missing.
    """
    if to not in FORMATS:
        raise RecordingError(f"--to: found {to!r}, expected one of {', '.join(FORMATS)}")
    for name in streams:
        recording.known(name)
    writers: dict[str, Callable[..., list[Path]]] = {}
    if to == "foxglove":
        from palpate.records.export.foxglove import write_foxglove

        writers[to] = partial(write_foxglove, tell=tell)
    elif to == "rerun":
        from palpate.records.export.rerun import write_rerun

        writers[to] = partial(write_rerun, tell=tell)
    elif to == "vtk":
        from palpate.records.export.vtk import write_vtk

        writers[to] = write_vtk
    else:
        from palpate.records.export.tables import write_csv, write_parquet

        writers |= {"csv": write_csv, "parquet": write_parquet}
    target = out or recording.path.with_name(recording.path.stem + ENDINGS.get(to, f"-{to}"))
    return writers[to](recording, target, tuple(streams) or tuple(recording.streams), every)
