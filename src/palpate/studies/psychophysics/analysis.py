"""Compute thresholds, JNDs, Weber fractions and exponents with 95 % intervals from the tables of a folder."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy import stats

from palpate.physics.archive import replace_text
from palpate.physics.errors import ArgumentError
from palpate.studies.psychophysics.file import ConstantBlock, Experiment, load
from palpate.studies.psychophysics.fit import Fit, IntervalEstimate, fit
from palpate.studies.psychophysics.functions import AT, HALF
from palpate.studies.psychophysics.store import NONE, Row, parse, read_content, tables

ALL = "all"


@dataclass(frozen=True)
class Outcome:
    """Results of one participant in one block.

    of         the counted answer: "correct", "yes", "judged greater"; "magnitude" for numbers
    path, unit  path and unit of the level
    numbers    estimates by name: threshold, pse, jnd, weber fraction, exponent
    at         share of the counted answer at the threshold, without lapses
    levels, shares, counts   (n) presented levels, shares of the counted answer (magnitudes: geometric means), trials
    sign       sign of x, see `Stimuli.x`;  reference  level of the reference, or None
    question   question of the experiment
    """

    task: str
    participant: str
    block: str
    trials: int
    of: str
    path: str
    unit: str
    numbers: dict[str, IntervalEstimate]
    lapse: float = math.nan
    guess: float = math.nan
    at: float = math.nan
    levels: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    sign: int = 1
    reference: float | None = None
    question: str = ""
    fitted: Fit | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the answers do not determine."""
        return self.fitted.limits if self.fitted is not None else ()

    def units(self, name: str) -> str:
        """Unit of a number, in brackets; "" for a ratio."""
        return "" if name in ("weber fraction", "exponent") else f" [{self.unit}]"

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs: unknown numbers and open interval ends are null."""
        bare = self if self.fitted is None else replace(self, fitted=replace(self.fitted, grid=None))
        plain: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(bare))
        for name, number in self.numbers.items():
            plain["numbers"][name]["value"] = number.value if number.known else None
        return plain


def analyse(folder: Path) -> list[Outcome]:
    """Results of all tables of a folder, by task, block and participant, with the mean of several participants.

    ArgumentError: the folder has no tables, or their experiment is missing.
    """
    found = tables(folder)
    if not found:
        raise ArgumentError(f"{folder}: no table sub-*/ses-*/beh/*_beh.tsv; expected a folder of `palpate experiment`")
    outcomes = []
    for task in sorted({path.stem.split("_task-")[1].removesuffix("_beh") for path in found}):
        copy = folder / "code" / f"task-{task}.yaml"
        if not copy.is_file():
            raise ArgumentError(f"{copy}: missing; it defines the answers")
        experiment, _ = load(copy)
        groups: dict[tuple[str, str], list[Row]] = {}
        about = {"LongName": "level", "Units": "1"}
        for path in tables(folder, task):
            dictionary = path.with_suffix(".json")
            about |= _read_description(dictionary) if dictionary.exists() else {}
            for row in parse(read_content(path))[0]:
                groups.setdefault((row["block"], path.name.split("_")[0]), []).append(row)
        for name, block in experiment.blocks.items():
            if not block.practice:
                each = [
                    outcome(experiment, task, who, name, rows, about)
                    for (of, who), rows in sorted(groups.items())
                    if of == name and any(row["level"] != NONE for row in rows)
                ]
                outcomes += [*each, *_mean(each)]
    return outcomes


def _read_description(path: Path) -> dict[str, Any]:
    """The description of the column `level`. ArgumentError: the file is damaged."""
    try:
        return dict(json.loads(read_content(path))["level"])
    except (ValueError, TypeError, LookupError, RecursionError) as error:
        why = f"{type(error).__name__}: {error}"
        raise ArgumentError(f"{path}: damaged ({why}); `palpate experiment` writes it again, or remove it") from None


def save(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Write the numbers of each task as a table, one row per number."""
    files = []
    for task in dict.fromkeys(one.task for one in outcomes):
        lines = ["task\tparticipant_id\tblock\ttrials\tnumber\tunit\testimate\tlow\thigh"]
        for one in outcomes:
            for name, found in one.numbers.items() if one.task == task else ():
                unit = one.units(name).strip(" []") or "1"
                head = one.task, one.participant, one.block, str(one.trials), name, unit
                shown = (found.value, found.low, found.high) if found.known else ()
                lines.append("\t".join([*head, *(f"{x:.6g}" for x in shown)] + [NONE] * (3 - len(shown))))
        place = folder / "derivatives" / "palpate"
        place.mkdir(parents=True, exist_ok=True)
        files.append(place / f"task-{task}_thresholds.tsv")
        replace_text(files[-1], "\n".join(lines) + "\n")
    return files


