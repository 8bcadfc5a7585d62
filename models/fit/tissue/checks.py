"""What is wrong with a press or with the law that is fitted to it: saturation, no rows before contact, drift, misfit.

Misfit: the law F(s) is compared with F(s) exp(a sqrt(x) + b x), x = s/s_max, that bends smoothly and keeps its numbers
where the indentation is small, by an F-test that counts independent residuals (`residuals.inflation`),

    (SSR - SSR')/SSR' (n_eff - p)/2 ~ F(2, n_eff - p).

Where that law follows the curve better, the intervals are widened to hold its numbers too.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2, norm
from scipy.stats import f as f_distribution

from palpate.models.fit.tissue.estimate import Estimate, Problem, estimate
from palpate.models.fit.tissue.measured import RARE, Press
from palpate.models.fit.tissue.residuals import inflation, inflation_limit
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
FEW = 20
"""Rows below which changes of sign are too few to count."""
LEAST_FREE = 4
"""Degrees of freedom of the noise before contact below which it does not show the size of the noise."""
SMOOTH = 1.5
"""[1] Least RMS residual over the noise, of a misfit whose residuals count as few."""
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


def widen(problem: Problem, best: Estimate) -> list[str]:
    """Widen the intervals of a fit where its law does not follow the curve, or give none, and say why."""
    reach = max(float(p.depth.max()) - t for p, t in zip(problem.presses, best.touches, strict=True))
    others = [("a smooth factor over the depth", bent(problem.law, reach), problem.kind)]
    if problem.kind == "none" and all(p.time is not None for p in problem.presses):
        others.append(("a factor that rises with the rate", problem.law, "hunt-crossley"))
    said, lost = [], True
    given = {p.name: replace(best.intervals[p.name]) for p in problem.parameters}
    for what, law, kind in others:
        other = Problem(problem.presses, law, kind, problem.free_touch, problem.relative)
        free = _alternative(other, problem, best)
        if free is None:
            continue
        moved = []
        for p in problem.parameters:
            own, its = best.intervals[p.name], free.intervals[p.name]
            if max(given[p.name].low - its.low, its.high - given[p.name].high) > HARMLESS * abs(own.value):
                moved.append(f"{p.name} {its.value:.4g}")
            own.low, own.high = min(own.low, its.low), max(own.high, its.high)
        lost = lost and _fewer_runs(problem.presses, free)
        if moved:
            said.append(f"with {what} it follows the curve better and gives {', '.join(moved)}")
    first = best.intervals[problem.parameters[0].name]
    if not said and not _fewer_runs(problem.presses, best):
        return []
    text = "; ".join(said) or "its residuals in contact change sign more rarely than those before it"
    if first.low <= 0.0 or first.high / first.low > WITHHELD or lost:
        best.withhold()
        text += ". No interval is given: no one value belongs to all of this curve"
    else:
        text += ". The intervals were widened to hold these"
    return [f"law {problem.law.name} misfits: {text}. Try another law (--compare), thickness, or --relaxation"]


def _alternative(other: Problem, problem: Problem, best: Estimate) -> Estimate | None:
    """The fit of a law with more freedom, from the numbers of the best one; None where it is not clearly better."""
    begin = other.start()
    count = len(problem.parameters)
    if problem.count < 3 * len(begin):
        return None
    names = [p.name for p in other.parameters]
    begin[: len(names)] = [
        best.number(p.name)[0] if p.name in best.names else p.searched(p.guess) for p in other.parameters
    ]
    begin[len(names) :] = best.at[count:]
    free = estimate(other, profiles=False, begin=begin)
    gain = best.squares - free.squares
    if math.sqrt(max(gain, 0.0)) < EXACT:
        return None
    weighted = [r * w for r, w in zip(free.residuals, other.weight, strict=True)]
    left = problem.count / inflation_limit(weighted, len(begin)) - len(begin)
    if left < 2 * len(begin):  # what is left is too smooth to count: it must stand out of the noise
        left = 2 * len(begin)
        if best.squares < (SMOOTH * _noise(problem, best)) ** 2:
            return None
    more = len(names) - count
    chance = f_distribution.sf(gain / max(free.squares, 1e-300) * left / more, more, left)
    return free if chance < RARE else None


def _noise(problem: Problem, best: Estimate) -> float:
    """What the weighted noise of the force is at most, with 99 % confidence: of the residuals before contact, whose
    variance has n (1 - rho²)/(1 + rho²) degrees of freedom; or where these are few, of the second differences."""
    noise = []
    for press, off, touch, w in zip(problem.presses, best.residuals, best.touches, problem.weight, strict=True):
        before = off[: int(np.argmax(press.depth > touch))]
        before = before - before.mean() if len(before) else before
        tau = inflation([before], 1)
        rho = (tau - 1.0) / (tau + 1.0)
        count = len(before) * (1.0 - rho**2) / (1.0 + rho**2) - 1.0
        if count >= LEAST_FREE:
            size = float(before.std()) * math.sqrt(count / chi2.ppf(0.01, count))
        else:  # 4: of noise with a correlation of 0.9 from row to row
            size = 4.0 * float(np.median(np.abs(np.diff(press.force, 2)))) / 0.6745 / math.sqrt(6.0)
        noise.append(size * float(np.median(w)))
    return max(noise)


def _fewer_runs(presses: Sequence[Press], best: Estimate) -> bool:
    """Whether the residuals in contact change sign more rarely than those before it, which are noise alone."""
    free, pressed = _changes(presses, best, False), _changes(presses, best, True)
    if min(free[1], pressed[1]) < FEW:
        return False
    share = (free[0] + pressed[0]) / (free[1] + pressed[1])
    spread = math.sqrt(max(share * (1.0 - share), 1e-12) * (1.0 / free[1] + 1.0 / pressed[1]))
    spread /= math.sqrt(min(2.0 * max(share, 1e-6), 1.0))  # changes of correlated noise come in clusters
    return bool(norm.sf((free[0] / free[1] - pressed[0] / pressed[1]) / spread) < RARE)


def _changes(presses: Sequence[Press], best: Estimate, contact: bool) -> tuple[int, int]:
    """Changes of sign from row to row of the residuals, in contact or before it, and of how many rows."""
    changes = rows = 0
    for press, off, touch in zip(presses, best.residuals, best.touches, strict=True):
        begin = int(np.argmax(press.depth > touch))
        signs = np.sign(off[begin:] if contact else off[:begin])
        changes += int((np.diff(signs) != 0).sum())
        rows += max(len(signs) - 1, 0)
    return changes, rows
