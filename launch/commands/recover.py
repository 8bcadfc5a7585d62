"""`palpate recover`: a complete file from one that was cut off or damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.launch.commands.common import Json, console, tell
from palpate.launch.commands.info import File


def recover(
    file: File,
    out: Annotated[Path | None, typer.Option(help="File to write; by default beside the recording.")] = None,
    as_json: Json = False,
) -> None:
    """Make a complete recording from the readable part of a truncated or damaged one."""
    from palpate.records.recover import recover as save

    target, counts = save(file, out)
    if as_json:
        tell({"ok": True, "file": str(target), "counts": counts})
        return
    from rich.text import Text

    console().print(Text(f"{target}: {sum(counts.values())} messages of {len(counts)} streams"))
