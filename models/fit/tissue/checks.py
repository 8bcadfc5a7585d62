"""What is wrong with a press or with the law that is fitted to it: saturation, no rows before contact, drift, misfit.

Misfit: `residuals.lack_of_fit` compares the residuals with other shapes of the force. One is F(s) exp(a sqrt(x) + b x),
x = s/s_max, that bends smoothly and keeps its numbers where the indentation is small. Where another shape follows the
curve better, it is fitted, and the intervals are widened to hold its numbers too.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from palpate.models.fit.tissue.estimate import Estimate, Problem, estimate
from palpate.models.fit.tissue.measured import RARE, SUSPECT, Press
from palpate.models.fit.tissue.residuals import inflation, lack_of_fit
from palpate.models.fit.tissue.rigs import Law, Parameter, Values

SHARES = (0.3, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025)
"""[1] Of the indentation: the last parts that are searched for a plateau."""
FLAT = 0.3
"""[1] Slope of the force at the end of the loading over its mean, below which the force has stopped rising."""
TIES = 4
"""Rows of exactly the greatest force, from which on it is a limit of the sensor."""
SURE = 3.3
"""Standard errors from which on a drift is one."""
WIDE = 0.005
"""[1] Of the greatest indentation that such rows extend over."""
HARMLESS = 0.02
"""[1] Of a parameter: a misfit that moves the end of its interval by less is not worth a note."""
EXACT = 3e-4
"""[1] RMS misfit over the peak that is none: no law and no sensor is that exact."""
BLOCKS_MOST = 8
"""Of rows in contact, whose means are compared with the noise."""
DRIFT, BENT, RATE = "a baseline that drifts", "a smooth factor over the depth", "a factor that rises with the rate"
BLOCKS = "blocks"
UNLIKELY = 0.02
"""Probability of chance below which another shape of the force is fitted, too."""
SMOOTH = 0.3
"""[1] Share of the residuals that count as independent, below which noise may hide a misfit: then `SUSPECT` is the
probability below which another shape is fitted."""
WITHHELD = 3.0
"""[1] Highest over lowest value that fit: beyond, no interval is given."""
BEND = (Parameter("bend_1", "1", 0.0, -5.0, 5.0, False), Parameter("bend_2", "1", 0.0, -5.0, 5.0, False))


def plateau(press: Press, relaxes: bool) -> int | None:
    """The row from which on the force stays the same while the indentation rises; None: there is none.

    Two signs: rows of exactly the greatest force over some indentation, as of a converter at its limit, and more than a
    step of the force explains; and, unless the law relaxes, a last part whose slope, a line by least squares, is less
    than `FLAT` of the mean slope with two standard errors, which no law here has. Parts where the indenter slows down
    to less than half of its mean speed do not count: there the force of a damped tissue falls.
    """
    top = int(np.argmax(press.depth))
    s, force = press.depth[: top + 1], press.force[: top + 1]
    reach, peak = float(s[-1]) - press.touch, float(force.max())
    equal = np.flatnonzero(force >= peak * (1.0 - 1e-9))
    step = float(np.median(np.diff(np.unique(force)))) / peak * reach
    if len(equal) >= TIES and np.ptp(s[equal]) > max(WIDE * reach, 3.0 * step):
        return int(equal[0])
    air = force[s < press.touch - press.slack]
    air = air - air.mean() if len(air) > 8 else np.zeros(1)
    time, ramp = press.elapsed[: top + 1], s > press.touch
    for share in () if relaxes else SHARES:
        last = s > s[-1] - share * reach
        if last.sum() < 6:
            break
        if np.ptp(time[last]) > 2.0 * share * np.ptp(time[ramp]):
            continue
        across, level = s[last] - s[last].mean(), float(force[last].mean())
        slope = float(across @ force[last]) / float(across @ across)
        noise = max(float((force[last] - level - slope * across).std()), float(air.std()))
        error = noise * math.sqrt(inflation([air], 1) / float(across @ across))
        if max(slope, 0.0) + 2.0 * error < FLAT * peak / reach:
            return int(np.argmax(force >= level - 2.0 * noise))
    return None


def baselines(problem: Problem, best: Estimate) -> list[str]:
    """A sentence for each press whose baseline drifts, or that may begin in contact."""
    said = []
    for press, touch in zip(problem.presses, best.touches, strict=True):
        peak, first = float(press.force.max()), float(press.depth.min())
        reach = float(press.depth.max()) - touch
        size, error = best.number(f"drift, {press.name}")
        if abs(size) > SURE * error:
            drift = size * 0.01 * float(np.abs(press.force).max())
            said.append(
                f"{press.name}: the force drifts before the touch already, by {drift:.3g} N over the rows fitted "
                f"({100 * drift / peak:.2g} % of the peak); a straight baseline was fitted with the parameters, which "
                "widens the intervals. A drift that is not straight is not corrected"
            )
        uncertain = best.number(f"touch, {press.name}")[1] * press.slack
        if not press.air and touch - 2.0 * uncertain < first - 0.02 * reach:
            said.append(
                f"{press.name}: no rows before contact show the zero of the force: it may touch up to "
                f"{1e3 * (first - touch + 2.0 * uncertain):.2g} mm before the first row. Zero and touch point "
                "were found from the curve alone, which widens the intervals; begin the press above the surface"
            )
    return said


def bent(law: Law, reach: float) -> Law:
    """The law times exp(a sqrt(x) + b x), x = s/reach."""

    def force(values: Values, s: np.ndarray) -> np.ndarray:
        x = s / reach
        return law.force(values, s) * np.exp(values["bend_1"] * np.sqrt(x) + values["bend_2"] * x)

    return replace(law, parameters=(*law.parameters, *BEND), force=force, slopes=None)


def widen(problem: Problem, best: Estimate) -> tuple[list[str], list[str]]:
    """Widen the intervals of a fit where its law does not follow the curve, or give none, and say why: in notes where
    it misfits, and apart where correlated noise may hide that it does."""
    chances = _chances(problem, best)
    limit = SUSPECT if best.effective[0] < SMOOTH * problem.count else UNLIKELY
    reach = max(float(p.depth.max()) - t for p, t in zip(problem.presses, best.touches, strict=True))
    drifting = [replace(press, drifts=True) for press in problem.presses]
    others = {
        DRIFT: (drifting, problem.law, problem.kind),
        BENT: (problem.presses, bent(problem.law, reach), problem.kind),
        RATE: (problem.presses, problem.law, "hunt-crossley"),
    }
    said, lost = [], True
    given = {p.name: replace(best.intervals[p.name]) for p in problem.parameters}
    for what, (presses, law, kind) in others.items():
        if chances.get(what, 1.0) > limit:
            continue
        other = Problem(presses, law, kind, problem.free_touch, problem.relative)
        begin = dict(zip(other.names, other.start(), strict=True)) | dict(zip(best.names, best.at, strict=True))
        free = estimate(other, profiles=False, begin=np.array([begin[name] for name in other.names]))
        moved = []
        for p in problem.parameters:
            own, its = best.intervals[p.name], free.intervals[p.name]
            if max(given[p.name].low - its.low, its.high - given[p.name].high) > HARMLESS * abs(own.value):
                moved.append(f"{p.name} {its.value:.4g}")
            own.low, own.high = min(own.low, its.low), max(own.high, its.high)
        lost = lost and _chances(other, free)[BLOCKS] < RARE
        if moved:
            said.append(f"with {what} it follows the curve better and gives {', '.join(moved)}")
    if not said and chances[BLOCKS] > RARE:
        return [], []
    text = "; ".join(said) or "its residuals in contact are not noise alone"
    first = best.intervals[problem.parameters[0].name]
    sure = chances[BLOCKS] <= RARE or min(chances[what] for what in chances if what != BLOCKS) <= UNLIKELY
    if sure and (first.low <= 0.0 or first.high / first.low > WITHHELD or lost):
        best.withhold()
        text += ". No interval is given: no one value belongs to all of this curve"
    else:
        text += ". The intervals were widened to hold these"
    if sure:
        return [f"law {problem.law.name} misfits: {text}. Try another law (--compare), thickness, or --relaxation"], []
    few, count = best.effective
    return [], [
        f"law or noise: the residuals follow one another ({few:.0f} of {count} count as independent), which may hide "
        f"that law {problem.law.name} misfits; {text}"
    ]


def _chances(problem: Problem, best: Estimate) -> dict[str, float]:
    """Probability that the noise alone is as near to each other shape of the force as the residuals of a fit are.

    The shapes are small changes: of the baseline, of the law by a smooth factor, of the law with the rate, and of the
    mean of each of some blocks of rows in contact.
    """
    columns: dict[str, list[np.ndarray]] = {}
    blocks = max(2, min(BLOCKS_MOST, problem.count // (10 * len(problem.presses))))
    for i, (press, touch, w) in enumerate(zip(problem.presses, best.touches, problem.weight, strict=True)):
        x = np.maximum(press.depth - touch, 0.0)
        x, force = x / max(float(x.max()), 1e-300), best.fitted[i] * w
        pressed = np.flatnonzero(x > 0.0)
        own: dict[str, list[np.ndarray]] = {BENT: [force * np.sqrt(x), force * x], DRIFT: [w * press.elapsed]}
        if problem.kind == "none" and press.time is not None:
            own[RATE] = [force * press.rate]
        own[BLOCKS] = [w * np.isin(np.arange(len(x)), rows) for rows in np.array_split(pressed, blocks)]
        for what, each in own.items():
            columns.setdefault(what, []).append(np.stack(each, axis=1))
    shared = {BENT: np.concatenate, RATE: np.concatenate}
    groups = {what: shared.get(what, lambda each: block_diag(*each))(each) for what, each in columns.items()}
    weighted = [r * w for r, w in zip(best.residuals, problem.weight, strict=True)]
    return lack_of_fit(weighted, problem.jacobian(best.at), groups, EXACT)
