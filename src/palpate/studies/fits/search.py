"""Fits random presses, judges the intervals, and counts them by stratum; the results are kept, so a search resumes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import prepare_press
from palpate.models.fit.tissue.relaxing import parameters
from palpate.models.fit.tissue.rigs import SHAPES, closed_form
from palpate.studies.fits.cases import CASES
from palpate.studies.fits.presses import NAMES, NOISES, draw_press
from palpate.studies.fits.tables import TABULATED
from palpate.studies.kept import adding_lines, kept_lines

WRONG = 1.5  # [1] Factor by which no value may be wrong without a word
GOAL, ENOUGH = (0.92, 0.98), 1000  # [1] Share of right presses in a stratum of this many presses
FLAWS = (
    "shallow", "few rows", "from contact", "rise", "zero", "drift", "bent drift", "tilt", "quantised", "hysteresis",
    "two cycles", "hold",
)  # fmt: skip
KEPT = "presses.jsonl"
REMARKS = ("excluded", "baseline was fitted", "rise was fitted", "hum was fitted", "mesh and table:")
"""Parts of notes that describe the fit and warn of no wrong value."""


@dataclass(frozen=True)
class Outcome:
    """The fit of a press.

    result  inside: all intervals contain the true values; withheld; refused; missed
    off     [1] largest factor between the value of a scale parameter and the true one
    apart   [1] largest factor between the nearest end of an interval and the true value, 1 if inside; of parameters
            that are searched as logarithms
    notes   warnings of the fit, or the error
    outside  the parameters outside their intervals
    """

    case: str
    number: int
    seed: int
    strata: dict[str, Any]
    result: str
    off: float
    apart: float
    notes: list[str]
    outside: list[str] = field(default_factory=list)

    @property
    def wrong(self) -> bool:
        """Whether an interval is given whose nearest end differs by more than `WRONG` from the true value."""
        return self.result == "missed" and self.apart > WRONG

    @property
    def silent(self) -> bool:
        """Whether it is wrong and no note warns; `REMARKS` do not."""
        return self.wrong and all(any(remark in note for remark in REMARKS) for note in self.notes)


@cache
def intervals_of(name: str) -> int:
    """Number of parameters of a case, each of which has an interval."""
    if name in TABULATED:
        return 1 + len(SHAPES[name.partition(" ")[2]])
    case = CASES[name](np.random.default_rng(0))
    return len(closed_form(case.rig, case.law).parameters) + len(parameters(case.relaxation, 1.0))


def judge(name: str, seed: int, number: int, folder: Path | None = None) -> Outcome:
    """Draw, fit and judge a press; `folder` has the tables of finite elements."""
    press = draw_press(name, seed, number, folder)
    case, strata = press.case, press.plain()
    try:
        measured = prepare_press("press.csv", press.time, press.depth, press.force)
        fit = fit_tissue([measured], case.rig, case.law, case.relaxation, table=case.table)
    except SessionError as error:
        return Outcome(name, number, seed, strata, "refused", 1.0, 1.0, [str(error)])
    best, off, apart = fit.estimate, 1.0, 1.0
    for p in best.parameters:
        true, found = case.truth[p.name], best.intervals[p.name]
        if p.log:
            off = max(off, found.value / true, true / found.value)
        end = min(max(true, found.low), found.high)
        if p.log:
            apart = max(apart, end / true, true / end)
    outside = [
        p.name for p in best.parameters
        if not best.intervals[p.name].low <= case.truth[p.name] <= best.intervals[p.name].high
    ]  # fmt: skip
    result = "withheld" if best.withheld else "missed" if outside else "inside"
    return Outcome(name, number, seed, strata, result, off, apart, list(fit.notes), outside)


def search(
    names: Sequence[str], presses: int, seed: int, out: Path, show: Callable[[float, str], object], first: int = 0,
    results: Path | None = None,
) -> Iterator[Outcome]:  # fmt: skip
    """The presses first ... first + presses - 1 of each case, one after the other.

    results  file of outcomes, one per line; by default in the folder. Presses of this seed that it has are not fitted
             again, so it must be of the same version
    out      folder of the tables of finite elements
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = results or out / KEPT
    known = {(o.case, o.number): o for o in stored(kept) if o.seed == seed}
    missed = 0
    wanted = [(name, number) for number in range(first, first + presses) for name in names]
    with adding_lines(kept) as add:
        for done, (name, number) in enumerate(wanted, 1):
            outcome = known.get((name, number))
            if outcome is None:
                outcome = judge(name, seed, number, out)
                add(asdict(outcome))
            missed += outcome.result == "missed"
            yield outcome
            show(done / len(wanted), f"{missed} missed")


def stored(path: Path) -> Iterator[Outcome]:
    """The outcomes of a file; lines of another kind are left out."""
    for line in kept_lines(path):
        with suppress(TypeError):
            yield Outcome(**line)


def strata(found: Iterable[Outcome]) -> dict[str, list[Outcome]]:
    """Outcomes by rig and law, with every disturbance; then by kind of noise and by flaw, of every rig and law. Each
    press is in one stratum of the first kind and in several of the second."""
    listed = list(found)
    out = {name: [o for o in listed if o.case == name] for name in NAMES}
    out |= {f"noise: {kind}": [o for o in listed if o.strata["noise"] == kind] for kind in NOISES}
    out |= {f"flaw: {flaw}": [o for o in listed if flaw in o.strata] for flaw in FLAWS}
    out["no flaw but noise"] = [o for o in listed if not set(o.strata) - {"noise", "zero", "hold"}]
    return {name: each for name, each in out.items() if each}
