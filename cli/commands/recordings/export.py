"""`palpate export`: a recording in the formats of other tools."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, Sets, Trust
from palpate.cli.terminal.output import say, tell


def export(
    file: Annotated[Path, typer.Argument(help="Recording (.mcap); for fmu a graph.", metavar="FILE")],
    to: Annotated[str, typer.Option(help="foxglove, rerun, parquet or csv; fmu.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File (foxglove, rerun, fmu) or folder; by default next to the recording."),
    ] = None,
    stream: Annotated[list[str] | None, typer.Option(help="Only this stream; may be repeated.")] = None,
    every: Annotated[
        int | None,
        typer.Option(help="Only every n-th message; by default all numbers, and 30 surfaces per second.", min=1),
    ] = None,
    sets: Sets = None,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Write a recording as MCAP with a scene (Foxglove, PlotJuggler), for Rerun, as Parquet or CSV.

    With --to fmu, write a graph as a unit for co-simulation (FMI 3.0); --set is for it alone.
    """
    if to == "fmu":
        from palpate.launch.fmu import export_fmu

        unit = export_fmu(str(file), out, sets or ())
        if as_json:
            tell({"ok": True, "files": [str(unit)]})
        else:
            say(f"{unit}: {unit.stat().st_size / 1e6:.2f} MB", wrap=True)
        return
    if sets:
        raise typer.BadParameter("--set is for --to fmu: a recording is as it is; `palpate replay` computes it anew")
    from palpate.records.export import export as write
    from palpate.records.reader import Recording

    recording = Recording(file)
    notes: list[str] = []
    written = write(recording, to, out, stream or (), every=every, tell=notes.append)
    if as_json:
        files = [str(path) for path in written]
        tell({"ok": True, "files": files, "notes": notes, "complete": recording.complete, "ending": recording.ending})
        return
    size = sum(path.stat().st_size for path in written)
    where = written[0] if len(written) == 1 else written[0].parent
    say(f"{where}: {len(written)} file{'s' * (len(written) != 1)}, {size / 1e6:.2f} MB", wrap=True)
    for note in notes:
        say(note, "yellow")
    if not recording.complete:
        say(recording.ending, "yellow")
