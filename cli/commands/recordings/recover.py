"""`palpate recover`: a complete file from one that was cut off or damaged, or that holds its sources only."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import File, Json, Trust
from palpate.cli.terminal.output import say, tell
from palpate.physics.errors import TROUBLE


def recover(
    file: File,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="File to write; by default next to the recording.")
    ] = None,
    full: Annotated[
        bool, typer.Option("--full", help="Of a recording of sources: compute and write all messages.")
    ] = False,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Make a complete recording from the readable part of a truncated or damaged one.

    --full turns a recording of sources into one with all messages. Exit code 1 if a computed message differs from the
    recorded one; the messages before it are written.
    """
    from palpate.records.fill import explained, recover_full
    from palpate.records.fill import recover as save
    from palpate.records.reader import Recording

    if full:
        target, counts, report = recover_full(file, out)
        wrong = explained(file, report, Recording(file).about) if report.first is not None else ""
    else:
        (target, counts), wrong = save(file, out), ""
    if as_json:
        tell({"ok": not wrong, "file": str(target), "counts": counts, "difference": wrong or None})
    else:
        say(f"{target}: {sum(counts.values())} messages of {len(counts)} streams", wrap=True)
        if wrong:
            say(wrong, "red", err=True)
    if wrong:
        raise typer.Exit(TROUBLE)
