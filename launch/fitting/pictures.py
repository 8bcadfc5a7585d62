"""Pictures of `palpate fit`: data with the fitted curve and its band, and the probability density."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from palpate.launch.fitting.report import Chosen, Fitted
from palpate.nodes.calibration import Fit, truncated_density, truncated_quantile


def draw_choice(result: Chosen, stem: Path) -> list[Path]:
    """Draw force and deviation with their fits, and the density over depth and force; the files written."""
    name, depths, forces, choice = _plain(result.subject.name), result.depths, result.forces, result.choice
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    fine = np.linspace(depths[0], depths[-1], 200)
    mean = choice.mean(fine)
    kept = [s for s in range(len(forces)) if s not in choice.dropped]
    for s in range(len(forces)):
        used = s in kept
        left.plot(depths * 1e3, forces[s], "." if used else "x", color="0.45" if used else "tab:red", ms=4, zorder=1)
    left.plot([], [], ".", color="0.45", label=f"{len(kept)} sessions")
    left.plot([], [], "x", color="tab:red", label="2 dropped")
    if choice.deviation is not None:
        spread = np.maximum(choice.deviation(fine), 0.0)
        low, high = (truncated_quantile(p, mean, spread) for p in (0.025, 0.975))
        left.fill_between(fine * 1e3, low, high, color="tab:blue", alpha=0.2, lw=0, label="95 % of forces")
        right.plot(fine * 1e3, spread, color="tab:blue", label=choice.deviation.model.name)
    left.plot(fine * 1e3, mean, color="tab:blue", label=f"mean, {choice.mean.model.name}")
    pressed = depths > 0
    right.plot(depths[pressed] * 1e3, choice.deviations[pressed], "o", color="0.25", ms=4, label="over the sessions")
    left.set(xlabel="depth [mm]", ylabel="force [N]", title=f"Subject {name}: force")
    right.set(xlabel="depth [mm]", ylabel="standard deviation [N]", title=f"Subject {name}: scatter", ylim=(0, None))
    for axes in (left, right):
        axes.legend(frameon=False)
    paths = [_save(figure, stem.with_name(stem.name + "-fit.png"))]
    if choice.deviation is not None:
        paths.append(_density(name, depths, choice.mean, choice.deviation, stem.with_name(stem.name + "-density.png")))
    return paths


def _density(name: str, depths: np.ndarray, mean: Fit, deviation: Fit, path: Path) -> Path:
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    shown = depths[depths > 0]
    shown = shown if len(shown) <= 12 else np.linspace(shown[0], shown[-1], 11)
    top = 0.0
    for d in shown:
        centre, sigma = float(mean(d)), float(deviation(d))
        if sigma <= 0:
            continue
        force = np.linspace(max(centre - 4 * sigma, 0.0), max(centre, 0.0) + 4 * sigma, 300)
        density = truncated_density(force, centre, sigma)
        colour = ((d - shown[0]) / (shown[-1] - shown[0])) * 0.85
        axes.plot(force, density, color=colormaps["viridis"](colour), label=f"{d * 1e3:.2g} mm")
        axes.fill_between(force, density, color=colormaps["viridis"](colour), alpha=0.15, lw=0)
        top = max(top, float(density.max()))
    axes.set(
        xlabel="force [N]", ylabel="probability density [1/N]", title=f"Subject {name}: force at each depth",
        xlim=(0, None), ylim=(0, 1.05 * top),
    )  # fmt: skip
    axes.legend(frameon=False, title="depth")
    return _save(figure, path)


def draw_law(result: Fitted, stem: Path) -> list[Path]:
    """Draw the data with a contact law at rest; the files written."""
    subject, fit, _ = result
    at_rest = " at rest" if fit.model.columns == 2 else ""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    fine = np.linspace(0.0, float(subject.depth.max()), 200)
    axes.plot(subject.depth * 1e3, subject.force, ".", color="0.45", ms=4, label="data")
    axes.plot(fine * 1e3, fit(fine, 0.0 if at_rest else None), color="tab:blue", label=fit.model.name + at_rest)
    axes.set(xlabel="depth [mm]", ylabel="force [N]", title=f"Subject {_plain(subject.name)}: {fit.model.formula}")
    axes.legend(frameon=False)
    return [_save(figure, stem.with_name(stem.name + "-law.png"))]


def _plain(text: str) -> str:
    """A label that matplotlib does not read as a formula."""
    return text.replace("$", r"\$")


def _save(figure: Figure, path: Path) -> Path:
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=130)
    return path
