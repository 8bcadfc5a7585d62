"""Files and tables of `palpate fit run`."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, draw_if_possible, say, table
from palpate.physics.archive import replace_text

if TYPE_CHECKING:
    from palpate.studies.inverse.fit import RunFit
    from palpate.studies.inverse.motions import Planned


def write_run_fit(fit: RunFit, planned: Sequence[Planned], out: Path) -> dict[str, Any]:
    """Write launch file, report and picture; returns the content of report.json."""
    from palpate.studies.inverse import report
    from palpate.views.pictures.models.fit_run import draw_fit_run

    out.mkdir(parents=True, exist_ok=True)
    draw_if_possible(draw_fit_run, report.pictured(fit), report.title(fit), out)
    result = report.data(fit, planned)
    replace_text(out / "report.json", json.dumps(result, indent=1) + "\n")
    for file, text in report.launches(fit, out).items():
        replace_text(file, text)
    return result


def print_run_fit(fit: RunFit, planned: Sequence[Planned], cured: Mapping[str, str], out: Path) -> None:
    """Print parameters with intervals, what is not determined with its remedy, residuals, and planned motions."""
    from palpate.studies.inverse.report import launches

    rows = []
    for p in fit.estimate.parameters:
        at, known = fit.estimate.intervals[p.name], p.name not in fit.open_
        ends = f"{at.low:.4g} to {at.high:.4g}" if known else ""
        rows.append((p.name, f"{at.value:.5g}" if known else "not determined", ends, p.unit))
    console().print(table(("parameter", ">value", ">95 % interval", "unit"), rows))
    for name, why in fit.open_.items():
        say(f"not determined: {name}: {'; '.join(filter(None, (why, cured.get(name))))}", "yellow", wrap=True)
    for one, other, size in fit.couples:
        say(f"{one} and {other} cannot be distinguished: correlation {size:.3f}", "yellow", wrap=True)
    for name, rms in fit.rms.items():
        say(f"residual of {name}: {rms:.3g} RMS", wrap=True)
    for name, share in fit.held_out.items():
        say(f"held out, {name}: RMS {100 * share:.2g} % of the peak", wrap=True)
    for text in fit.notes:
        say(text, wrap=True)
    if planned:
        heads = ("motion", ">duration", *(f">{p.path}" for p in fit.parameters), ">D")
        shown = [
            (each.name, f"{each.duration:.3g} s", *(f"± {100 * r:.2g} %" for r in each.relative), f"{each.d:.1f}")
            for each in planned
        ]
        console().print(table(heads, shown))
    launch = list(launches(fit, out))[-1]
    say(f"{fit.runs} runs; written {out}/report.json, {launch.name}; next: palpate run {shlex.quote(str(launch))}")
