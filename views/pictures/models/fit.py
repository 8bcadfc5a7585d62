"""Pictures of `palpate fit force`: data with the fitted curve and its band, and regressions."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate.models.fit.curve_fit import fit_curve
from palpate.models.fit.report import Chosen
from palpate.physics.contact.force_band import truncated_quantile
from palpate.physics.contact.force_models import MODELS

STYLES = dict(zip(MODELS, ("k:", "g-", "b--", "m-.", "r-"), strict=True))
"""Colour and dashes of each model; some regressions hardly differ."""


def draw_choice(result: Chosen, stem: Path) -> list[Path]:
    """Draw force and deviation with their fits and with those of all models; the files written."""
    name = _plain(result.subject.name)
    return [
        _fit(result, name, stem.with_name(stem.name + "-fit.png")),
        _models(result, name, stem.with_name(stem.name + "-models.png")),
    ]


def _fit(result: Chosen, name: str, path: Path) -> Path:
    depths, choice = result.depths, result.choice
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    fine = np.linspace(depths[0], depths[-1], 200)
    mean = choice.mean(fine)
    kept = _samples(left, result)
    if choice.dropped:
        left.plot([], [], "x", color="tab:red", label=f"{len(choice.dropped)} dropped")
    if choice.deviation is not None:
        spread = np.maximum(choice.deviation(fine), 0.0)
        scale, freedom = choice.band.widening * spread, choice.band.freedom
        low, high = (truncated_quantile(p, mean, scale, freedom) for p in (0.025, 0.975))
        text = "95 % of a new session's forces" if freedom else "mean ± 1.96 standard deviations"
        left.fill_between(fine * 1e3, low, high, color="tab:blue", alpha=0.2, lw=0, label=text)
        right.plot(fine * 1e3, spread, color="tab:blue", label=choice.deviation.model.name)
    left.plot(fine * 1e3, mean, color="tab:blue", label=f"mean, {choice.mean.model.name}")
    pressed = depths > 0
    right.plot(depths[pressed] * 1e3, choice.deviations[pressed], "o", color="0.25", ms=4, label=f"{kept} sessions")
    left.set(xlabel="depth [mm]", ylabel="force [N]", title=f"Subject {name}: force")
    right.set(xlabel="depth [mm]", ylabel="standard deviation [N]", title=f"Subject {name}: scatter", ylim=(0, None))
    for axes in (left, right):
        axes.legend(frameon=False)
    return _save(figure, path)


def _samples(axes: Axes, result: Chosen) -> int:
    """The forces of the kept sessions as dots, those of dropped ones as crosses; how many are kept."""
    kept = [s for s in range(len(result.forces)) if s not in result.choice.dropped]
    for s, row in enumerate(result.forces):
        used = s in kept
        axes.plot(result.depths * 1e3, row, "." if used else "x", color="0.45" if used else "tab:red", ms=4, zorder=1)
    axes.plot([], [], ".", color="0.45", label=f"{len(kept)} sessions")
    return len(kept)


def _models(result: Chosen, name: str, path: Path) -> Path:
    """All regressions of the force and of its scatter, fitted to all kept sessions, with their errors."""
    depths, choice = result.depths, result.choice
    figure = Figure(figsize=(12, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    fine, pressed = np.linspace(depths[0], depths[-1], 200), depths > 0
    kept = [s for s in range(len(result.forces)) if s not in choice.dropped]
    _samples(left, result)
    right.plot(depths[pressed] * 1e3, choice.deviations[pressed], "o", color="0.25", ms=4, label="over the sessions")
    rows = np.tile(depths, len(kept)), result.forces[kept].ravel()
    scatter = (depths[pressed], choice.deviations[pressed])
    for axes, data, best in ((left, rows, choice.mean), (right, scatter, choice.deviation)):
        if best is None:
            continue
        for model in MODELS.values():
            fit = fit_curve(model, *data, constant=True)
            chosen = model.name == best.model.name
            text = f"{model.name}: {fit.rmse * 1e3:.1f} mN" + (" (chosen)" if chosen else "")
            look = {"lw": 5.0, "alpha": 0.4} if chosen else {"lw": 1.2}
            axes.plot(fine * 1e3, fit(fine), STYLES[model.name], label=text, **look)
    left.set(xlabel="depth [mm]", ylabel="force [N]", title=f"Subject {name}: five regressions of the force, RMSE")
    right.set(xlabel="depth [mm]", ylabel="standard deviation [N]", ylim=(0, None),
              title=f"Subject {name}: five regressions of the scatter, RMSE")  # fmt: skip
    for axes in (left, right):
        axes.legend(frameon=False)
    return _save(figure, path)


def _plain(text: str) -> str:
    """A label that matplotlib does not read as a formula."""
    return text.replace("$", r"\$")


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=130)
    return path
