"""Output of `palpate fit force`: tables, plain data for `--json`, YAML for the node."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from rich.markup import escape
from rich.table import Table

from palpate.models.fit.crossvalidation import ModelChoice
from palpate.models.fit.curve_fit import CurveFit
from palpate.models.fit.sessions import Subject
from palpate.physics.contact.force_models import MODELS


class Chosen(NamedTuple):
    """A subject's forces [N] (S,D) at its depths [m] (D), and the models chosen."""

    subject: Subject
    depths: np.ndarray
    forces: np.ndarray
    choice: ModelChoice


def model_tables(choices: list[Chosen]) -> Iterator[Table]:
    """Errors of each model for each subject, with the smallest marked, and the parameters of the chosen models."""
    yield _rmse("RMSE of the force on training sessions [mN], mean of the folds", choices, lambda c, m: c.force[m][0])
    yield _rmse("RMSE of the force on validation sessions [mN]", choices, lambda c, m: c.force[m][1])
    yield _rmse("RMSE of the force on test sessions [mN]", choices, lambda c, m: c.force[m][2])
    if all(c.choice.spread for c in choices):
        yield _rmse("RMSE of the standard deviation, training sessions [mN]", choices, lambda c, m: c.spread[m][0])
        yield _rmse("RMSE of the standard deviation, all sessions [mN]", choices, lambda c, m: c.spread[m][1])
    for subject, _, _, choice in choices:
        yield parameters(f"Subject {subject.name}, force, all kept sessions: ", choice.mean)
        if choice.deviation is not None:
            yield parameters(f"Subject {subject.name}, standard deviation: ", choice.deviation)


def _rmse(title: str, choices: list[Chosen], value: Callable[[ModelChoice, str], float]) -> Table:
    table = Table(title=escape(title), title_justify="left")
    table.add_column("subject")
    for model in MODELS:
        table.add_column(model, justify="right")
    rows = [[value(choice, model) * 1e3 for model in MODELS] for _, _, _, choice in choices]
    for name, row in zip(
        [*(f.subject.name for f in choices), "average"], [*rows, np.mean(rows, axis=0).tolist()], strict=True
    ):
        best = min(row)
        table.add_row(escape(name), *(f"[bold]{v:.2f} *[/bold]" if v == best else f"{v:.2f}  " for v in row))
    return table


def parameters(title: str, fit: CurveFit) -> Table:
    """Table of the parameters of one fit."""
    model = f"{fit.model.name}, {fit.model.formula}; RMSE {fit.rmse * 1e3:.3g} mN"
    table = Table(title=escape(title + model), title_justify="left", min_width=78)
    table.add_column("parameter")
    for column in ("value", "std. error", "95 % interval"):
        table.add_column(column, justify="right")
    for name, unit, value, error, (low, high) in _parameter_rows(fit):
        known = math.isfinite(error)
        limit = "  at the end of its range" if name in fit.at_limit else ""
        table.add_row(
            escape(f"{name} [{unit}]"),
            f"{value:.5g}",
            f"{error:.2g}" if known else "-",
            (f"{low:.5g} .. {high:.5g}" if known else "not determined") + limit,
        )
    return table


def _parameter_rows(fit: CurveFit) -> list[tuple[str, str, float, float, tuple[float, float]]]:
    """Name, unit, value, standard error and interval of each parameter."""
    numbers = fit.parameters.tolist(), fit.errors.tolist(), map(tuple, fit.interval().tolist())
    return [(name, unit, *rest) for (name, unit), *rest in zip(fit.model.parameters.items(), *numbers, strict=True)]


def choice_notes(choices: list[Chosen]) -> list[str]:
    """Dropped sessions, test error of the chosen force model, and its band, one note per subject."""
    notes = []
    for subject, _, _, choice in choices:
        test, band = choice.force[choice.mean.model.name][2], choice.band
        text = f"test error {test * 1e3:.1f} mN, {100 * choice.test_share:.1f} % of the mean force"
        if choice.dropped:
            low, high = _dropped_labels(subject, choice).values()
            text = f"dropped session {low} (smallest sum of force) and {high} (largest); {text}"
        if choice.deviation is None:
            notes.append(f"Subject {subject.name}: the sessions do not scatter, so there is no standard deviation.")
        elif band.freedom > 0:
            text += (
                f"; 95 % of a new session's forces within {band.reach():.2f} standard deviations"
                f" ({100 * band.together:.0f} % of the variance is between sessions)"
            )
        notes.append(f"Subject {subject.name}: {text}.")
    return notes


