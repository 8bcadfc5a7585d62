"""What a search for fits found, as a table and as JSON; the worst presses as files."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from palpate.models.fit.tissue.rigs import Rig
from palpate.studies.fits.presses import NAMES, draw_press
from palpate.studies.fits.search import ENOUGH, GOAL, WRONG, Outcome, intervals_of, strata

RESULTS = ("inside", "withheld", "refused", "missed")


def rows(found: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row per stratum: counts of the results, the share that is right, that of the intervals given which contain
    the true values, that without an interval, and wrong values.

    `each` is judged, since 95 % are stated for a single interval: all p intervals of a law contain their values in
    100 - 5 p to 95 %. A press that is withheld is not in it. `range` is what chance allows, and `verdict` is "low" or
    "high" only if all of it lies outside the goal, "within" if all lies inside, else "open".
    """
    out = []
    for name, each in strata(found).items():
        count = Counter(outcome.result for outcome in each)
        given, share = count["inside"] + count["missed"], _share_of_each(each)
        low, high = chance(share, given)
        out.append({
            "stratum": name, "by": "law" if name in NAMES else "disturbance", "enough": len(each) >= ENOUGH,
            "presses": len(each), **{result: count[result] for result in RESULTS},
            "right": 1.0 - count["missed"] / len(each),
            "coverage": count["inside"] / max(given, 1), "each": share, "range": [low, high],
            "verdict": _verdict(low, high),
            "without": (count["withheld"] + count["refused"]) / len(each),
            "wrong": sum(o.wrong for o in each),
            "silent": sum(o.silent for o in each), "apart": max(o.apart for o in each),
        })  # fmt: skip
    return out


def chance(share: float, presses: int) -> tuple[float, float]:
    """The 95 % range of Clopper and Pearson (Biometrika 26 (1934) 404-413) of a share [1] seen in this many presses.

    The intervals of a press depend on each other, so the presses count and not their intervals. A share over several
    intervals need not be a multiple of 1/presses; the beta quantiles interpolate.
    """
    if not presses:
        return 0.0, 1.0
    inside = share * presses
    outside = presses - inside
    low = float(beta.ppf(0.025, inside, outside + 1.0)) if inside > 0.0 else 0.0
    return low, float(beta.ppf(0.975, inside + 1.0, outside)) if outside > 0.0 else 1.0


def _verdict(low: float, high: float) -> str:
    """A range of chance compared with the goal."""
    if high < GOAL[0] or low > GOAL[1]:
        return "low" if high < GOAL[0] else "high"
    return "within" if GOAL[0] <= low and high <= GOAL[1] else "open"


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
        f"{len(found)} presses. each: share of the single intervals given, one per parameter, that contain their",
        f"value, of 95 % stated (goal {low:g} to {high:g} %); range: what chance allows for it with these presses;",
        "verdict: low or high if all of the range is outside the goal, within if inside, else open; coverage: all",
        "intervals of a press; right: these, or no interval with a reason; without: withheld or refused; apart: the",
        "nearest end of an interval over the true value, at worst;",
        f"wrong: apart by more than {WRONG:g}; silent: these without a note that warns; *: at least {ENOUGH} presses.",
    ]  # fmt: skip
    table = rows(found)
    for by, title in (("law", "by rig and law, with every disturbance"),
                      ("disturbance", "by disturbance, of every rig and law; a press may have several")):  # fmt: skip
        part = [r for r in table if r["by"] == by]
        verdicts = Counter(r["verdict"] for r in part)
        lines += [
            "", f"{title}:",
            f"{sum(r['enough'] for r in part)} of {len(part)} strata have {ENOUGH} presses; each: "
            + ", ".join(f"{verdicts[what]} {what}" for what in ("within", "open", "low", "high")),
            f"{'stratum':26}{'presses':>9}{'each':>7}{'range':>15}{'verdict':>8}{'coverage':>9}{'right':>8}{'without':>8}"
            f"{'missed':>7}{'wrong':>6}{'silent':>7}{'apart':>7}",
        ]  # fmt: skip
        lines += [_line(r) for r in part]
    for outcome, command in zip(listed, commands, strict=True):
        lines += ["", f"{outcome.case}, press {outcome.number}: off {outcome.off:.3g}, apart {outcome.apart:.3g}; "
                  + ", ".join(f"{name} {size}" for name, size in outcome.strata.items())]  # fmt: skip
        lines += [f"    note: {note}" for note in outcome.notes] or ["    no note"]
        lines.append(f"    {command}")
    return "\n".join(lines) + "\n"


def _line(r: dict[str, Any]) -> str:
    """A row of the table."""
    low, high = (f"{100 * end:.1f}" for end in r["range"])
    return (
        f"{r['stratum']:26}{r['presses']:>8}{'*' if r['enough'] else ' '}{100 * r['each']:>6.1f}%"
        f"{f'{low} to {high}':>15}{r['verdict']:>8}{100 * r['coverage']:>8.1f}%{100 * r['right']:>7.1f}%"
        f"{100 * r['without']:>7.1f}%{r['missed']:>7}{r['wrong']:>6}{r['silent']:>7}{r['apart']:>7.3g}"
    )


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
