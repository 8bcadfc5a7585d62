"""Numbers as instruments write them: decimal comma or point, separators of thousands, typographic minus signs.

Thousands may be separated by a comma, a point, an apostrophe, or a blank of any width.
"""

import re
from collections.abc import Sequence

DIALECTS = ("decimal-comma", "decimal-point")
GROUPS = re.compile(r"[+-]?\d{1,3}(?:[ '’\u00a0\u2009\u202f]\d{3})+(?:[.,]\d*)?")
MARKS = re.compile(r"[ '’\u00a0\u2009\u202f]")
COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
COMMA_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?")
POINT_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?")

THOUSANDS = {"comma": COMMA_THOUSANDS, "point": POINT_THOUSANDS}


def check_dialect(dialect: str | None) -> None:
    """ValueError: an unknown dialect."""
    if dialect and dialect not in DIALECTS:
        raise ValueError(f"--dialect: found {dialect!r}, expected {' or '.join(DIALECTS)}")


def decimal_sign(cells: Sequence[tuple[int, str]], dialect: str | None) -> str:
    """Decimal sign of cells (line, text).

    dialect  one of `DIALECTS`, "" to detect it, or None if the caller has no option for it

    ValueError: comma and point are equally likely, with the line.
    """
    if dialect:
        return "," if dialect == "decimal-comma" else "."
    texts = [(line, _plain(cell)) for line, cell in cells if "," in cell or "." in cell]
    commas = [(line, text) for line, text in texts if "," in text]
    grouped = any(POINT_THOUSANDS.fullmatch(text) for _, text in commas)
    numbers = [(line, text) for line, text in commas if COMMA.fullmatch(text)]
    cure = f"Set --dialect {' or '.join(DIALECTS)}" if dialect is not None else "Write numbers with a decimal point"
    if grouped or any(not COMMA_THOUSANDS.fullmatch(text) for _, text in numbers):
        points = [(line, text) for line, text in texts if "," not in text and POINT_THOUSANDS.fullmatch(text)]
        if points and not grouped:
            line, text = points[0]
            raise ValueError(
                f"row {line}: found {text!r}, a decimal point or a separator of thousands? Other rows have decimal "
                f"commas. {cure}"
            )
        return ","
    points = [(line, text) for line, text in texts if "." in text]
    for which, found, other in (("comma", numbers, points), ("point", points, commas)):
        if found and not other and all(THOUSANDS[which].fullmatch(text) for _, text in found):
            line, text = found[0]
            raise ValueError(f"row {line}: found {text!r}, a decimal {which} or a separator of thousands? {cure}")
    return "."


def number(text: str, decimal: str = ".") -> float | None:
    """A number with this decimal sign; None: the text is no number."""
    text = with_point(text, decimal)
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None


def with_point(text: str, decimal: str = ".") -> str:
    """A number with a decimal point and without separators of thousands; another text without its blanks."""
    text = _plain(text)
    if decimal == ",":
        return (text.replace(".", "") if POINT_THOUSANDS.fullmatch(text) else text).replace(",", ".")
    if "," in text and COMMA_THOUSANDS.fullmatch(text):
        return text.replace(",", "")
    return text


def _plain(text: str) -> str:
    """The text without the blanks and apostrophes that group its digits."""
    text = text.strip()
    if text.isascii() and " " not in text and "'" not in text:
        return text
    text = text.replace("−", "-")
    return MARKS.sub("", text) if GROUPS.fullmatch(text) else text
