"""Normal force f_n, friction force f_f and its part across the motion f_b over time; normal and friction force over the
sliding speed, in the parts of a recording that show their relation.

Region A: the finger slides at constant speed while the normal force varies.
Region B: the normal force is constant while the sliding speed rises.
Both depend only on normal force and speed, not on friction, so that the choice does not bias the result.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.messages import Friction, Proximity
from palpate.physics.friction.components import split_rows
from palpate.views.pictures import style
from palpate.views.pictures.touch import Columns, TouchStreams, together, touches

ORDER, OF_A_FINGER = 40, True

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPEED_BAND = 1.25  # largest ratio of maximum to minimum of a constant speed
FORCE_BAND = 1.06  # the same for the normal force
LEAST_CHANGE = 1.5  # smallest ratio for the other quantity
SLOWEST = 5e-3  # [m/s] lowest sliding speed
BEYOND_DIP = 0.05  # [m/s] default of the speed above which friction no longer falls (the end of the Stribeck effect)
LIGHTEST = 0.05  # smallest normal force, as a fraction of the largest
SHORTEST = 0.05  # [s]

WIDE = 0.04  # [s] of the running mean in region B
SLOW = 1.3  # limit of slow samples, as a multiple of the lowest speed of region B
DIPS_FOR = 2.5  # the same as a multiple of the Stribeck speed: e^(-2.5^2) is 0.002


def _rows(touch: TouchStreams) -> list[Columns] | None:
    """Contact, friction and proximity at their common ticks; None if one was not recorded."""
    contact, friction, near = touch.contact, touch[Friction], touch[Proximity]
    if contact is None or friction is None or near is None:
        return None
    tables = together(contact, friction, near)
    return tables if len(tables[0]["tick"]) else None


def sliding(touch: TouchStreams) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Time [s], normal force [N], friction force [N] and sliding speed [m/s]; None if one was not recorded."""
    tables = _rows(touch)
    if tables is None:
        return None
    length = np.linalg.norm(tables[1]["force"], axis=1), np.linalg.norm(tables[2]["slip"], axis=1)
    return tables[0]["time"], tables[0]["force"], *length


def across(touch: TouchStreams) -> np.ndarray:
    """Friction across the sliding direction, f_b [N] (n), at the instants of `sliding`; 0 without contact."""
    contact, friction, near = _rows(touch) or ({}, {}, {})
    return split_rows(friction["force"], contact["normal"], near["slip"], contact["force"])[1]


