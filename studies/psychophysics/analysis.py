"""From the tables of a folder to thresholds, JNDs, Weber fractions and exponents, each with its 95 % interval."""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from palpate.physics.errors import ArgumentError
from palpate.studies.psychophysics.file import ConstantBlock, Experiment, load
from palpate.studies.psychophysics.fit import Estimate, Fit, fit
from palpate.studies.psychophysics.functions import AT, HALF
from palpate.studies.psychophysics.store import NONE, Row, parse, tables

ALL = "all"


@dataclass(frozen=True)
class Outcome:
    """What one participant's trials of one block say.

    of         what the share is of: "correct", "yes", "judged greater"; "magnitude" for numbers
    path, unit  of levels
    numbers    estimates by name: threshold, pse, jnd, weber fraction, exponent
    at         share of the answers at the threshold, without lapses
    levels, shares, counts   (n) what was presented and answered; of magnitudes the geometric means
    sign       of x, see `Stimuli.x`; reference: level of the reference, None: there is none
    """

    task: str
    participant: str
    block: str
    trials: int
    of: str
    path: str
    unit: str
    numbers: dict[str, Estimate]
    lapse: float = math.nan
    guess: float = math.nan
    at: float = math.nan
    levels: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)
    sign: int = 1
    reference: float | None = None
    fitted: Fit | None = None

    def units(self, name: str) -> str:
        """The unit of one of the numbers, in brackets; "" for a ratio."""
        return "" if name in ("weber fraction", "exponent") else f" [{self.unit}]"

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs: what is open or not known is null."""
        told = asdict(self)
        for name, number in self.numbers.items():
            told["numbers"][name]["value"] = number.value if number.known else None
        return _plain(told)


def analyse(folder: Path) -> list[Outcome]:
    """What all tables of a folder say, by task, block and participant; of several participants the mean, too.

    ArgumentError: there are none, or their experiment is missing.
    """
    found = tables(folder)
    if not found:
        raise ArgumentError(f"{folder}: no table sub-*/ses-*/beh/*_beh.tsv; expected a folder of `palpate experiment`")
    outcomes = []
    for task in sorted({path.stem.split("_task-")[1].removesuffix("_beh") for path in found}):
        copy = folder / "code" / f"task-{task}.yaml"
        if not copy.is_file():
            raise ArgumentError(f"{copy}: missing; it says what the answers mean")
        experiment, _ = load(copy)
        groups: dict[tuple[str, str], list[Row]] = {}
        about = {"LongName": "level", "Units": "1"}
        for path in tables(folder, task):
            dictionary = path.with_suffix(".json")
            about |= json.loads(dictionary.read_text(encoding="utf-8"))["level"] if dictionary.is_file() else {}
            for row in parse(path.read_bytes())[0]:
                groups.setdefault((row["block"], path.name.split("_")[0]), []).append(row)
        for name, block in experiment.blocks.items():
            if not block.practice:
                own = [
                    outcome(experiment, task, who, name, rows, about)
                    for (of, who), rows in sorted(groups.items())
                    if of == name and any(row["level"] != NONE for row in rows)
                ]
                outcomes += [*own, *_mean(own)]
    return outcomes


def save(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Write the numbers of each task as a table, a row each."""
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
        files[-1].write_text("\n".join(lines) + "\n", encoding="utf-8")
    return files


def outcome(
    experiment: Experiment, task: str, who: str, name: str, rows: Sequence[Row], about: dict[str, str]
) -> Outcome:
    """What these rows of one participant and block say; `about` is what the data dictionary says of the level."""
    told = {"task": task, "participant": who, "block": name, "trials": len(rows)}
    told |= {"path": about["LongName"], "unit": about["Units"]}
    if experiment.response == "magnitude":
        return Outcome(**told, **_magnitude(rows))  # type: ignore[arg-type]
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
        return _fitted(told, fitted, numbers, "judged greater", levels, levels, greater, 1, reference)
    sign = 1 if reference is not None or experiment.harder == "lower" else -1
    signal = np.isfinite(levels)
    x = np.where(signal, sign * levels if reference is None else np.abs(levels - reference), -np.inf)
    of, guess = ("correct", 0.5) if experiment.response == "2afc" else ("yes", 0.0 if signal.all() else None)
    fitted = fit(experiment.function, x, hits, guess, positive=reference is not None)
    if reference is None:
        numbers = {"threshold": fitted.threshold.times(sign)}
    else:
        numbers = {"jnd": fitted.threshold, "weber fraction": fitted.threshold.times(1.0 / abs(reference))}
    return _fitted(told, fitted, numbers, of, levels, x, hits, sign, reference)


def _fitted(
    told: dict[str, Any], fitted: Fit, numbers: dict[str, Estimate], of: str, levels: np.ndarray, x: np.ndarray,
    hits: np.ndarray, sign: int, reference: float | None,
) -> Outcome:  # fmt: skip
    seen = np.unique(x[np.isfinite(x)])
    return Outcome(
        **told, of=of, numbers=numbers, lapse=fitted.lapse, guess=fitted.guess,
        at=fitted.guess + (1.0 - fitted.guess) * AT[fitted.function] if of != "judged greater" else 0.5,
        levels=seen.tolist(), shares=[float(hits[x == one].mean()) for one in seen],
        counts=[int((x == one).sum()) for one in seen], sign=sign, reference=reference, fitted=fitted,
    )  # fmt: skip


def _magnitude(rows: Sequence[Row]) -> dict[str, Any]:
    """Stevens' law, R = k S^n: a straight line through the logarithms; answers of 0 have none, and do not count."""
    pairs = [(float(row["level"]), float(row["response"])) for row in rows if float(row["response"]) > 0.0]
    level, response = np.log(np.array(pairs)).T if pairs else (np.zeros(0), np.zeros(0))
    seen = np.unique(level)
    exponent = Estimate(math.nan, math.nan, math.nan)
    if len(seen) > 1 and len(pairs) > 2:
        line = stats.linregress(level, response)
        half = float(stats.t.ppf(0.975, len(pairs) - 2) * line.stderr)
        exponent = Estimate(float(line.slope), float(line.slope) - half, float(line.slope) + half)
    means = [float(np.exp(response[level == one].mean())) for one in seen]
    counts = [int((level == one).sum()) for one in seen]
    return {"of": "magnitude", "numbers": {"exponent": exponent}, "levels": np.exp(seen).tolist(), "shares": means,
            "counts": counts}  # fmt: skip


def _mean(own: Sequence[Outcome]) -> Iterator[Outcome]:
    """The mean of several participants, with the interval of Student's t."""
    if len(own) < 2:
        return
    numbers = {}
    for name in own[0].numbers:
        values = np.array([one.numbers[name].value for one in own if one.numbers[name].known])
        if len(values) < 2:
            continue
        half = float(stats.t.ppf(0.975, len(values) - 1) * stats.sem(values))
        numbers[name] = Estimate(float(values.mean()), float(values.mean()) - half, float(values.mean()) + half)
    first = own[0]
    yield Outcome(
        first.task, ALL, first.block, sum(one.trials for one in own), first.of, first.path, first.unit, numbers
    )


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_plain(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