def rows_of(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Participant, block, number of trials, name of a number, its value and interval, as text."""
    return [
        [one.participant, one.block, str(one.trials), f"{name}{_rate(one.at)}{one.units(name)}", *_as_text(number)]
        for one in outcomes
        for name, number in one.numbers.items()
    ]


def _as_text(number: IntervalEstimate) -> list[str]:
    if not number.known:
        return ["", "not determined"]
    ends = [f"{end:.4g}" if math.isfinite(end) else "open" for end in (number.low, number.high)]
    return [f"{number.value:.4g}", f"{ends[0]} to {ends[1]}"]


def _rate(share: float) -> str:
    return f" at {share:.0%}" if math.isfinite(share) else ""


def outcome(
    experiment: Experiment, task: str, who: str, name: str, rows: Sequence[Row], about: dict[str, str]
) -> Outcome:
    """Results of the rows of one participant and block; `about` is the entry of the level in the data dictionary."""
    common = {"task": task, "participant": who, "block": name, "trials": len(rows)}
    common |= {"path": about["LongName"], "unit": about["Units"], "question": experiment.question}
    if experiment.response == "magnitude":
        return Outcome(**common, **_magnitude(rows))  # type: ignore[arg-type]
    levels = np.array([-np.inf if row["level"] == NONE else float(row["level"]) for row in rows])
    hits = np.array([row["hit"] == "1" for row in rows])
    given = rows[0]["reference"]
    reference = None if given == NONE else float(given)
    sides = reference is not None and levels.min() < reference < levels.max()
    if experiment.response == "2afc" and reference is not None and sides:
        assert isinstance(experiment.blocks[name], ConstantBlock)
        greater = hits == (levels > reference) if experiment.asks == "greater" else hits != (levels < reference)
        fitted = fit(experiment.function, levels, greater, None, lapsing=True)
        jnd = fitted.spread.times(HALF[experiment.function])
        numbers = {"pse": fitted.threshold, "jnd": jnd, "weber fraction": jnd.times(1.0 / abs(reference))}
        return _fitted_numbers(common, fitted, numbers, "judged greater", levels, greater, 1, reference)
    sign = 1 if reference is not None or experiment.harder == "lower" else -1
    x = np.where(np.isfinite(levels), sign * levels if reference is None else np.abs(levels - reference), -np.inf)
    of, guess = ("correct", 0.5) if experiment.response == "2afc" else ("yes", None)
    fitted = fit(experiment.function, x, hits, guess, positive=reference is not None)
    if reference is None:
        numbers = {"threshold": fitted.threshold.times(sign)}
    else:
        numbers = {"jnd": fitted.threshold, "weber fraction": fitted.threshold.times(1.0 / abs(reference))}
    return _fitted_numbers(common, fitted, numbers, of, x, hits, sign, reference)


def _fitted_numbers(
    common: dict[str, Any], fitted: Fit, numbers: dict[str, IntervalEstimate], of: str, x: np.ndarray, hits: np.ndarray,
    sign: int, reference: float | None,
) -> Outcome:  # fmt: skip
    seen = np.unique(x[np.isfinite(x)])
    return Outcome(
        **common, of=of, numbers=numbers, lapse=fitted.lapse, guess=fitted.guess,
        at=fitted.guess + (1.0 - fitted.guess) * AT[fitted.function] if of != "judged greater" else 0.5,
        levels=seen.tolist(), shares=[float(hits[x == one].mean()) for one in seen],
        counts=[int((x == one).sum()) for one in seen], sign=sign, reference=reference, fitted=fitted,
    )  # fmt: skip


def _magnitude(rows: Sequence[Row]) -> dict[str, Any]:
    """Stevens' law, R = k S^n: a linear fit of the logarithms. Answers of 0 have no logarithm and are left out."""
    pairs = [(float(row["level"]), float(row["response"])) for row in rows if float(row["response"]) > 0.0]
    level, response = np.log(np.array(pairs)).T if pairs else (np.zeros(0), np.zeros(0))
    seen = np.unique(level)
    exponent = IntervalEstimate(math.nan, math.nan, math.nan)
    if len(seen) > 1 and len(pairs) > 2:
        line = stats.linregress(level, response)
        half = float(stats.t.ppf(0.975, len(pairs) - 2) * line.stderr)
        exponent = IntervalEstimate(float(line.slope), float(line.slope) - half, float(line.slope) + half)
    means = [float(np.exp(response[level == one].mean())) for one in seen]
    counts = [int((level == one).sum()) for one in seen]
    return {"of": "magnitude", "numbers": {"exponent": exponent}, "levels": np.exp(seen).tolist(), "shares": means,
            "counts": counts}  # fmt: skip


def _mean(outcomes: Sequence[Outcome]) -> Iterator[Outcome]:
    """Mean over several participants, with the confidence interval of Student's t."""
    if len(outcomes) < 2:
        return
    numbers = {}
    for name in outcomes[0].numbers:
        values = np.array([one.numbers[name].value for one in outcomes if one.numbers[name].known])
        if len(values) < 2:
            continue
        half = float(stats.t.ppf(0.975, len(values) - 1) * stats.sem(values))
        numbers[name] = IntervalEstimate(float(values.mean()), float(values.mean()) - half, float(values.mean()) + half)
    first = outcomes[0]
    yield Outcome(
        first.task, ALL, first.block, sum(one.trials for one in outcomes), first.of, first.path, first.unit, numbers
    )
