"""Texts as the cells of a table with tabs between columns: what is stored is what is read back."""

from collections.abc import Sequence

_BREAKS = {"\t": "a tab", "\n": "a line break", "\r": "a carriage return"}


def misfit(text: str) -> str:
    """Why a text cannot be a cell of a table; "" if it can."""
    if not text:
        return "it is empty"
    for mark, name in _BREAKS.items():
        if mark in text:
            return f"it has {name}"
    try:
        text.encode()
    except UnicodeEncodeError:
        return "it is not valid Unicode"
    return ""


def encode_row(texts: Sequence[str]) -> bytes:
    """A row without its line break. ValueError: a text cannot be a cell; names it and why."""
    for text in texts:
        if why := misfit(text):
            raise ValueError(f"found {text!r}, expected a text for a table: {why}")
    return "\t".join(texts).encode()


def decode_row(line: bytes) -> list[str]:
    """The texts of a row; invalid bytes, as of a damaged file, become U+FFFD."""
    return line.decode(errors="replace").split("\t")
