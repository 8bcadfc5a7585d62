"""Local sensitivity of a study: derivatives of its kept results by its parameters at the settings of the scene.

One run of 6 lanes for each parameter and 1, instead of hundreds of points. It is exact there, and shows when in the
touch a parameter acts. The indices of `sensitivity` are for the whole ranges of the parameters (docs/studies.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.ensemble import ensemble_of
from palpate.launch.load.checks.ideal import OPTION, describe_jumps
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.keep import NUMBERS, Kept
from palpate.views.pictures.style import figure, look, saved

if TYPE_CHECKING:
    from palpate.studies.sweeps.study import Study

IDEAL = OPTION.removeprefix("--set ")


@dataclass
class Local:
    """Derivatives at the settings of the scene.

    rows    for each number and parameter: of, parameter, value, unit, derivative, error, reason, and as per_cent the
            change by + 1 %
    curves  by quantity: times [s] (n), unit, and for each parameter (n) the change per relative change
    notes   lines for the user
    """

    rows: list[dict[str, Any]]
    curves: dict[str, tuple[np.ndarray, str, dict[str, np.ndarray]]]
    notes: list[str]


def local_sensitivity(study: Study) -> Local:
    """The derivatives of the kept results of a study. ArgumentError: a parameter is no number, or the study keeps
    nothing that has a derivative."""
    keep = {f"{one.stream}.{one.field}": one for one in study.keep}
    if not keep:
        raise ArgumentError("keep: found recordings alone, expected numbers or curves, such as 'peak contact.force'")
    launch, notes = study.launch, []
    graph = launch.load()
    if describe_jumps(graph, [name for name, spec in graph.nodes.items() if spec.off is None]):
        launch, notes = (
            launch.but(overrides=[IDEAL]),
            [f"with an ideal hand ({IDEAL}), because counts have no derivative"],
        )
    touch = ensemble_of(launch, list(keep))
    reduce = {one.text: (f"{one.stream}.{one.field}", _number(one, touch.rate)) for one in study.numbers}
    by, rows = list(study.space.paths), []
    if reduce:
        found = touch.gradient(by, reduce=reduce, quiet=True)
        for one in study.numbers:
            for place, parameter in enumerate(by):
                value, d = float(found["value"][0, place]), float(found[f"{one.text}.derivative"][0, place])
                rows.append({
                    "of": one.text, "parameter": parameter, "value": value, "unit": str(found["unit"].values[place]),
                    "derivative": d, "error": float(found[f"{one.text}.error"][0, place]), "per_cent": 0.01 * value * d,
                    "reason": str(found[f"{one.text}.reason"].values[0, place]),
                })  # fmt: skip
    over = touch.gradient(by, quiet=True)
    curves = {}
    for path, one in keep.items():
        values, slopes = over[path].values[0], over[f"{path}.derivative"].values[0]
        each = {name: float(over["value"][0, k]) * _component(one, values, slopes[k]) for k, name in enumerate(by)}
        curves[one.quantity] = over["time"].values, one.unit, each
    return Local(rows, curves, notes)


def _number(one: Kept, rate: float) -> Callable[[np.ndarray], float]:
    """The number of a kept result as a function of the values (ticks, ...) of its field."""

    def of(values: np.ndarray) -> float:
        flat = (
            values
            if values.ndim == 1
            else values[:, one.index]
            if one.index is not None
            else np.linalg.norm(values, axis=1)
        )
        if one.how == "at":
            return float(flat[min(int(one.time * rate + 1e-6), len(flat) - 1)])
        return float(NUMBERS[one.how](flat))

    return of


def _component(one: Kept, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """The derivative (n) of a number, of a component, or of the length of a vector (n, 3)."""
    if values.ndim == 1:
        return slopes
    if one.index is not None:
        return slopes[:, one.index]
    length = np.linalg.norm(values, axis=1)
    return np.divide(np.sum(values * slopes, axis=1), length, out=np.zeros(len(length)), where=length > 0.0)


@look()
def draw_local(local: Local, folder: Path) -> list[Path]:
    """Each quantity's change per relative change of each parameter, over time."""
    out = figure(9.0, 3.2 * len(local.curves), "")
    axes = out.subplots(len(local.curves), 1, squeeze=False)[:, 0]
    for axis, (name, (time, unit, each)) in zip(axes, local.curves.items(), strict=True):
        for parameter, values in each.items():
            axis.plot(time, values, lw=1.2, label=parameter)
        axis.axhline(0.0, color="k", lw=0.5)
        axis.set(xlabel="time [s]", ylabel=f"x d({name})/dx [{unit}]")
        axis.legend(fontsize=8)
    return saved(folder, local=out)
