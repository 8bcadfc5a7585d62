"""The results of the random searches of organs that touch, as data and as text."""

from typing import Any

from palpate.studies.organ_pairs import Verdict
from palpate.studies.organ_stacks import StackVerdict

MEASURES = {"pairs": ("overlap", "generated", "change"), "stacks": ("overlap", "energy", "lost")}
"""By which the worst are sorted, of `Verdict` and of `StackVerdict`."""


def pair_row(verdict: Verdict) -> dict[str, Any]:
    """A pair as plain data."""
    case = verdict.case
    kinds = ", ".join(f"{each['use']} {each['surface']['surface']}" for each in (case.upper, case.lower))
    return {
        "number": case.number, "organs": kinds, "friction": case.friction, "overlap": verdict.overlap,
        "generated": verdict.generated, "change": verdict.change, "force": verdict.organs,
        "faults": list(verdict.faults),
    }  # fmt: skip


def stack_row(verdict: StackVerdict) -> dict[str, Any]:
    """A stack as plain data."""
    stack = verdict.stack
    return {
        "number": stack.number, "organs": stack.words(), "friction": stack.friction, "rate": stack.rate,
        "overlap": verdict.overlap, "energy": verdict.energy, "lost": verdict.lost, "force": verdict.force,
        "faults": list(verdict.faults),
    }  # fmt: skip


def text(found: dict[str, list[dict[str, Any]]], worst: int) -> str:
    """Counts, faults, and the worst by each measure."""
    lines = []
    for name, rows in found.items():
        if not rows:
            continue
        touched, faulty = [row for row in rows if row["force"] > 0.0], [row for row in rows if row["faults"]]
        lines.append(f"{len(rows)} {name}, {len(touched)} touch, {len(faulty)} with faults")
        lines += [_line(row) for row in faulty]
        for measure in MEASURES[name]:
            lines.append(f"worst {name} by {measure}:")
            lines += [_line(row) for row in sorted(touched, key=lambda row: -row[measure])[:worst]]
    return "\n".join(lines)


def _line(row: dict[str, Any]) -> str:
    parts = [
        f"{row['number']:5d}",
        row["organs"],
        f"friction {row['friction']:g}",
        f"overlap {1e3 * row['overlap']:.1e} mm",
    ]
    if "rate" in row:
        parts += [f"{row['rate']} Hz", f"energy {row['energy']:.10f}", f"momentum lost {row['lost']:.1e}"]
    else:
        parts += [f"generated {row['generated']:.1e} J", f"change {row['change']:.3f}"]
    return "  " + "; ".join([*parts, f"{row['force']:.3g} N", *row["faults"]])
