"""What a search found, as tables and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.relations.relation import Relation
from palpate.studies.relations.search import Found, Results


def rows(results: Results, relations: Sequence[Relation]) -> list[dict[str, Any]]:
    """One row for each relation: comparisons, how many are broken, the worst score, and refused runs."""
    return [
        {"relation": one.name, "about": one.about, "exact": one.exact, "stated": results.stated[one.name],
         "broken": results.broken[one.name],
         "worst": results.worst[one.name][0].score.score if one.name in results.worst else 0.0,
         "refused": sum(count for (name, _), (count, _) in results.refused.items() if name == one.name)}
        for one in relations
    ]  # fmt: skip


def worst(results: Results, count: int) -> list[Found]:
    """The worst comparisons of all relations, those that are broken or nearest to it first."""
    return sorted((f for listed in results.worst.values() for f in listed), key=lambda f: -f.score.score)[:count]


def line(found: Found) -> str:
    """A comparison in words."""
    s, given = found.score, found.case.touch.setting
    return (
        f"{found.relation}: {s.value:.4g} N at {s.time:.4f} s, bound {s.bound:.4g} N ({s.score:.3g} x): "
        f"{given.surface}, {given.body}, {given.friction or 'no friction'}, {given.rate:g} Hz"
    )


def text(results: Results, relations: Sequence[Relation], count: int) -> str:
    """The report: a table, then the worst comparisons with the commands of their runs."""
    lines = [
        f"{results.total} comparisons of runs. Worst: the largest difference over its bound; above 1 it is broken.",
        "",
    ]
    lines.append(f"{'relation':12}{'broken':>8}{'of':>8}{'worst':>10}{'refused':>9}  what holds, how exactly")
    for row in rows(results, relations):
        lines.append(
            f"{row['relation']:12}{row['broken']:>8}{row['stated']:>8}{row['worst']:>10.3g}{row['refused']:>9}  "
            f"{row['about']} ({row['exact']})"
        )
    lines += ["", "The nearest to their bounds:", ""]
    for found in worst(results, count):
        lines += [line(found), *(f"    {run.command()}" for run in found.runs), ""]
    for (name, why), (number, command) in sorted(results.refused.items()):
        lines += [f"{name}: {number} refused: {why}", f"    {command}"]
    return "\n".join(lines) + "\n"


def plain(results: Results, relations: Sequence[Relation], count: int) -> dict[str, Any]:
    """The report for programs."""
    return {
        "ok": not results.broken.total(), "comparisons": results.total, "broken": results.broken.total(),
        "rows": rows(results, relations),
        "worst": [
            {"relation": f.relation, "score": f.score.score, "value": f.score.value, "bound": f.score.bound,
             "time": f.score.time, "commands": [run.command() for run in f.runs]}
            for f in worst(results, count)
        ],
        "refused": [
            {"relation": name, "why": why, "count": number, "command": command}
            for (name, why), (number, command) in sorted(results.refused.items())
        ],
    }  # fmt: skip


def write_report(results: Results, relations: Sequence[Relation], out: Path, count: int) -> dict[str, Path]:
    """Write the report to a folder, as text and as JSON; the files by name. OSError: it cannot be written."""
    out.mkdir(parents=True, exist_ok=True)
    files = {"report": out / "relations.txt", "table": out / "relations.json"}
    replace_text(files["report"], text(results, relations, count))
    replace_text(files["table"], json.dumps(plain(results, relations, count), indent=1))
    return files
