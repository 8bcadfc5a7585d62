"""What a search found, as tables and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.organs.invariants import INVARIANTS, UNITS
from palpate.studies.organs.search import Found, Results
from palpate.studies.organs.zoo import specimen_of

NAMES = (*INVARIANTS, "finite")


def rows(results: Results) -> list[dict[str, Any]]:
    """One row for each surface and body: touches, and of each invariant how many broke it and the worst score."""
    found = []
    for surface, body in sorted({*results.touches, *results.refused}):
        key = surface, body
        row: dict[str, Any] = {"surface": surface, "body": body, "touches": results.touches[key],
                               "refused": results.refused.get(key, "")}  # fmt: skip
        for name in NAMES:
            listed = results.worst.get((surface, body, name), [])
            row[name] = {
                "broken": results.broken[surface, body, name],
                "worst": listed[0].score.score if listed else 0.0,
            }
        found.append(row)
    return found


def line(found: Found) -> str:
    """The score of a touch, in words."""
    s, given = found.score, found.touch.setting
    mesh = f"{given.count} vertices" if given.count else "NURBS"
    bound = f"bound {s.bound:.3g}" if s.least is None else f"bounds {s.least:.3g} and {s.bound:.3g}"
    return (
        f"{found.invariant}: {s.value:.3g} {UNITS[found.invariant]} at {s.time:.4f} s, {bound} "
        f"({s.score:.3g} x): {given.surface} ({mesh}), {given.body}, {given.friction or 'no friction'}, "
        f"{given.rate:g} Hz, {given.fingers} finger{'s' * (given.fingers > 1)}"
    )


def text(results: Results, folder: Path, count: int = 10, names: Sequence[str] = NAMES) -> str:
    """The whole report as text: broken of all touches and the worst score, then the worst touches."""
    head = f"{'surface':14}{'body':12}{'touches':>8}" + "".join(f"{name:>16}" for name in names)
    lines = [f"{results.total} touches. Cells: touches that break the invariant, and the worst value over its bound."]
    lines += ["", head]
    for row in rows(results):
        if not row["touches"]:
            lines.append(f"{row['surface']:14}{row['body']:12} refused: {row['refused']}")
            continue
        cells = "".join(f"{row[n]['broken'] or '.':>7} {row[n]['worst']:>8.3g}" for n in names)
        lines.append(f"{row['surface']:14}{row['body']:12}{row['touches']:>8}{cells}")
    lines += ["", "The worst touches:", ""]
    for found in results.top(count):
        lines += [line(found), "    " + found.touch.command(folder), ""]
    lines += [line(pair) for pair in sorted(results.pairs, key=lambda pair: (pair.invariant, -pair.score.score))]
    lines += _relations(results, folder, count)
    for (surface, body, reason), touch in sorted(results.silent.items()):
        lines += [f"no note ({reason}): {surface}, {body}", "    " + touch.command(folder), ""]
    lines += [f"stopped: {error}\n    {touch.command(folder)}" for touch, error in results.failed[:count]]
    return "\n".join(lines) + "\n"


def _unlike(results: Results, count: int) -> list[Found]:
    """The worst touches of all relations."""
    return sorted((f for listed in results.unlike.values() for f in listed), key=lambda f: -f.score.score)[:count]


def _relations(results: Results, folder: Path, count: int) -> list[str]:
    if not results.related and not results.unmade:
        return []
    lines = ["", "Relations of a finger with a width: touches that break it, of all, and the worst score.", ""]
    for name, touches in sorted(results.related.items()):
        lines.append(f"{name:10}{results.apart[name]:>6} of {touches:<6}{results.unlike[name][0].score.score:>8.3g}")
    lines += [f"refused: {why}" for why in results.unmade] + [""]
    for found in _unlike(results, count):
        lines += [line(found), "    " + found.touch.command(folder), ""]
    return lines


def page(results: Results) -> str:
    """The table of surfaces and bodies in Markdown: touches that break an invariant, of all, and the worst score."""
    pairs = sorted({*results.touches, *results.refused})
    surfaces, bodies = ([*dict.fromkeys(pair[k] for pair in pairs)] for k in (0, 1))
    lines = ["| surface | " + " | ".join(bodies) + " |", "|---" * (1 + len(bodies)) + "|"]
    for surface in surfaces:
        cells = [_cell(results, surface, body) for body in bodies]
        lines.append(f"| {surface}: {specimen_of(surface).about} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(results: Results, surface: str, body: str) -> str:
    if not results.touches[surface, body]:
        return "refused" if (surface, body) in results.refused else "-"
    listed = [found[0] for name in NAMES if (found := results.worst.get((surface, body, name)))]
    worst = max(listed, key=lambda found: found.score.score)
    return (
        f"{results.bad[surface, body]} of {results.touches[surface, body]}; {worst.invariant} {worst.score.score:.2g}"
    )


def write_report(results: Results, meshes: Path, out: Path, count: int = 10) -> dict[str, Path]:
    """Write the report to a folder, as text and as JSON; the files by name. OSError: it cannot be written."""
    out.mkdir(parents=True, exist_ok=True)
    files = {"report": out / "organs.txt", "table": out / "organs.json"}
    files["page"] = out / "organs.md"
    replace_text(files["page"], page(results))
    replace_text(files["report"], text(results, meshes, count))
    replace_text(files["table"], json.dumps(plain(results, meshes, count), indent=1))
    return files


def plain(results: Results, folder: Path, count: int = 10) -> dict[str, Any]:
    """The report for programs."""
    worst = [
        {"invariant": f.invariant, "score": f.score.score, "value": f.score.value, "bound": f.score.bound,
         "unit": UNITS[f.invariant], "time": f.score.time, "touch": f.touch.plain(), "command": f.touch.command(folder)}
        for f in results.top(count)
    ]  # fmt: skip
    broken, apart = results.broken.total(), results.apart.total()
    silent = [{"surface": s, "body": b, "reason": why, "command": touch.command(folder)}
              for (s, b, why), touch in sorted(results.silent.items())]  # fmt: skip
    stopped = [{"error": error, "command": touch.command(folder)} for touch, error in results.failed]
    return {
        "ok": not (broken or silent or stopped or apart or any(pair.score.broken for pair in results.pairs)),
        "touches": results.total, "broken": broken, "rows": rows(results), "worst": worst, "silent": silent,
        "stopped": stopped, "pairs": [_pair(pair) for pair in results.pairs],
        "relations": [
            {"relation": name, "touches": touches, "broken": results.apart[name],
             "worst": results.unlike[name][0].score.score} for name, touches in sorted(results.related.items())
        ],
        "relations_refused": results.unmade,
        "unlike": [_pair(f) | {"least": f.score.least, "command": f.touch.command(folder)}
                   for f in _unlike(results, count)],
    }  # fmt: skip


def _pair(found: Found) -> dict[str, Any]:
    given = found.touch.setting
    return {"invariant": found.invariant, "surface": given.surface, "body": given.body, "vertices": given.count,
            "value": found.score.value, "bound": found.score.bound}  # fmt: skip
