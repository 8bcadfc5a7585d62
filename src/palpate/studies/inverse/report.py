"""What a fit to recordings writes: data for programs, a launch file that runs, and the lines for a person."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from palpate.gradients.parameters import put_all
from palpate.launch.load.files import GRAPHS
from palpate.messages import fields
from palpate.studies.inverse.fit import RunFit
from palpate.studies.inverse.measured import Measured
from palpate.studies.inverse.motions import RECORDED, Planned
from palpate.views.pictures.models.fit_run import FittedField

WRITTEN = ("report.json", "fit.png")


def data(fit: RunFit, planned: Sequence[Planned] = ()) -> dict[str, Any]:
    """The result as plain data."""
    estimate = fit.estimate
    return {
        "parameters": {
            p.name: {
                "value": estimate.intervals[p.name].value, "unit": p.unit, "low": estimate.intervals[p.name].low,
                "high": estimate.intervals[p.name].high, "determined": p.name not in fit.open_,
                "standard_error": float(estimate.errors[k]) * (estimate.intervals[p.name].value if p.log else 1.0),
            }
            for k, p in enumerate(estimate.parameters)
        },
        "not_determined": fit.open_,
        "correlation": {"names": estimate.names, "values": np.round(estimate.correlation, 4).tolist()},
        "indistinguishable": [list(each) for each in fit.couples],
        "rms": fit.rms, "held_out": fit.held_out, "independent_rows": estimate.effective[0],
        "rows": estimate.effective[1], "starts": estimate.starts, "runs": fit.runs, "notes": fit.notes,
        "motions": [
            {"name": each.name, "duration": each.duration, "log_determinant": each.d, "rms": each.a,
             "relative": dict(zip([p.path for p in fit.parameters], each.relative.tolist(), strict=True))}
            for each in planned
        ],
    }  # fmt: skip


def launches(fit: RunFit, out: Path) -> dict[Path, str]:
    """Launch files of the fitted graph by path, one for each recording that has parameters for itself, with the graph
    that they name."""
    separate = any(name not in [p.path for p in fit.parameters] for name in fit.estimate.values)
    found: dict[Path, str] = {}
    for measured in fit.measured if separate else fit.measured[:1]:
        # one that is not determined stays as recorded
        known = {name: value for name, value in fit.estimate.values.items() if name not in fit.open_}
        kept = [
            (p, known.get(p.path, known.get(f"{p.path}, {measured.name}", p.value))) for p in fit.parameters
            if p.path not in measured.loose
        ]  # fmt: skip
        name = f"fit-{Path(measured.name).stem}" if separate else "fit"
        file = measured.base.graph
        keys: dict[str, Any] = {"graph": file.stem if file.parent == GRAPHS else str(file)}
        if measured.graph is not None:
            keys["graph"] = f"{measured.base.graph.stem}.yaml"
            found[out / keys["graph"]] = yaml.safe_dump(measured.graph, sort_keys=False)
        elif measured.base.scene is not None:
            keys["scene"] = str(measured.base.scene)
        keys["duration"] = measured.ticks / measured.rate
        given = {text.partition("=")[0]: yaml.safe_load(text.partition("=")[2])
                 for text in measured.base.overrides if isinstance(text, str)}  # fmt: skip
        keys["set"] = given | put_all([p for p, _ in kept], [v for _, v in kept])
        found[out / f"{name}.yaml"] = yaml.safe_dump(keys, sort_keys=False)
    return found


def pictured(fit: RunFit) -> list[FittedField]:
    """The fields of all recordings with the fit."""
    found, at = [], 0
    for measured in fit.measured:
        graph = measured.launch.load()
        for path, values in zip(measured.fields, measured.values, strict=True):
            stream, _, name = path.rpartition(".")
            unit = {each.name: each.unit for each in fields(graph.streams[stream])}[name]
            made = np.asarray(fit.estimate.fitted[at]).reshape(values.shape[1], -1).T
            found.append(FittedField(f"{path} [{unit}]\n{measured.name}", measured.time, values, made))
            at += 1
    return found


def title(fit: RunFit) -> str:
    """The parameters with their intervals in one line."""
    parts = []
    for p in fit.estimate.parameters:
        at = fit.estimate.intervals[p.name]
        shown = "not determined" if p.name in fit.open_ else f"{at.value:.4g} ({at.low:.4g} to {at.high:.4g}) {p.unit}"
        parts.append(f"{p.name} {shown}")
    return "\n".join(parts)


def cures(fit: RunFit, planned: Sequence[Planned], measured: Measured) -> dict[str, str]:
    """For each parameter that is not determined, the motion that would determine it best, or that none of them does."""
    found = {}
    now = next((each for each in planned if each.name == RECORDED), None)
    for name in fit.open_:
        place = next(k for k, p in enumerate(fit.parameters) if name in (p.path, f"{p.path}, {measured.name}"))
        stream = f"{fit.parameters[place].node}.force"
        if (
            now is not None
            and now.relative[place] > 1.0
            and stream not in measured.fields
            and stream in _forces(measured)
        ):
            found[name] = f"--to {stream} may show it"
            continue
        best = min(planned, key=lambda each: each.relative[place], default=None)
        if best is None or now is None:
            continue
        if best.relative[place] < min(1.0, 0.7 * now.relative[place]):
            found[name] = f"the motion {best.name} would give ± {100 * best.relative[place]:.2g} %"
        else:
            found[name] = "no motion of the family would determine it (--plan lists them); fix it with --set"
    return found


def _forces(measured: Measured) -> set[str]:
    """The forces of the graph, "stream.force"."""
    streams = measured.base.load().streams
    return {f"{stream}.force" for stream, kind in streams.items() if any(each.name == "force" for each in fields(kind))}
