"""The picture of a fingertip that was read: its sections, and the beams that fill it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.physics.fingertip import Fingertip, cast, fill

COLOURS = {"skin": "#b5651d", "tissue": "#e9967a", "bone": "#3b5b92"}


def draw(tip: Fingertip, path: str | Path, depth: float = 2e-3, pitch: float = 1.2e-3) -> None:
    """Three cross-sections, the section along the finger, and the beams at a depth [m] with their parts."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    x, y, z = (tip.origin[k] + tip.spacing[k] * np.arange(tip.skin.shape[k]) for k in range(3))
    figure = plt.figure(figsize=(13, 7), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    for column, place in enumerate((0.25, 0.5, 0.8)):
        axes = figure.add_subplot(grid[0, column])
        k = int(place * (len(y) - 1))
        for name, colour in COLOURS.items():
            level = getattr(tip, name)[:, k, :].T
            if level.min() < 0:
                axes.contour(x * 1e3, z * 1e3, level, levels=[0], colors=colour)
        axes.set(title=f"y = {y[k] * 1e3:.1f} mm", xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
    axes = figure.add_subplot(grid[1, :2])
    middle = int(np.argmin(np.abs(x - x[np.argmin(tip.bone.min(axis=(1, 2)))])))
    for name, colour in COLOURS.items():
        axes.contour(y * 1e3, z * 1e3, getattr(tip, name)[middle].T, levels=[0], colors=colour)
        axes.plot([], [], color=colour, label={"tissue": "inner border of the skin"}.get(name, name))
    columns = np.arange(y[0], y[-1], pitch)
    rays = cast(tip, np.full(len(columns), x[middle]), columns)
    for k, at in enumerate(columns * 1e3):
        if not np.isfinite(rays.bottom[k]):
            continue
        parts = [rays.bottom[k], rays.inner[k], rays.low[k], rays.high[k], rays.top[k]]
        edges = [p * 1e3 for p in parts if np.isfinite(p)]
        axes.vlines(at, edges[0], edges[-1], colors="0.75", linewidths=0.8, zorder=0)
        axes.plot([at] * len(edges), edges, ".", color="0.4", markersize=3, zorder=0)
    axes.set(title="along the finger, with beams", xlabel="y [mm]", ylabel="z [mm]", aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)
    axes = figure.add_subplot(grid[1, 2])
    body = fill(tip, depth, pitch)
    soft = body.lengths[:, [0, 1, 3]].sum(axis=1) * 1e3
    dots = axes.scatter(body.points[:, 0] * 1e3, body.points[:, 1] * 1e3, c=soft, s=14, cmap="viridis")
    figure.colorbar(dots, ax=axes, label="soft length of the beam [mm]")
    axes.set(title=f"{len(body.heights)} beams touch at {depth * 1e3:g} mm", xlabel="x [mm]", ylabel="y [mm]",
             aspect="equal")  # fmt: skip
    figure.savefig(path, dpi=110)
    plt.close(figure)