def beyond_dip(touch: TouchStreams) -> float:
    """The speed [m/s] above which friction no longer falls, from the settings of the recorded law."""
    speed = touch.settings(touch.stream_of(Friction)).get("stribeck")
    return DIPS_FOR * speed if isinstance(speed, float | int) else BEYOND_DIP


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if normal force, friction or slip were not recorded, or nothing was touched."""
    data = sliding(touch)
    if data is None or not touches(data[0], data[1]):
        return None
    time, normal, _, speed = data
    a, b = regions(time, normal, speed, beyond_dip(touch))
    shown = [(letter, drawn, region) for letter, drawn, region in (("a", _region_a, a), ("b", _region_b, b)) if region]
    out = style.figure(11.5, 10.2 if shown else 6.0, "Friction against normal force and sliding speed", layout="none")
    letters = [letter for letter, _, _ in shown]
    columns = max(len(letters), 1)
    grid: Any = [[name] * columns for name in ("force", "speed")]
    if letters:
        grid += [["."] * columns, letters]  # a row for the label of the time, and titles of two lines
    rows = out.subplot_mosaic(grid, height_ratios=(3, 2, 0.15, 4)[: len(grid)])
    style.place_panels(out, len(grid), columns, left=0.95)
    _time(rows["force"], rows["speed"], data, a, b, touch)
    for letter, drawn, region in shown:
        drawn(rows[letter], data, region)
    return out


def _time(upper: Axes, lower: Axes, data: tuple, a: slice | None, b: slice | None, touch: TouchStreams) -> None:
    time, normal, friction, speed = data
    for axes in (upper, lower):
        for region, colour, letter in ((a, style.REGION_A, "A"), (b, style.REGION_B, "B")):
            if region is not None:
                begin, end = time[region.start], time[region.stop - 1]
                axes.axvspan(begin, end, color=colour, linewidth=0)
                place = axes.get_xaxis_transform()
                axes.text((begin + end) / 2, 0.97, letter, transform=place, ha="center", va="top", weight="bold")
        touch.over_time(axes, time)
    aside = across(touch)
    curves = (
        (normal, style.NORMAL, "normal force $f_n$"),
        (friction, style.FRICTION, "friction force $f_f$"),
        (aside, style.ENERGY, "part across the motion $f_b$"),
    )
    for force, colour, label in curves:
        upper.plot(time, force, color=colour, alpha=0.25, linewidth=0.6)
        upper.plot(time, style.mean(force, time), color=colour, label=label)
    style.legend_above(upper)
    upper.set(ylabel="force [N]", ylim=(min(1.15 * float(aside.min()), 0.0), 1.15 * float(normal.max())), xlabel="")
    upper.tick_params(labelbottom=False)
    touching = np.where(normal > 0.0, speed, np.nan) * 1e3
    lower.plot(time, speed * 1e3, color=style.FAINT, linewidth=0.8, label="in free space")
    lower.plot(time, touching, color=style.SPEED, linewidth=1.2, label="sliding")
    lower.set(ylabel="speed along\nthe surface [mm/s]", ylim=(0.0, 1.15e3 * float(speed.max()) or None))
    style.legend_above(lower)


def _region_a(axes: Axes, data: tuple, region: slice) -> None:
    time, normal, friction, speed = (values[region] for values in data)
    slope = float(normal @ friction / (normal @ normal))
    axes.set_facecolor(style.REGION_A)
    axes.grid(color="white")
    axes.plot(normal, friction, ".", color=style.FRICTION, alpha=0.25, markersize=3)
    axes.plot(style.mean(normal, time), style.mean(friction, time), color=style.FRICTION, linewidth=1.2)
    ends = np.array([0.0, normal.max()])
    axes.plot(ends, slope * ends, "--", color=style.INK, linewidth=1.2, label=f"friction = {slope:.3f} × normal force")
    low, high = np.percentile(speed * 1e3, [5, 95])
    axes.set(xlim=(0.0, None), ylim=(0.0, None), xlabel="normal force [N]", ylabel="friction force [N]")
    axes.set_title(f"A: the normal force varies, the speed is steady:\n{low:.0f} to {high:.0f} mm/s")
    axes.legend(loc="upper left")


def _region_b(axes: Axes, data: tuple, region: slice) -> None:
    normal, friction, speed = (style.mean(values[region], data[0][region], WIDE) for values in data[1:])
    axes.set_facecolor(style.REGION_B)
    axes.grid(color="white")
    slow = speed <= SLOW * speed.min()
    at = float(normal[slow].mean()), float(friction[slow].mean())
    axes.plot(speed * 1e3, normal / at[0], color=style.NORMAL, label=f"normal force, {at[0]:.2f} N where slow")
    axes.plot(speed * 1e3, friction / at[1], color=style.FRICTION, label=f"friction force, {at[1]:.2f} N where slow")
    ratio, share = friction / normal, at[1] / at[0]
    axes.plot(speed * 1e3, ratio / share, color=style.INK, label=f"friction over normal force, {share:.3f} where slow")
    spread = 100 * (normal.max() / normal.min() - 1) / 2
    axes.legend(loc="upper left")
    top = max(float((friction / at[1]).max()), float((ratio / share).max()), 1.05)
    axes.set(xlabel="speed along the surface [mm/s]", ylabel="force over its value where slow [1]")
    axes.set_title(f"B: the speed rises, the normal force is steady:\nwithin ±{spread:.0f} %")
    axes.set_ylim(1.0 - 0.4 * (top - 1.0) - 0.02, 1.0 + 1.5 * (top - 1.0))


def regions(
    time: np.ndarray, normal: np.ndarray, speed: np.ndarray, beyond: float = BEYOND_DIP
) -> tuple[slice | None, slice | None]:
    """Regions A and B as slices of the samples; None if a region is missing.

    time    [s]   (n)  rising
    normal  [N]   (n)  normal force
    speed   [m/s] (n)  of sliding
    beyond  [m/s] ()   least speed in region B: above it friction no longer falls with speed
    """
    if len(time) < 3:
        return None, None
    normal, speed = style.mean(normal, time), style.mean(speed, time)
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
