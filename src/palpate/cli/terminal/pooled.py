"""Runs the pooled fit of many sparse probes, and prints its result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, print_json, say, table
from palpate.physics.archive import replace_text

if TYPE_CHECKING:
    from palpate.models.fit.probes.read import Probes
    from palpate.models.fit.tissue.rigs import Rig


def show_pooled(data: dict[str, Any], texts: Sequence[str]) -> None:
    """Print parameters with intervals, then the texts of a report."""
    ends = "withheld" if data["withheld"] else "{low:.4g} to {high:.4g}"
    rows = [(name, f"{p['value']:.5g}", ends.format(**p), str(p["unit"])) for name, p in data["parameters"].items()]
    console().print(table(("parameter", ">median of the places", ">95 % interval", "unit"), rows))
    for text in texts:
        say(text, wrap=True)


def fit_sparse(probes: Probes, rig: Rig, law: str, deepest: float, out: Path, as_json: bool) -> None:
    """Fit one law to all probes of a file, and write scene.yaml, report.md and report.json to a folder."""
    from palpate.launch.run.progress import steps
    from palpate.models.fit.probes import report
    from palpate.models.fit.probes.fit import best_law

    with steps(f"fit tissue: {law}, {len(probes.names)} probes", 1, silent=as_json, timed=False) as done:
        done("one law, a touch point and a stiffness per probe", 0.0)
        fit = best_law(probes, rig, law, deepest)
    data, texts = report.pooled_data(probes, fit), report.lines(probes, fit)
    out.mkdir(parents=True, exist_ok=True)
    replace_text(out / "scene.yaml", report.pooled_scene(rig, fit))
    replace_text(out / "report.json", json.dumps(data, indent=1) + "\n")
    replace_text(out / "report.md", report.markdown(f"{law}, {rig.kind}", data, texts, []))
    if as_json:
        print_json({"ok": True, "out": str(out)} | data)
        return
    show_pooled(data, texts)
    say(f"written {out}/report.md, report.json, scene.yaml; next: palpate run kidney --scene {out}/scene.yaml")
