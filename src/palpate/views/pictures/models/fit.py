"""Pictures of `palpate fit force`: data with the fitted curve and its band, and regressions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.models.fit.curve_fit import fit_curve
from palpate.models.fit.report import Chosen
from palpate.physics.contact.force_band import truncated_quantile
from palpate.physics.contact.force_models import MODELS
from palpate.views.pictures.style import INK, NORMAL, REGION_A, TISSUE, figure, look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLES = dict(zip(MODELS, ("k:", "g-", "b--", "m-.", "r-"), strict=True))
"""Colour and dashes of each model; some regressions hardly differ."""


def draw_fit(chosen: Sequence[Chosen], model: Path) -> list[Path]:
    """Draw the pictures of each subject into a folder next to the model file."""
    folder = model.with_name(f"{model.name.removesuffix('.yaml')}-pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return [path for k, one in enumerate(chosen, 1) for path in draw_choice(one, folder / f"subject-{k}")]


@look()
def draw_choice(result: Chosen, stem: Path) -> list[Path]:
    """Draw force and deviation with the chosen fits, and with the fits of all models; returns the files."""
    name = result.subject.name.replace("$", r"\$")  # otherwise matplotlib reads a formula
    drawn = {"fit": _fit(result, name), "models": _models(result, name)}
    files = {stem.with_name(f"{stem.name}-{what}.png"): picture for what, picture in drawn.items()}
    for path, picture in files.items():
        save(picture, path)
    return list(files)


def _fit(result: Chosen, name: str) -> Figure:
    depths, choice = result.depths, result.choice
    out = figure(11.0, 4.6, f"Subject {name}: force over depth, and its scatter over the sessions")
    left, right = out.subplots(1, 2)
    fine = np.linspace(depths[0], depths[-1], 200)
    mean = choice.mean(fine)
    _samples(left, right, result)
    if choice.dropped:
        left.plot([], [], "x", color=TISSUE, label=f"{len(choice.dropped)} dropped")
    if choice.deviation is not None:
        spread = np.maximum(choice.deviation(fine), 0.0)
        scale, freedom = choice.band.widening * spread, choice.band.freedom
        low, high = (truncated_quantile(p, mean, scale, freedom) for p in (0.025, 0.975))
        text = "95 % of a new session's forces" if freedom else "mean ± 1.96 standard deviations"
        left.fill_between(fine * 1e3, low, high, color=REGION_A, lw=0, zorder=0, label=text)
        right.plot(fine * 1e3, spread, color=NORMAL, label=choice.deviation.model.name)
    left.plot(fine * 1e3, mean, color=NORMAL, label=f"mean, {choice.mean.model.name}")
    return _label_axes(out, left, right)


def _samples(left: Axes, right: Axes, result: Chosen) -> list[int]:
    """Draw the forces of the kept sessions as dots and those of dropped ones as crosses, and the deviation of the kept
    ones; returns the kept sessions."""
    depths, choice = result.depths, result.choice
    kept = [s for s in range(len(result.forces)) if s not in choice.dropped]
    for s, row in enumerate(result.forces):
        used = s in kept
        left.plot(depths * 1e3, row, "." if used else "x", color=INK if used else TISSUE, ms=4, alpha=0.6, zorder=1)
    left.plot([], [], ".", color=INK, label=f"{len(kept)} sessions")
    pressed = depths > 0
    right.plot(depths[pressed] * 1e3, choice.deviations[pressed], "o", color=INK, ms=4, label=f"{len(kept)} sessions")
    return kept


def _models(result: Chosen, name: str) -> Figure:
    """All regressions of the force and of its scatter, fitted to all kept sessions, with their errors."""
    depths, choice = result.depths, result.choice
    out = figure(12.0, 5.2, f"Subject {name}: five regressions of the force and of its scatter, with their RMSE")
    left, right = out.subplots(1, 2)
    fine, pressed = np.linspace(depths[0], depths[-1], 200), depths > 0
    kept = _samples(left, right, result)
    rows = np.tile(depths, len(kept)), result.forces[kept].ravel()
    scatter = (depths[pressed], choice.deviations[pressed])
    for axes, data, best in ((left, rows, choice.mean), (right, scatter, choice.deviation)):
        if best is None:
            continue
        for model in MODELS.values():
            fit = fit_curve(model, *data, constant=True)
            chosen = model.name == best.model.name
            text = f"{model.name}: {fit.rmse * 1e3:.1f} mN" + (" (chosen)" if chosen else "")
            line = {"lw": 5.0, "alpha": 0.4} if chosen else {"lw": 1.2}
            axes.plot(fine * 1e3, fit(fine), STYLES[model.name], label=text, **line)
    return _label_axes(out, left, right)


def _label_axes(out: Figure, left: Axes, right: Axes) -> Figure:
    left.set(xlabel="depth [mm]", ylabel="force [N]")
    right.set(xlabel="depth [mm]", ylabel="standard deviation [N]", ylim=(0, None))
    for axes in (left, right):
        axes.legend()
    return out
