"""Finds the parts of a recording that show the dependence of friction on normal force and on speed.

Region A: the finger slides at constant speed while the normal force varies.
Region B: the normal force is constant while the sliding speed rises.
Both depend only on normal force and speed, not on friction, so that the choice does not bias the result.
"""

import numpy as np

from palpate.views.pictures.style import mean

SPEED_BAND = 1.25  # largest ratio of maximum to minimum of a constant speed
FORCE_BAND = 1.06  # the same for the normal force
LEAST_CHANGE = 1.5  # smallest ratio for the other quantity
SLOWEST = 5e-3  # [m/s] lowest sliding speed
BEYOND_DIP = 0.05  # [m/s] default speed above which friction no longer falls with speed
LIGHTEST = 0.05  # smallest normal force, as a fraction of the largest
SHORTEST = 0.05  # [s]


def regions(
    time: np.ndarray, normal: np.ndarray, speed: np.ndarray, beyond: float = BEYOND_DIP
) -> tuple[slice | None, slice | None]:
    """Regions A and B as slices of the samples; None if there is no such region.

    time    [s]   (n)  rising
    normal  [N]   (n)  normal force
    speed   [m/s] (n)  of sliding
    beyond  [m/s] ()   least speed in region B: above it friction no longer falls with speed
    """
    if len(time) < 3:
        return None, None
    normal, speed = mean(normal, time), mean(speed, time)
    pressed = normal > max(LIGHTEST * float(normal.max()), 0.0)
    a = _best(time, speed, normal, pressed & (speed > SLOWEST), SPEED_BAND, rising=False)
    b = _best(time, normal, speed, pressed & (speed > beyond), FORCE_BAND, rising=True)
    return a, b


def _best(
    time: np.ndarray, held: np.ndarray, varied: np.ndarray, allowed: np.ndarray, band: float, *, rising: bool
) -> slice | None:
    """The interval in which one quantity stays within its band and the other changes enough. Of several, the one with
    the largest product of range and duration, so that a short lift-off is not chosen."""
    best, stretch = 0.0, None
    for begin, end in _stretches(held, allowed, band):
        part = varied[begin:end]
        if rising:
            top = int(part.argmax())
            bottom = int(part[: top + 1].argmin())
            begin, end = begin + bottom, begin + top + 1
        low, high = float(varied[begin:end].min()), float(varied[begin:end].max())
        duration = float(time[end - 1] - time[begin])
        if high >= LEAST_CHANGE * low and duration >= SHORTEST and (high - low) * duration > best:
            best, stretch = (high - low) * duration, slice(begin, end)
    return stretch


def _stretches(held: np.ndarray, allowed: np.ndarray, band: float) -> list[tuple[int, int]]:
    """All maximal intervals of allowed samples with max(held) <= band min(held)."""
    stretches: list[tuple[int, int]] = []
    begin, low, high = 0, np.inf, -np.inf
    for i, (ok, value) in enumerate(zip([*allowed.tolist(), False], [*held.tolist(), 0.0], strict=True)):
        lower, higher = min(low, value), max(high, value)
        if ok and higher <= band * lower:
            low, high = lower, higher
            continue
        if i > begin:
            stretches.append((begin, i))
        if ok:  # restart after the last sample that is not in a band with this one
            before = held[begin:i]
            begin += 1 + int(np.flatnonzero((before > band * value) | (value > band * before))[-1])
            low, high = float(held[begin : i + 1].min()), float(held[begin : i + 1].max())
        else:
            begin, low, high = i + 1, np.inf, -np.inf
    return stretches
