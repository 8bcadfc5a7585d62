"""`palpate picture organ FILE`: an organ in three planes, and its numbers."""

from __future__ import annotations

from pathlib import Path

from palpate.cli.terminal.options import check_ending, organ_file
from palpate.cli.terminal.output import print_json, say, write


def picture_organ(
    file: Path, unit: str | None, piece: str | None, label: str | None, out: Path | None, as_json: bool
) -> None:
    """Draw an organ, and print its numbers."""
    from palpate.nodes.base.felt import WIDTH
    from palpate.views.pictures.models.organ import describe_organ, draw_organ, rows

    organ, _ = organ_file(file, unit, piece, False, label=label)
    assert organ is not None
    target = out or file.with_name(f"{organ.stem}-organ.png")
    check_ending(target)
    shown = describe_organ(organ)
    draw_organ(shown, WIDTH, target)
    if as_json:
        print_json({"ok": True, "pictures": [str(target)], "organ": rows(shown), "notes": list(shown.notes)})
        return
    for note in shown.notes:
        say(note, err=True)
    write(str(target))
