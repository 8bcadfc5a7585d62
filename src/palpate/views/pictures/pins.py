"""The pins of a display at several moments, and over time with the force, the actuator and the stop of the pins.

The second row of a display that shows the surface is the change that a nodule makes: heights less their median while
the finger slides far from it. Without a nodule or a slide far from it, it is the part that is not axisymmetric.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.messages import Pins, Surface
from palpate.nodes.display import tangent_frame
from palpate.physics.display.pins import pin_grid
from palpate.views.pictures.style import FAINT, FINGER, NORMAL, REGION_B, TISSUE, figure
from palpate.views.pictures.touch import Columns, TouchStreams, together

ORDER, OF_A_FINGER = 100, False

COLUMNS = 5
FAR = 3.0  # [1] distance to the nodule over its radius from which the pins count as those without a nodule
STEADY = 0.8  # [1] smallest force of these times, as a fraction of the largest
STOPPED = 0.999  # [1] share of the stroke from which a pin counts as at its stop


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if no pins were recorded, or nothing was touched."""
    columns = touch[Pins]
    if columns is None or touch.contact is None:
        return None
    pins, contact = together(columns, touch.contact)
    sent = touch.at(Pins, pins["tick"].tolist())
    heights = np.array([sent[tick].heights for tick in pins["tick"].tolist()]) * 1e3
    settings = touch.settings(touch.stream_of(Pins))
    below = settings.get("shows", "force") != "force"
    body = touch.settings(touch.stream_of(Surface))
    radius, position = body.get("nodule_radius", 0.0), body.get("nodule_position")
    nodule = (radius, np.asarray(position)) if below and radius and position is not None else None
    rows = moments(contact["force"], None if nodule is None else np.linalg.norm(contact["foot"] - nodule[1], axis=1))
    if not rows:
        return None
    circle = "" if nodule is None else "  (dashed: outline of the nodule)"
    out = figure(2.3 * len(rows) + 1.2, 8.6 if below else 6.6, f"What the pins show{circle}")
    parts = out.subfigures(2, 1, height_ratios=(5 if below else 2.6, 4))
    assert isinstance(parts, np.ndarray)
    top, bottom = parts
    grid = top.subplots(1 + below, len(rows), squeeze=False, sharex=True, sharey=True)
    pitch = float(settings.get("pitch", 2e-3)) * 1e3
    places = pin_grid(heights.shape[1], heights.shape[2], pitch)  # [mm]
    most = max(float(heights[rows].max()), 1e-6)
    plain = None if nodule is None else without_nodule(heights, contact, *nodule)
    uneven = [heights[row] - (ring_mean(heights[row], places) if plain is None else plain) for row in rows]
    rest = max(max(float(np.abs(u).max()) for u in uneven), 1e-6)
    title = "part that is not axisymmetric" if plain is None else "change by the nodule"
    less = (
        "height less the mean\nat that distance [mm]"
        if plain is None
        else "height less that of the\nslide far from it [mm]"
    )
    for column, row in enumerate(rows):
        shown = _map(grid[0][column], heights[row], places, pitch, "viridis", 0.0, most)
        grid[0][column].set_title(f"{contact['time'][row]:.2f} s:  {contact['force'][row]:.2f} N", loc="center")
        if below:
            lumps = _map(grid[1][column], uneven[column], places, pitch, "RdBu_r", -rest, rest)
            grid[1][column].set_title(title, loc="center")
        if nodule is not None:
            for axes in grid[:, column]:
                _circle(axes, *nodule, contact["foot"][row], contact["normal"][row], places, pitch)
    for axes in grid[-1]:
        axes.set_xlabel("columns, x [mm]")
    for axes in grid[:, 0]:
        axes.set_ylabel("rows, y [mm]")
    top.colorbar(shown, ax=grid[0], label="height [mm]", pad=0.01)
    if below:
        top.colorbar(lumps, ax=grid[1], label=less, pad=0.01)
    _over_time(bottom, touch, pins, contact, heights, nodule, 1e3 * float(settings.get("stroke", np.inf)))
    return out


def moments(force: np.ndarray, distance: np.ndarray | None = None) -> list[int]:
    """Rows to show: equal steps from 10 % to 90 % of the contact; none without contact. With the distance (n) of the
    finger to a nodule, the one that is next to its minimum is moved there."""
    at = np.flatnonzero(force > 0.0)
    if not len(at):
        return []
    rows = np.array([int(at[round(q * (len(at) - 1))]) for q in np.linspace(0.1, 0.9, COLUMNS)])
    if distance is not None:
        nearest = int(at[distance[at].argmin()])
        rows[np.abs(rows - nearest).argmin()] = nearest
    return sorted(set(rows.tolist()))


