"""`palpate bench stability --body`, `--regions`: bodies in place of the wall, the plane of drag and dry friction."""

from __future__ import annotations

import csv
import math
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.launch.commands.common import console
from palpate.launch.commands.progress import steps
from palpate.launch.loading.classes import ClassError, find_class

if TYPE_CHECKING:
    from palpate.nodes.base import Node
    from palpate.physics.device.wall_loop import Device

COLUMNS = {
    "body": "", "rate": "Hz", "delay": "1", "stable": "N/m", "bare": "N/m", "controlled": "N/m", "given_out": "J",
}  # fmt: skip
POINTS = 13
"""Of the plane of regions, each way."""


def _body(name: str) -> type[Node]:
    try:
        return find_class(name)
    except ClassError as error:
        raise ClassError(str(error).replace("use:", "--body:", 1), error.cure) from None


def bodies(
    device: Device, names: list[str], rates: list[float], delays: list[int], silent: bool
) -> list[dict[str, Any]]:
    """A row for each body, rate and delay."""
    from palpate.studies.stability.body_wall import row, stiffened

    classes = {name: _body(name) for name in names}
    for cls in classes.values():
        stiffened(cls, 1.0)  # tells what is no body before anything is computed
    todo = list(product(classes.items(), sorted(rates), sorted(delays)))
    told = []
    with steps(f"bench stability: {len(todo)} loops with a body", len(todo), silent=silent) as done:
        for (name, cls), rate, delay in todo:
            told.append({"body": name, **row(device, cls, rate, delay)})
            done(f"{name}, {rate:g} Hz, {delay} samples late")
    return told


def regions(device: Device, stiffness: float, period: float) -> dict[str, Any]:
    """The plane of the device's mass and encoder at a stiffness [N/m]: the kind at each sigma and beta."""
    import numpy as np

    from palpate.physics.device.regions import plane

    at = np.geomspace(0.02, 4.0, POINTS)
    return {
        "stiffness": stiffness, "beta": at.tolist(), "sigma": at.tolist(),
        "kinds": plane(device, stiffness, period, at, at),
    }  # fmt: skip


def write_bodies(rows: list[dict[str, Any]], path: Path) -> None:
    """The rows as a table."""
    with path.open("w", newline="", encoding="utf-8") as file:
        write = csv.writer(file)
        write.writerow([f"{name} [{unit}]" if unit else name for name, unit in COLUMNS.items()])
        write.writerows([[row[n] if n == "body" else f"{row[n]:.6g}" for n in COLUMNS] for row in rows])


def print_bodies(rows: list[dict[str, Any]]) -> None:
    """The rows on the screen."""
    from rich.table import Table

    shown = Table(box=None, pad_edge=False, header_style="bold", title_justify="left",
                  title="stiffest body, N/m at a push of 0.1 N")  # fmt: skip
    for name, unit in COLUMNS.items():
        title = "given out\n\\[mJ]" if name == "given_out" else f"{name}\n\\[{unit}]" if name == "rate" else f"\n{name}"
        shown.add_column(title, justify="left" if name == "body" else "right", no_wrap=True)
    for row in rows:
        shown.add_row(*(row[n] if n == "body" else _figure(n, row[n]) for n in COLUMNS))
    console().print(shown)


def _figure(name: str, value: float) -> str:
    if name in ("rate", "delay", "given_out"):
        return f"{1e3 * value:.2g}" if name == "given_out" else f"{value:g}"
    return "all rest" if math.isinf(value) else "none rests" if value == 0.0 else f"{value:.4g}"


def draw_bodies(rows: list[dict[str, Any]], path: Path) -> str:
    """Stiffness over delay, a column for each body at the least rate; "" where matplotlib is missing."""
    try:
        from palpate.launch.pictures.style import ENERGY, FINGER, SPEED, figure
    except ModuleNotFoundError:
        return ""
    names, rate = list(dict.fromkeys(row["body"] for row in rows)), min(row["rate"] for row in rows)
    drawn = figure(3.6 * len(names) + 1.5, 4.6, f"How stiff a body the device can hold, {rate:g} Hz")
    axes = drawn.subplots(1, len(names), sharey=True, squeeze=False)[0]
    known = [r[key] for r in rows for key in ("stable", "bare", "controlled") if 0.0 < r[key] < math.inf] or [1e3]
    top, low = 3.0 * max(known), 0.5 * min(known)
    for ax, name in zip(axes, names, strict=True):
        own = [row for row in rows if row["body"] == name and row["rate"] == rate]
        for key, colour, mark, label in (
            ("stable", SPEED, "-", "stable, poles"),
            ("bare", FINGER, "o", "simulated, bare"),
            ("controlled", ENERGY, "^", "controller on"),
        ):
            points = [(row["delay"], min(row[key], top)) for row in own if row[key] > 0.0]
            ax.plot(*zip(*points, strict=True) if points else ([], []), mark, color=colour, label=label)
        ax.set(xlabel="delay [samples]", yscale="log", title=name.rpartition(".")[2], ylim=(low, 1.5 * top))
    axes[0].set_ylabel("stiffness  [N/m]")
    axes[-1].legend(loc="best", title=f"marks at {top:.2g}: all rest", fontsize=8, title_fontsize=8)
    drawn.savefig(path)
    return str(path)


def draw_regions(told: dict[str, Any], device: Device, period: float, path: Path) -> str:
    """The plane, the lines at 1/2, and where the user's own device lies at some stiffnesses; "" without matplotlib."""
    try:
        from matplotlib.colors import ListedColormap

        from palpate.launch.pictures.style import INK, figure
    except ModuleNotFoundError:
        return ""
    from palpate.physics.device.regions import KINDS

    drawn = figure(7.4, 6.0, "What drag, dry friction and an encoder make of a sampled spring")
    ax = drawn.subplots()
    number = [[KINDS.index(kind) for kind in row] for row in told["kinds"]]
    colours = ["#d9ead9", "#dbe6f4", "#f6e3bd", "#eec4bf"]
    ax.pcolormesh(
        told["beta"], told["sigma"], number, cmap=ListedColormap(colours), vmin=-0.5, vmax=3.5, shading="nearest"
    )
    for kind, colour in zip(KINDS, colours, strict=True):
        ax.plot([], [], "s", color=colour, markersize=10, label=kind)
    ax.axvline(0.5, color=INK, linewidth=0.9)
    ax.axhline(0.5, color=INK, linewidth=0.9)
    for k in (100.0, 300.0, 1000.0, 3000.0):
        beta, sigma = device.drag / (k * period), device.coulomb / (k * device.resolution)
        if sigma > 0.0:
            ax.plot(beta, sigma, "x", color=INK)
            ax.annotate(f"{k:g} N/m", (beta, sigma), textcoords="offset points", xytext=(5, 5), fontsize=8)
    ax.set(xscale="log", yscale="log", xlabel="b / (K T)", ylabel="f_c / (K step)",
           title=f"mass {device.mass:g} kg, K = {told['stiffness']:.0f} N/m; above and right of 1/2: passive",
           xlim=(told["beta"][0], told["beta"][-1]), ylim=(told["sigma"][0], told["sigma"][-1]))  # fmt: skip
    ax.legend(loc="lower left")
    drawn.savefig(path)
    return str(path)
