"""What a search for fits found, as a table and as JSON; the worst presses as files."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.fit.tissue.rigs import Rig
from palpate.studies.fits.presses import NAMES, draw_press
from palpate.studies.fits.search import ENOUGH, GOAL, WRONG, Outcome, intervals_of, strata

RESULTS = ("inside", "withheld", "refused", "missed")


def rows(found: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row per stratum: counts of the results, the share that is right, that of the intervals given which contain
    the true values, that without an interval, and wrong values."""
    out = []
    for name, each in strata(found).items():
        count = Counter(outcome.result for outcome in each)
        out.append({
            "stratum": name, "by": "law" if name in NAMES else "disturbance", "enough": len(each) >= ENOUGH,
            "presses": len(each), **{result: count[result] for result in RESULTS},
            "right": 1.0 - count["missed"] / len(each),
            "coverage": count["inside"] / max(count["inside"] + count["missed"], 1), "each": _share_of_each(each),
            "without": (count["withheld"] + count["refused"]) / len(each),
            "wrong": sum(o.wrong for o in each),
            "silent": sum(o.silent for o in each), "apart": max(o.apart for o in each),
        })  # fmt: skip
    return out


def _share_of_each(outcomes: Sequence[Outcome]) -> float:
    """Share of the single intervals given that contain their true value, one per parameter."""
    given = [outcome for outcome in outcomes if outcome.result in ("inside", "missed")]
    return 1.0 - sum(len(o.outside) for o in given) / max(sum(intervals_of(o.case) for o in given), 1)


def worst_of(found: Sequence[Outcome], count: int) -> list[Outcome]:
    """The missed presses, those without a note first, then by how far their interval is from the true value."""
    missed = [outcome for outcome in found if outcome.result == "missed"]
    return sorted(missed, key=lambda o: (not o.silent, -o.apart))[:count]


def text(found: Sequence[Outcome], listed: Sequence[Outcome], commands: Sequence[str]) -> str:
    """The table of all strata, and the worst presses."""
    low, high = (100 * share for share in GOAL)
    lines = [
        f"{len(found)} presses. right: all true values in their intervals, or no interval with a reason",
        f"(goal {low:g} to {high:g} %); coverage: right among the presses with intervals; each: share of the single",
        "intervals that contain their value, one per parameter, of 95 % stated; without: withheld or refused;",
        f"apart: the nearest end of an interval over the true value, at worst; wrong: apart by more than {WRONG:g};",
        "silent: these without a note that warns; *: at least 1000 presses.",
    ]  # fmt: skip
    table = rows(found)
    for by, title in (("law", "by rig and law, with every disturbance"),
                      ("disturbance", "by disturbance, of every rig and law; a press may have several")):  # fmt: skip
        part = [r for r in table if r["by"] == by]
        many = [r for r in part if r["enough"]]
        good = sum(low <= 100 * r["right"] <= high for r in many)
        lines += [
            "", f"{title}:",
            f"{len(many)} of {len(part)} strata have {ENOUGH} presses, {good} of them {low:g} to {high:g} % right",
            f"{'stratum':26}{'presses':>9}{'right':>8}{'coverage':>9}{'each':>7}{'without':>8}{'missed':>7}{'wrong':>6}{'silent':>7}"
            f"{'apart':>7}",
        ]  # fmt: skip
        lines += [
            f"{r['stratum']:26}{r['presses']:>8}{'*' if r['enough'] else ' '}{100 * r['right']:>7.1f}%"
            f"{100 * r['coverage']:>8.1f}%{100 * r['each']:>6.1f}%"
            f"{100 * r['without']:>7.1f}%{r['missed']:>7}{r['wrong']:>6}{r['silent']:>7}"
            f"{r['apart']:>7.3g}"
            for r in part
        ]
    for outcome, command in zip(listed, commands, strict=True):
        lines += ["", f"{outcome.case}, press {outcome.number}: off {outcome.off:.3g}, apart {outcome.apart:.3g}; "
                  + ", ".join(f"{name} {size}" for name, size in outcome.strata.items())]  # fmt: skip
        lines += [f"    note: {note}" for note in outcome.notes] or ["    no note"]
        lines.append(f"    {command}")
    return "\n".join(lines) + "\n"


def plain(found: Sequence[Outcome], listed: Sequence[Outcome], commands: Sequence[str]) -> dict[str, Any]:
    """The report for programs."""
    return {
        "ok": not any(outcome.silent for outcome in found), "presses": len(found), "rows": rows(found),
        "worst": [asdict(o) | {"command": command} for o, command in zip(listed, commands, strict=True)],
    }  # fmt: skip


def save_press(outcome: Outcome, folder: Path) -> str:
    """Write a press as CSV; returns the command that fits it."""
    press = draw_press(outcome.case, outcome.seed, outcome.number, folder)
    path = folder / f"{outcome.case.replace(' ', '-').replace(':', '-')}-{outcome.number}.csv"
    table = np.column_stack([press.time, 1e3 * press.depth, press.force])
    np.savetxt(path, table, fmt="%.9e", delimiter=",", header="time [s],depth [mm],force [N]", comments="")
    case = press.case
    words = ["palpate", "fit", "tissue", str(path), *_rig(case.rig), "--law", case.law]
    return shlex.join([*words, *(["--relaxation", case.relaxation] if case.relaxation != "none" else [])])


def _rig(rig: Rig) -> list[str]:
    """The options of a rig."""
    size = [] if rig.kind == "fingertip" else ["--radius", f"{1e3 * rig.radius:.9g} mm"]
    height = ["--height", f"{1e3 * rig.height:.9g} mm"] if rig.height else []
    plates = ["--plates", rig.plates] if rig.kind == "cylinder" else []
    return ["--rig", rig.kind, *size, *height, *plates]