def _dropped_labels(subject: Subject, choice: ModelChoice) -> dict[str, str]:
    """Labels of the dropped sessions, if any."""
    return dict(zip(("smallest", "largest"), (subject.sessions[i] for i in choice.dropped), strict=False))


def choice_data(choices: list[Chosen]) -> dict[str, Any]:
    """All errors and the chosen models of each subject as plain data."""
    return {
        subject.name: {
            "protocol": choice.protocol,
            "dropped_sessions": _dropped_labels(subject, choice),
            "band": choice.band._asdict(),
            "folds": [
                {part: [subject.sessions[i] for i in rows] for part, rows in fold._asdict().items()}
                for fold in choice.folds
            ],
            "force_rmse": {
                m: dict(zip(("training", "validation", "test"), v, strict=True)) for m, v in choice.force.items()
            },
            "deviation_rmse": {m: dict(zip(("training", "all"), v, strict=True)) for m, v in choice.spread.items()},
            "test_share": choice.test_share,
            "mean": plain(choice.mean),
            "deviation": None if choice.deviation is None else plain(choice.deviation),
        }
        for subject, _, _, choice in choices
    }


def plain(fit: CurveFit) -> dict[str, Any]:
    """A fit as plain data."""
    found = {}
    for name, unit, value, error, ends in _parameter_rows(fit):
        known = {"error": error, "interval": list(ends)} if math.isfinite(error) else {"error": None, "interval": None}
        found[name] = {"value": value, "unit": unit, **known}
    about = {"model": fit.model.name, "formula": fit.model.formula, "rmse": fit.rmse}
    return {**about, "parameters": found, "at_limit": list(fit.at_limit)}


def model_yaml(choices: list[Chosen], source: Path) -> str:
    """The file for `model` of `contact.Probabilistic`; each subject contains settings of that node."""
    lines = [
        f"# Fitted by `palpate fit force` to {source.name}. SI units. Each subject contains settings of",
        "# contact.Probabilistic: name this file as its `model`, or copy a subject into a scene.",
        "subjects:",
    ]
    for subject, depths, _, choice in choices:
        label = yaml.safe_dump(subject.name, default_style='"', allow_unicode=True).strip()  # a quoted string
        lines.append(f"  {label}:")
        for role, (name, parameters, errors) in _laws(choice).items():
            model = MODELS[name]
            lines += [f"    {role}: {model.name}  # {model.formula}", f"    {role}_parameters:"]
            for (key, unit), value, error in zip(model.parameters.items(), parameters, errors, strict=True):
                lines.append(f"      - {_number(value)}  # {key} [{unit}], standard error {error:.3g}")
        lines.append(f"    depth_limit: {_number(depths[-1])}  # [m] largest measured depth")
        lines.append(
            f"    freedom: {_number(choice.band.freedom)}  # of Student's t for a new session; 0: normal distribution"
        )
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """A float in YAML 1.1, with a point and a signed exponent, without rounding."""
    return yaml.safe_dump(float(value)).split("\n")[0]


def _laws(choice: ModelChoice) -> dict[str, tuple[str, np.ndarray, np.ndarray]]:
    """Name of the model, parameters and their standard errors, by role.

    The deviation is 0 for sessions without scatter, otherwise widened by the error of the curve.
    """
    mean, spread = choice.mean, choice.deviation
    if spread is None:
        scatter = "linear", np.zeros(2), np.zeros(2)
    else:
        wider = np.ones(len(spread.parameters))
        wider[: len(spread.model.linear)] = choice.band.widening
        scatter = spread.model.name, wider * spread.parameters, wider * spread.errors
    return {"mean": (mean.model.name, mean.parameters, mean.errors), "deviation": scatter}
