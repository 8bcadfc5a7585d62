"""Times as instruments write them: numbers, stamps since 1970, times of day and dates.

Only the differences of times matter, so the result counts from the first row: `1710504000123456789` (ROS),
`10:22:01.5`, `22:01.5`, `10:22:01 PM`, `2024-03-15T10:22:01.5Z`, `15.03.2024 10:22:01,5`. A time of day that falls by
more than 12 h has passed midnight. A number of a column without a unit has the unit in which it is a date from 2001 to
2100; of days, as Excel and MATLAB count them, only if the rows would be less than `FASTEST` apart in seconds.
"""

import re
from collections.abc import Sequence
from datetime import date
from decimal import Decimal

import numpy as np

DAY, HALF = 86400.0, 43200.0  # [s]
EPOCH = (978307200.0, 4102444800.0)  # [s] since 1970, of the years 2001 and 2100
STAMPS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
DAYS = ((36892.0, 73051.0), (730852.0, 767011.0))  # [days] of the same years: Excel, MATLAB (datenum)
FASTEST = 5e-6  # [s] Time between rows that no press has; as days it is 0.4 s
LARGE = 1e6  # Numbers above are subtracted before they are rounded to 53 bits
CLOCK = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|\d\d?[-/. ](?:\d\d?|[A-Za-z]{3})[-/. ]\d{2,4})[T _,]\s*)?"
    r"(?:(?P<hours>\d{1,2}):)?(?P<minutes>\d{1,2}):(?P<seconds>\d{1,2}(?:[.,:]\d*)?)\s*(?P<half>[AaPp][Mm])?"
    r"\s*(?:Z|UTC|[+-]\d\d:?\d\d)?"
)


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, with or without a date."""
    return CLOCK.fullmatch(cell.strip()) is not None


def clock_seconds(cells: Sequence[tuple[int, str]]) -> np.ndarray:
    """Seconds (n,) from the first of the cells (line, text). ValueError: one is no time of day; two numbers only."""
    read = [_parts(line, cell) for line, cell in cells]
    out, days, before = np.zeros(len(read)), 0, read[0] if read else (None, 0.0)
    first = before
    for k, (day, second) in enumerate(read):
        if day is None or first[0] is None:
            days += int(second < before[1] - HALF) - int(second > before[1] + HALF)
        else:
            days = day - first[0]
        out[k], before = days * DAY + (second - first[1]), (day, second)
    return out


def _parts(line: int, cell: str) -> tuple[int | None, float]:
    """Day, None if the order of its numbers is not known, and seconds of the day."""
    match = CLOCK.fullmatch(cell.strip())
    if match is None:
        raise ValueError(f"row {line}: found {cell.strip()!r}, expected a time such as 10:22:01.5")
    seconds = match["seconds"].replace(",", ".").replace(":", ".")
    if match["hours"] is None and "." not in seconds:
        raise ValueError(f"row {line}: found {cell.strip()!r}: hours and minutes, or minutes and seconds?")
    hours = int(match["hours"] or 0)
    if match["half"]:
        hours = hours % 12 + 12 * (match["half"].lower() == "pm")
    try:
        day = date(*(int(match[k]) for k in ("year", "month", "day"))).toordinal() if match["year"] else None
    except ValueError:
        raise ValueError(f"row {line}: found {cell.strip()!r}, which is no date") from None
    return day, 3600.0 * hours + 60.0 * int(match["minutes"]) + float(seconds)


def from_first(numbers: Sequence[str]) -> np.ndarray:
    """Differences (n,) of numbers, as texts with a decimal point, from the first one, exact to 53 bits."""
    first = Decimal(numbers[0])
    return np.array([float(Decimal(text) - first) for text in numbers])


def stamp_unit(first: float) -> str:
    """The unit in which a number is a date from 2001 to 2100; "" if it is none."""
    return next((unit for unit, scale in STAMPS.items() if EPOCH[0] * scale <= first <= EPOCH[1] * scale), "")


def are_days(numbers: np.ndarray) -> bool:
    """Whether numbers (n,) without a unit are dates in days, `45366.432100` (Excel) or `739326.432100` (MATLAB)."""
    if len(numbers) < 2 or not any(low <= numbers[0] <= high for low, high in DAYS):
        return False
    return bool(0.0 < float(np.median(np.diff(numbers))) < FASTEST)
