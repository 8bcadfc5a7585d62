"""From docstrings to Markdown."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence

_FIELD = re.compile(r"([A-Za-z_]\w*(?:, [A-Za-z_]\w*)*)  +(\S.*)")


def escaped(text: str) -> str:
    """Text with Markdown's special characters escaped, except between backticks."""
    parts = text.split("`")
    if len(parts) % 2 == 0:
        parts = [text]
    return "`".join(part if place % 2 else _plain(part) for place, part in enumerate(parts))


def _plain(text: str) -> str:
    """Escape special characters and turn names of pages into links."""
    text = re.sub(r"([\\*_<>\[\]`$#])", r"\\\1", text)
    return re.sub(r"\bdocs/([\w/-]+)\.md\b", r"[\1](../\1.md)", text)


def cell(value: object) -> str:
    """Text of a cell of a table, and of one line."""
    return escaped(" ".join(str(value).split())).replace("|", "\\|")


def table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    """Lines of a table; none without rows."""
    if not rows:
        return []
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    return [*lines, *(f"| {' | '.join(cell(value) for value in row)} |" for row in rows), ""]


def prose(doc: str) -> str:
    """A docstring as Markdown: paragraphs, lists of names with their meaning, and indented text as code."""
    blocks, code = [], []
    for block in [*re.split(r"\n\s*\n", inspect.cleandoc(doc)), ""]:
        lines = block.splitlines()
        if lines and all(line.startswith("    ") for line in lines):
            code.append("\n".join(line[4:] for line in lines))
            continue
        if code:
            blocks.append("```text\n" + "\n\n".join(code) + "\n```")
            code = []
        if lines:
            blocks.append(_block(lines))
    return "\n\n".join(blocks)


def _block(lines: list[str]) -> str:
    """A paragraph, or a list where each line names something; further lines of an entry are indented."""
    text: list[str] = []
    for place, line in enumerate(lines):
        match = _FIELD.fullmatch(line)
        if match:
            text.append(f"* `{match[1]}`: {escaped(match[2])}")
        elif line.startswith("    ") and not any(_FIELD.fullmatch(one) for one in lines[:place]):
            return "\n".join(escaped(one) for one in lines[:place]) + _code(lines[place:])
        else:
            text.append(("  " if text and text[-1].startswith(("* ", "  ")) else "") + escaped(line.strip()))
    first = next((place for place, line in enumerate(text) if line.startswith("* ")), None)
    return "\n".join(text if not first else [*text[:first], "", *text[first:]])


def _code(lines: list[str]) -> str:
    return "\n\n```text\n" + inspect.cleandoc("\n".join(lines)) + "\n```"
