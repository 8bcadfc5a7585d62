"""Printing: lines, tables, JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from palpate.launch.run.wire.printable import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from palpate.messages import Message


def console(**options: Any) -> Console:
    """A rich console on standard output, without markup, since paths and hints contain brackets. Control characters in
    a text are shown, not obeyed."""
    from rich.console import Console
    from rich.segment import Segment

    class PlainConsole(Console):
        def render(self, renderable: Any, options: Any = None) -> Iterator[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(printable(segment.text), segment.style)

    return PlainConsole(**{"highlight": False, "markup": False, **options})


def print_json(data: Any) -> None:
    print_encoded(json.dumps(data, indent=2, ensure_ascii=False, default=str))


def print_encoded(text: str) -> None:
    """Print JSON. The control characters that it may contain unescaped are escaped."""
    write(re.sub(r"[\x7f-\x9f]", lambda found: f"\\u{ord(found[0]):04x}", text))


def write(text: str, *, err: bool = False) -> None:
    """Write a text as it is, except that control characters are shown."""
    typer.echo(printable(text), err=err)


def say(text: object, style: str = "", *, err: bool = False, wrap: bool = False) -> None:
    """Print text without markup; `wrap`: break lines between words at the width of the terminal."""
    from rich.text import Text

    console(stderr=err, soft_wrap=not wrap).print(Text(str(text), style=style))


def table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    title: str = "",
    caption: str = "",
    fixed: Container[str] = (),
    bold: Container[int] = (),
) -> Table:
    """A table without lines and markup.

    heads  of the columns, with ">" in front if right-aligned; all empty: no header
    fixed  heads of the columns that are never wrapped
    bold   numbers of the rows in bold
    """
    from rich.table import Table
    from rich.text import Text

    shown = Table(
        box=None, pad_edge=False, show_header=any(heads), title=title or None, title_justify="left",
        caption=caption or None, caption_justify="left",
    )  # fmt: skip
    for head in heads:
        side = "right" if head.startswith(">") else "left"
        widest = max(map(len, head.lstrip(">").split()), default=0)  # a head wraps only between words
        shown.add_column(Text(head.lstrip(">")), justify=side, overflow="fold", no_wrap=head in fixed, min_width=widest)  # type: ignore[arg-type]
    for number, row in enumerate(rows):
        cells = (Text(cell) if isinstance(cell, str) else cell for cell in row)
        shown.add_row(*cells, style="bold" if number in bold else None)
    return shown


def line(message: Message) -> Text:
    """One message as a line of text, each value with its unit."""
    import numpy as np
    from rich.text import Text

    from palpate.messages import fields

    text = Text(f"{message.time * 1e-9:12.6f} s  {message.tick:>7} ", style="cyan")
    for field in fields(type(message)):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            size = "x".join(map(str, value.shape))
            peak = f", up to {np.abs(value).max():.4g}" if value.size and value.dtype.kind == "f" else ""
            shown = f"({size}{peak})"
        elif isinstance(value, tuple):
            shown = f"({', '.join(f'{v:.5g}' for v in value)})"
        else:
            shown = f"{value:.5g}" if isinstance(value, float) else str(value)
        text.append(f"  {field.name} ", style="dim")
        text.append(shown, style="default")
        if field.unit != "1":
            text.append(f" {field.unit}", style="green")
    return text


def draw_if_possible(draw: Callable[..., list[Path]], *args: Any) -> list[Path]:
    """Draw with a function, and return the pictures. If a package is missing, return none and print a hint."""
    from palpate.physics.extras import missing

    try:
        return draw(*args)
    except ModuleNotFoundError as error:
        say(missing("no pictures", error.name, "view"), err=True)
        return []