def ring_mean(heights: np.ndarray, places: np.ndarray) -> np.ndarray:
    """For each pin, the mean height of all pins at its distance from the centre (rows,columns)."""
    distance = np.round(np.hypot(places[..., 0], places[..., 1]), 9)
    _, ring = np.unique(distance.ravel(), return_inverse=True)
    mean = np.bincount(ring.ravel(), heights.ravel()) / np.bincount(ring.ravel())
    return mean[ring.ravel()].reshape(heights.shape)


def without_nodule(heights: np.ndarray, contact: Columns, radius: float, position: np.ndarray) -> np.ndarray | None:
    """Median heights (rows,columns) while the pressed finger slides far from the nodule; None if it never does.

    heights  (n,rows,columns) at the times of the contact;  radius, position [m] of the nodule
    """
    foot = contact["foot"]
    away = np.linalg.norm(foot - position, axis=1) >= FAR * radius
    slides = np.append(0.0, np.linalg.norm(np.diff(foot, axis=0), axis=1)) > 0.0
    # The finger slides towards the nodule, so the skin that it drags is that of the times over the nodule.
    ahead = np.arange(len(foot)) < np.argmin(np.linalg.norm(foot - position, axis=1))
    at = away & slides & ahead & (contact["force"] >= STEADY * contact["force"].max())
    return np.median(heights[at][at.sum() // 2 :], axis=0) if at.any() else None


def _map(
    axes: Axes, values: np.ndarray, places: np.ndarray, pitch: float, colours: str, low: float, high: float
) -> Any:
    (left, down), (right, up) = places[0, 0] - pitch / 2, places[-1, -1] + pitch / 2
    axes.grid(visible=False)
    return axes.imshow(
        values, origin="lower", extent=(left, right, down, up), cmap=colours, vmin=low, vmax=high, aspect="equal"
    )


def _circle(
    axes: Axes, radius: float, position: np.ndarray, foot: np.ndarray, normal: np.ndarray, places: Any, pitch: float
) -> None:
    x, y = tangent_frame(tuple(normal))[:2] @ (position - foot) * 1e3
    angle = np.linspace(0, 2 * np.pi, 80)
    line, edge = radius * 1e3, np.abs(places).max() + pitch / 2
    axes.plot(x + line * np.cos(angle), y + line * np.sin(angle), color="black", linewidth=1.2, linestyle="--")
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge))


def _over_time(
    panel: Any, touch: TouchStreams, pins: Columns, contact: Columns, heights: np.ndarray,
    nodule: tuple[float, np.ndarray] | None, stroke: float,
) -> None:  # fmt: skip
    time, touching = pins["time"], contact["force"] > 0.0
    upper, lower = panel.subplots(2, 1, sharex=True)
    for axes, labelled in ((upper, True), (lower, False)):
        outside = ~pins["valid"] & touching
        if outside.any():
            axes.fill_between(time, 0, 1, where=outside, transform=axes.get_xaxis_transform(), color=FAINT, alpha=0.45,
                              linewidth=0, label="outside the contact model" if labelled else None)  # fmt: skip
        if nodule is not None:
            over = touching & (np.linalg.norm(contact["foot"] - nodule[1], axis=1) < nodule[0])
            axes.fill_between(time, 0, 1, where=over, transform=axes.get_xaxis_transform(), color=REGION_B,
                              linewidth=0, label="finger over the nodule" if labelled else None)  # fmt: skip
    whole = touch.contact if touch.contact is not None else contact
    upper.plot(whole["time"], whole["force"], color=NORMAL, label="normal force")
    upper.set(ylabel="normal force [N]", ylim=(0.0, 1.3 * float(whole["force"].max())))
    upper.legend(loc="upper left", ncols=3)
    highest = heights.max(axis=(1, 2))
    lower.plot(time, highest, color=TISSUE, label="highest pin")
    lower.plot(time, heights.mean(axis=(1, 2)), color=FINGER, label="mean of the pins")
    lower.plot(time, pins["actuator"] * 1e3, color=NORMAL, linestyle=(0, (4, 2)), label="actuator")
    if (stopped := highest >= STOPPED * stroke).any():
        lower.axhline(stroke, color=TISSUE, linewidth=0.9, linestyle=":", label=f"stop of the pins, {stroke:g} mm")
        lower.fill_between(time, 0, 1, where=stopped, transform=lower.get_xaxis_transform(), color=TISSUE, alpha=0.12,
                           linewidth=0, label="a pin at its stop: it shows less than the surface")  # fmt: skip
    touch.over_time(lower, time)
    most = max(float(pins["actuator"].max()) * 1e3, float(heights.max()), 1e-3)
    lower.set(ylabel="height, travel [mm]", ylim=(0.0, (1.6 if stopped.any() else 1.3) * most))
    lower.legend(loc="upper left", ncols=3, fontsize=9)
