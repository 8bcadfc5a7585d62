"""What a search found, as a table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.faults.draw import TWO
from palpate.studies.faults.fault import KINDS
from palpate.studies.faults.search import Found, Results

ABOUT = {
    "contact": "the contact force is at most 1.2 times that without faults, or of the same motion",
    "change": "the force on the hand changes by at most the slew rate of the controller",
    "energy": "from an outage until its force is back the display gives out at most 1 mJ, and 10 mW after 0.5 s",
    "silence": "no torque 20 ms after a node that it needs has stopped",
    "return": "0.35 s after the last fault the contact has at least 0.8 of its force",
    "finite": "all forces are numbers",
}
UNITS = {"contact": "N", "change": "N", "energy": "J", "silence": "N m", "return": "N", "finite": "N"}


def worst(results: Results, count: int) -> list[Found]:
    """The worst touches of all invariants, those that are broken or nearest to it first."""
    return sorted((f for listed in results.worst.values() for f in listed), key=lambda f: -f.score.score)[:count]


def text(results: Results, count: int) -> str:
    """The report: a table, then the worst touches with their faults and the commands that repeat them."""
    faults = ", ".join(f"{results.kinds[kind]} {kind}" for kind in KINDS)
    lines = [
        f"{results.seeds} touches with {results.kinds.total()} faults: {faults}.",
        "Worst: the largest value over its bound; above 1 it is broken.",
        "",
        f"{'invariant':10}{'broken':>8}{'worst':>8}  what holds",
    ]
    for name in ABOUT:
        most = results.worst[name][0].score.score if results.worst.get(name) else 0.0
        lines.append(f"{name:10}{results.broken[name]:>8}{most:>8.3g}  {ABOUT[name]}")
    lines += ["", "The nearest to their bounds:", ""]
    for found in worst(results, count):
        s, unit, two = found.score, UNITS[found.invariant], " --fingers 2" if found.touch.graph == TWO else ""
        bound = f"bound {s.bound:.4g}" if s.least is None else f"at least {s.least:.4g}"
        lines += [
            f"{found.invariant}: {s.value:.4g} {unit} at {s.time:.4f} s, {bound} {unit} ({s.score:.3g} x)",
            *(f"    {fault}" for fault in found.faults),
            f"    palpate bench faults --seed {found.seed} --seeds 1{two}",
            f"    {found.touch.command()}",
            *(f"        {event}" for event in found.events),
            "",
        ]
    return "\n".join(lines)


def plain(results: Results, count: int) -> dict[str, Any]:
    """The report for programs."""
    return {
        "ok": not results.broken.total(), "seeds": results.seeds, "broken": results.broken.total(),
        "faults": {kind: results.kinds[kind] for kind in KINDS},
        "invariants": [
            {"name": name, "about": ABOUT[name], "broken": results.broken[name],
             "worst": results.worst[name][0].score.score if results.worst.get(name) else 0.0}
            for name in ABOUT
        ],
        "worst": [
            {"invariant": f.invariant, "seed": f.seed, "score": f.score.score, "value": f.score.value,
             "bound": f.score.bound, "least": f.score.least, "time": f.score.time, "faults": f.faults,
             "command": f.touch.command(), "events": f.events}
            for f in worst(results, count)
        ],
    }  # fmt: skip


def write_report(results: Results, out: Path, count: int) -> dict[str, Path]:
    """Write the report to a folder, as text and as JSON; the files by name. OSError: it cannot be written."""
    out.mkdir(parents=True, exist_ok=True)
    files = {"report": out / "faults.txt", "table": out / "faults.json"}
    replace_text(files["report"], text(results, count))
    replace_text(files["table"], json.dumps(plain(results, count), indent=1))
    return files
