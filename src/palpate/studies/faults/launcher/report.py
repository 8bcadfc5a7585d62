"""What a search of launcher and workers found, as a table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.faults.launcher.judge import ABOUT
from palpate.studies.faults.launcher.scene import KINDS
from palpate.studies.faults.launcher.search import Results


def text(results: Results, count: int) -> str:
    """The report: a table, then broken seeds with the fewest faults that break them and the last events."""
    faults = ", ".join(f"{results.kinds[kind]} {kind}" for kind in KINDS)
    speed = 60.0 * results.seeds / max(results.duration, 1e-9)
    lines = [
        f"{results.seeds} runs of launcher and workers, {speed:.0f} a minute, with {results.kinds.total()} faults:",
        f"{faults}.",
        "",
        f"{'invariant':10}{'broken':>8}  what holds",
        *(f"{name:10}{results.broken[name]:>8}  {about}" for name, about in ABOUT.items()),
    ]
    for found in results.found[:count]:
        lines += [
            "",
            f"{found.invariant}: {found.text}",
            f"    palpate bench faults --launcher --seed {found.seed} --seeds 1",
            f"    {found.scene}",
            *(f"    {fault}" for fault in found.faults or ["without faults"]),
            *(f"        {event}" for event in found.events),
        ]
    return "\n".join([*lines, ""])


def plain(results: Results, count: int) -> dict[str, Any]:
    """The report for programs."""
    return {
        "ok": not results.broken.total(), "seeds": results.seeds, "broken": results.broken.total(),
        "faults": {kind: results.kinds[kind] for kind in KINDS},
        "invariants": [{"name": n, "about": about, "broken": results.broken[n]} for n, about in ABOUT.items()],
        "found": [
            {"invariant": f.invariant, "seed": f.seed, "text": f.text, "run": str(f.scene), "faults": f.faults,
             "events": f.events}
            for f in results.found[:count]
        ],
    }  # fmt: skip


def write_report(results: Results, out: Path, count: int) -> dict[str, Path]:
    """Write the report to a folder, as text and as JSON; the files by name. OSError: it cannot be written."""
    out.mkdir(parents=True, exist_ok=True)
    files = {"report": out / "launcher.txt", "table": out / "launcher.json"}
    replace_text(files["report"], text(results, count))
    replace_text(files["table"], json.dumps(plain(results, count), indent=1))
    return files
