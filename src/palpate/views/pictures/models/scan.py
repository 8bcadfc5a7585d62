"""Picture of a scanned fingertip: the images with their outlines, and the beams that fill it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.physics.fingertip.surfaces import FingertipSurfaces, cast, fill, lowest
from palpate.views.pictures.style import figure, look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from palpate.models.scan import Outlines, Stack

DEPTH, PITCH = 2e-3, 1.2e-3  # [m] indentation at which the beams are shown; distance between beams
COLOURS = {"skin": "#e07a1f", "tissue": "#f2c14e", "bone": "#4aa3df"}


@look()
def draw_scan(tip: FingertipSurfaces, path: Path, stack: Stack, outlines: Outlines) -> None:
    """Draw three images with their outlines, the section along the finger, and the beams in contact."""
    x, y, z = (tip.origin[k] + tip.spacing[k] * np.arange(tip.skin.shape[k]) for k in range(3))
    out = figure(13.0, 7.4, "The fingertip in the images, and the beams that fill it")
    grid = out.add_gridspec(2, 3)
    seen = [k for k, curve in enumerate(outlines.skin) if curve is not None]
    for column, place in enumerate((0.25, 0.5, 0.8)):
        slice_ = seen[int(place * (len(seen) - 1))]
        _image(out.add_subplot(grid[0, column]), stack, outlines, slice_)
    axes = out.add_subplot(grid[1, :2])
    middle = int(np.argmin(np.abs(x - x[np.argmin(tip.bone.min(axis=(1, 2)))])))
    for name, colour in COLOURS.items():
        axes.contour(y * 1e3, z * 1e3, getattr(tip, name)[middle].T, levels=[0], colors=colour)
        axes.plot([], [], color=colour, label={"tissue": "inner border of the skin"}.get(name, name))
    columns = np.arange(y[0], y[-1], PITCH)
    rays = cast(tip, np.full(len(columns), x[middle]), columns)
    for k, at in enumerate(columns * 1e3):
        if not np.isfinite(rays.bottom[k]):
            continue
        parts = [rays.bottom[k], rays.inner[k], rays.low[k], rays.high[k], rays.top[k]]
        edges = [p * 1e3 for p in parts if np.isfinite(p)]
        axes.vlines(at, edges[0], edges[-1], colors="0.75", linewidths=0.8, zorder=0)
        axes.plot([at] * len(edges), edges, ".", color="0.4", markersize=3, zorder=0)
    axes.set(title="along the finger, with beams", xlabel="tip  ←  y [mm]  →  hand", ylabel="pulp  ←  z [mm]  →  nail",
             aspect="equal")  # fmt: skip
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    _beams(out.add_subplot(grid[1, 2]), tip, DEPTH, PITCH)
    save(out, path, dpi=110)


def _image(axes: Axes, stack: Stack, outlines: Outlines, number: int) -> None:
    """Draw one slice of the scan with its outlines."""
    rows, columns = (0.5 * n * step * 1e3 for n, step in zip(stack.volume.shape[1:], stack.spacing[1:], strict=True))
    axes.imshow(stack.volume[number], cmap="gray", extent=(-columns, columns, rows, -rows), interpolation="nearest")
    for name, colour in COLOURS.items():
        curve = getattr(outlines, name)[number]
        if curve is not None:
            closed = np.concatenate([curve, curve[:1]]) * 1e3
            axes.plot(closed[:, 1], closed[:, 0], color=colour, linewidth=1.5)
    axes.grid(visible=False)
    axes.set(title=f"slice {number + 1} of {len(stack.volume)}", xlabel="columns [mm]", ylabel="rows [mm]")


def _beams(axes: Axes, tip: FingertipSurfaces, depth: float, pitch: float) -> None:
    """Draw the beams in contact at a depth [m], seen from below, at their positions in the finger."""
    body = fill(tip, depth, pitch)
    at = 1e3 * (body.points[:, :2] + lowest(tip, 0.0, depth)[0][:2])  # a bundle's origin is the lowest point
    soft = body.lengths[:, [0, 1, 3]].sum(axis=1) * 1e3
    dots = axes.scatter(at[:, 0], at[:, 1], c=soft, s=14, cmap="viridis")
    axes.figure.colorbar(dots, ax=axes, label="soft length of the beam [mm]")
    axes.set(title=f"{len(body.heights)} beams touch at {depth * 1e3:g} mm", xlabel="across x [mm]",
             ylabel="tip  ←  y [mm]  →  hand", aspect="equal")  # fmt: skip
