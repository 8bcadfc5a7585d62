"""Maps of a fingertip's pad: pressure during press and hold, then the propagation of slip through the contact."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.messages import Slip, Surface
from palpate.views.pictures.slip import Phases, slides
from palpate.views.pictures.style import figure
from palpate.views.pictures.touch import TouchStreams

ORDER, OF_A_FINGER = 90, False

COLUMNS = 5
APART, STUCK = "#f2f2f5", "#8d8d99"


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a recorded Slip."""
    slide = slides(touch)
    if slide is None:
        return None
    contact, _, _, phase = slide
    rows = moments(contact["force"], contact["compression"], phase)
    ticks = contact["tick"][rows].tolist()
    slips, surfaces = touch.at(Slip, ticks), touch.at(Surface, ticks)
    if not set(ticks) <= set(slips) or not len(slips[ticks[0]].points):
        return None
    out = figure(2.5 * len(rows) + 1.0, 6.3, "The pad of the fingertip, seen from below through the plate")
    grid = out.subplots(2, len(rows), squeeze=False, sharex=True, sharey=True)
    pressures = [_pressure(slips[tick], surfaces.get(tick)) * 1e-3 for tick in ticks]
    most = max(float(p.max()) for p in pressures) or 1.0
    # Lightly pressed nodes at the rim slide much farther than the others: they get the last colour.
    slid = slips[ticks[-1]].path
    way = float(np.percentile(slid[slid > 0.0], 90)) * 1e3 if (slid > 0.0).any() else 1.0
    for column, (row, tick, pressure) in enumerate(zip(rows, ticks, pressures, strict=True)):
        slip, force = slips[tick], contact["force"][row]
        shown = _dots(grid[0][column], slip, pressure > 0.0, pressure, "inferno_r", most)
        grid[0][column].set_title(f"{contact['time'][row]:.2f} s:  {force:.2f} N", loc="center")
        if pressure.any():
            centre = (slip.points * pressure[:, None]).sum(axis=0) / pressure.sum() * 1e3
            grid[0][column].plot(*centre, "+", color="white", markersize=11, markeredgewidth=2)
        moved = _dots(grid[1][column], slip, slip.state == 2, slip.path * 1e3, "viridis_r", way)
        grid[1][column].set_title(f"{100 * slip.fraction:.0f} % sliding", loc="center")
        grid[1][column].set_xlabel("←  across x [mm]")
    grid[0][0].invert_xaxis()  # seen from below through the plate, x points to the left if y points up
    for axes in grid[:, 0]:
        axes.set_ylabel("tip  ←  y [mm]  →  hand")
    out.colorbar(shown, ax=grid[0], label="pressure [kPa]   (+ its centre)", pad=0.01)
    out.colorbar(moved, ax=grid[1], label="slipped [mm]   (grey: sticks)", pad=0.01, extend="max")
    return out


def moments(normal: np.ndarray, depth: np.ndarray, at: Phases) -> list[int]:
    """Rows to show: the full depth, then equal steps from the begin of the slide to gross slip."""
    pressed = int(np.argmax(depth >= depth.max() * (1 - 1e-9)))
    if at.begin is None:
        return sorted({pressed, int((pressed + at.end) / 2), at.end})
    last = at.gross if at.gross is not None else at.end
    start = at.warned if at.warned is not None else at.begin
    slide = np.linspace(start, last, COLUMNS - 2).round().astype(int).tolist()
    return sorted({pressed, max(at.begin - 1, 0), *slide})


def _pressure(slip: Slip, surface: Any) -> np.ndarray:
    """Pressure of each node of the pad [Pa]; 0 without contact or surface."""
    pressure = np.zeros(len(slip.points))
    if surface is not None and len(surface.pressure) == len(surface.nodes):
        inside = (surface.nodes >= 0) & (surface.nodes < len(pressure))
        pressure[surface.nodes[inside]] = surface.pressure[inside]
    return pressure


def _dots(axes: Axes, slip: Slip, coloured: np.ndarray, values: np.ndarray, colours: str, most: float) -> Any:
    x, y = slip.points.T * 1e3
    size = _size(slip.points)
    for where, colour in ((slip.state == 0, APART), ((slip.state > 0) & ~coloured, STUCK)):
        axes.scatter(x[where], y[where], c=colour, s=size, marker="s", linewidths=0)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    return axes.scatter(
        x[coloured], y[coloured], c=values[coloured], s=size, marker="s", linewidths=0, cmap=colours, vmin=0, vmax=most
    )


def _size(points: np.ndarray) -> float:
    """Size of a marker [pt²] that roughly fills a node's cell."""
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    columns = np.unique(np.round(points[:, 0], 7))
    pitch = float(np.diff(columns).min()) if len(columns) > 1 else extent
    return float(np.clip((137.0 * pitch / max(extent + pitch, 1e-9)) ** 2, 2.0, 400.0))
