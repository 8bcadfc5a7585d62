"""Spikes of tactile afferents: raster over time, mean rate of each type, and maps of the rates over the patch."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from palpate.messages import Spikes
from palpate.physics.afferents.population import Population
from palpate.physics.afferents.published import TYPES
from palpate.views.pictures import style
from palpate.views.pictures.touch import TouchStreams

ORDER, OF_A_FINGER = 120, False

COLOURS = (style.SPEED, style.NORMAL, style.FINGER)
WINDOW = 0.05  # [s] over which rates are counted
INSTANTS = 4
PERIOD = 0.2  # [s] of a map: several spikes of a unit that fires at 5 to 20 per second
DOTS = (32, 18, 55)  # [pt²] size of a unit's dot, by type


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if no spikes were recorded."""
    stream = touch.stream_of(Spikes)
    if stream is None or (made := population_of(touch, stream)) is None:
        return None
    unit, moment, time = spikes(touch, stream)
    if len(time) < 2:
        return None
    out = style.figure(12.0, 15.6, f"Spikes of {len(made.kind)} tactile afferents")
    top, bottom = out.subfigures(2, 1, height_ratios=(7.4, 8.2))  # type: ignore[misc]
    raster, *rates, force = top.subplots(5, 1, sharex=True, height_ratios=(4, 1, 1, 1, 1))
    edges = np.arange(time[0], max(time[-1], time[0] + 2 * WINDOW), WINDOW)
    for kind, name in enumerate(TYPES):
        mine, count = made.kind[unit] == kind, int(np.sum(made.kind == kind))
        if not count:
            continue
        raster.plot(moment[mine], unit[mine], linestyle="none", marker="|", markersize=3.5, markeredgewidth=0.8,
                    color=COLOURS[kind])  # fmt: skip
        raster.text(1.005, np.mean(np.flatnonzero(made.kind == kind)), f"{name}\n{count} units", color=COLOURS[kind],
                    transform=raster.get_yaxis_transform(), va="center")  # fmt: skip
        rate = np.histogram(moment[mine], edges)[0] / (count * WINDOW)
        rates[kind].plot(edges[:-1] + 0.5 * WINDOW, rate, color=COLOURS[kind])
        rates[kind].set(ylabel=f"{name} [1/s]", ylim=(0.0, max(1.0, 1.15 * float(rate.max()))))
    raster.set(ylabel="unit", ylim=(len(made.kind), -1))
    raster.grid(False)
    rates[0].set_title(f"Mean rate of the units of each type, over {1e3 * WINDOW:.0f} ms", size=11)
    if touch.contact is not None:
        force.plot(touch.contact["time"], touch.contact["force"], color=style.TISSUE)
    force.set(ylabel="force [N]")
    touch.over_time(force, time)
    _maps(bottom, made, unit, moment, edges)
    return out


def _maps(part: Any, made: Population, unit: np.ndarray, moment: np.ndarray, edges: np.ndarray) -> None:
    """Rates over the patch, when most spikes of a type fall in each quarter of the time: a row and a scale per type."""
    kinds = [kind for kind in range(len(TYPES)) if (made.kind == kind).any()]
    quarters = np.array_split(edges, min(INSTANTS, len(edges)))
    title = f"Rate of each unit over the patch in {1e3 * PERIOD:.0f} ms, with a scale per type; grey: silent"
    part.suptitle(title, x=0.01, ha="left", size=12)
    grid = part.subplots(len(kinds), len(quarters), sharex=True, sharey=True, squeeze=False)
    for row, kind in zip(grid, kinds, strict=True):
        mine = made.kind == kind
        times = np.sort(moment[mine[unit]])
        begins = [max(quarter, key=lambda t: np.ptp(np.searchsorted(times, (t, t + PERIOD)))) for quarter in quarters]
        counts = [np.bincount(unit[(moment >= t) & (moment < t + PERIOD)], minlength=len(mine)) for t in begins]
        rates = np.array(counts) / PERIOD
        most = max(float(rates[:, mine].max()), 1.0)
        for axes, begin, rate in zip(row, begins, rates, strict=True):
            axes.scatter(*(1e3 * made.at[mine & (rate == 0.0), :2].T), s=4, c=style.FAINT, linewidths=0)
            fires = mine & (rate > 0.0)
            axes.scatter(*(1e3 * made.at[fires, :2].T), s=DOTS[kind], c=rate[fires], vmin=0.0, vmax=most,
                         cmap=style.deformation_colours(), linewidths=0)  # fmt: skip
            axes.set(aspect="equal", title=f"{begin:.2f} to {begin + PERIOD:.2f} s")
            axes.grid(False)
        row[0].set_ylabel(f"{TYPES[kind]}: y [mm]", color=COLOURS[kind])
        style.deformation_bar(part, most, f"{TYPES[kind]} [1/s]", ax=list(row), shrink=0.9, aspect=14, pad=0.01)
    for axes in grid[-1]:
        axes.set_xlabel("x [mm]")


def population_of(touch: TouchStreams, stream: str) -> Population | None:
    """The receptors of the node that sent a stream; None if it cannot be made here."""
    node = touch.make(stream)
    try:
        return node.make_population() if node is not None else None
    except ValueError:
        return None


def spikes(touch: TouchStreams, stream: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit and moment [s] of each spike, and the times [s] of the messages."""
    sent: list[Any] = list(touch.recording.messages(stream, touch.read))
    time = np.array([each.time * 1e-9 for each in sent])
    if not sent:
        return np.zeros(0, int), np.zeros(0), time
    return np.concatenate([each.unit for each in sent]), np.concatenate([each.moment for each in sent]), time
