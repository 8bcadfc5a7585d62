"""Tests for flaws of a press (saturation, no rows before contact, drift) and for lack of fit of its law.

Lack of fit: `residuals.lack_of_fit` tests whether another shape of the force explains the residuals. One shape is
F(s) exp(a sqrt(x) + b x), x = s/s_max, a smooth factor that tends to 1 at small indentation. If a shape fits
significantly better, it is fitted, and the intervals are widened to include its parameters.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.stats import f as fisher

from palpate.models.fit.tissue.estimate import (
    LEAST_PER_UNKNOWN,
    TOUCH_STARTS,
    Estimate,
    Problem,
    estimate,
    from_minima,
    starts,
)
from palpate.models.fit.tissue.measured import LEAST_AIR, MOST_RISE, RARE, SUSPECT, MeasuredPress, Rise, deepest_row
from palpate.models.fit.tissue.noise import SURE_ROWS, gain, in_contact, noise_before
from palpate.models.fit.tissue.residuals import inflation, lack_of_fit
from palpate.models.fit.tissue.rigs import Law, Parameter, Values

SHARES = (0.3, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025)
"""[1] Fractions of the indentation, up to its end, in which a plateau is searched."""
FLAT = 0.3  # [1] slope at the end of the loading, over the mean slope, below which the force is constant
TIES = 4  # number of rows with exactly the peak force at which the sensor counts as saturated
WIDE = 0.005  # [1] smallest range of indentation of these rows, over the largest indentation
HELD = 0.01  # [1] Deviation from the peak force, over it, within which the force is held
LEAST_HELD, CREEP = 5, 0.25  # Least rows of a hold, and its largest speed over the mean speed of the loading [1]
CYCLE = 0.5  # [1] Return of the indenter before its deepest row, over the indentation, after which another cycle begins
SURE = 3.3  # standard errors above which a drift is significant
HARMLESS = 0.02  # [1] largest relative shift of an interval's end by a misfit that is not reported
EXACT = 3e-4  # [1] RMS over the peak below which a misfit is ignored, since no law and no sensor is more accurate
ROUNDED = 4.0  # [1] Squares that a misfit explains, over those expected from the steps of the converter
BLOCKS_MOST = 8  # largest number of blocks of rows in contact whose means are compared with the noise
DRIFT, BENT, RATE = "a baseline that drifts", "a smooth factor over the depth", "a factor that rises with the rate"
RISE = "a force that rises before contact"
BLOCKS = "blocks"
LENGTHS = (0.03, 0.1, 0.3, 1.0)  # [1] Lengths of a rise before contact, over the approach
UNLIKELY = 0.02  # p-value below which another shape of the force is also fitted
SMOOTH = 0.3
"""[1] Share of independent residuals below which noise may hide a misfit; the p-value limit is then `SUSPECT`."""
WITHHELD = 3.0  # [1] Ratio of the ends of an interval above which no interval is given
BEND = (Parameter("bend_1", "1", 0.0, -5.0, 5.0, False), Parameter("bend_2", "1", 0.0, -5.0, 5.0, False))


def plateau(press: MeasuredPress, relaxes: bool) -> int | None:
    """First row of a plateau, where the force stays constant while the indentation rises; None: no plateau.

    Two tests. Saturated converter: rows with exactly the peak force extend over more indentation than the resolution of
    the force explains. Yield, unless the law relaxes: the regression slope of a last part plus two standard errors is
    below `FLAT` of the mean slope, which no law here allows. Parts where the indenter is slower than half of its mean
    speed are skipped, because the force of a damped tissue falls there.
    """
    top = deepest_row(press.depth)
    s, force = press.depth[: top + 1], press.force[: top + 1]
    reach, peak = float(s[-1]) - press.touch, float(force.max())
    rise = peak - (0.0 if press.air else float(force.min()))
    equal = np.flatnonzero(force >= peak - 1e-9 * rise)
    step = float(np.median(np.diff(np.unique(force)))) / rise * reach
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
        if max(slope, 0.0) + 2.0 * error < FLAT * rise / reach:
            return int(np.argmax(force >= level - 2.0 * noise))
    return None


def last_cycle(press: MeasuredPress, top: int) -> int:
    """First row of the loading that ends at row `top`: the lowest row after an earlier cycle, else 0."""
    depth = press.depth[: top + 1]
    reach = float(depth[top]) - press.touch
    fall = np.maximum.accumulate(depth) - depth
    deep = np.flatnonzero(fall > CYCLE * reach)
    if not len(deep):
        return 0
    peak = int(np.flatnonzero(fall[: deep[-1] + 1] == 0.0)[-1])
    return peak + int(np.argmin(depth[peak:]))


def end_of_loading(press: MeasuredPress, first: int, top: int) -> int:
    """Last row of the loading from row `first` of the cycle to row `top`, the deepest: the row at which an indenter
    reaches the force that it then holds while it creeps on; `top` if it does not."""
    if press.time is None or top == first:
        return top
    peak = float(press.force[first : top + 1].max())
    rise = peak - (0.0 if press.air else float(press.force[first : top + 1].min()))
    reached = first + int(np.argmax(press.force[first:] >= peak - max(3.0 * noise_before(press.force), HELD * rise)))
    begin = first + int(np.argmax(press.depth[first:] > press.touch))
    if top - reached < LEAST_HELD or reached <= begin:
        return top
    loading = float(press.depth[reached] - press.depth[begin]) / float(press.time[reached] - press.time[begin])
    creep = float(press.depth[top] - press.depth[reached]) / float(press.time[top] - press.time[reached])
    return reached if creep < CREEP * loading else top


def baselines(problem: Problem, best: Estimate) -> list[str]:
    """A warning for each press whose baseline drifts, or that may begin in contact."""
    notes = []
    for press, touch in zip(problem.presses, best.touches, strict=True):
        peak, first = float(press.force.max()), float(press.depth.min())
        reach = float(press.depth.max()) - touch
        size, error = best.number(f"drift, {press.name}")
        if abs(size) > SURE * error:
            drift = size * 0.01 * float(np.abs(press.force).max())
            notes.append(
                f"{press.name}: the force drifts before contact, by {drift:.3g} N over the rows fitted "
                f"({100 * drift / peak:.2g} % of the peak); a linear baseline was fitted with the parameters, which "
                "widens the intervals"
            )
        uncertain = best.number(f"touch, {press.name}")[1] * press.slack
        if not press.air and touch - 2.0 * uncertain < first - 0.02 * reach:
            notes.append(
                f"{press.name}: no rows before contact show the zero of the force: contact may begin up to "
                f"{1e3 * (first - touch + 2.0 * uncertain):.2g} mm before the first row. Zero and touch point "
                "were estimated from the curve, which widens the intervals; begin the press above the surface"
            )
    return notes


def allow_for_drift(
    problem: Problem, best: Estimate, drift: str, keep: bool
) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Replace the intervals of `best` by those of a fit in which the zero of the force of each press drifts, linearly
    or also quadratically in time and with a rise before contact (`drift`: linear, curved; none changes nothing).

    A bend hides below the noise before contact, and its shape is similar to that of a press, so no test can exclude
    it: the fit with it shows what the rows determine. Its interval inverts a likelihood-ratio test in which the
    baseline, of at most the peak force, is a nuisance parameter. So it contains the true value in 95 % of the cases,
    however wide it is. It is withheld if it reaches a limit of the search: then the rows exclude no value on that side.
    The union with the interval before would count the error of the force twice, and contain the true value in 98 to
    99 %. It is included only if an F-test of the bends does not exclude the fit without them, and this fit is another
    minimum, or has the wider interval: then the bends absorb noise. It is also included if the noise grows with the
    force and few rows show its correlation, which both tests need: then the error that counts twice is not known.

    keep  whether the intervals were widened, and may only become wider

    Returns the 95 % intervals before, none if nothing was changed, and notes.
    """
    if drift == "none" or best.withheld:
        return {}, []
    bends = drift == "curved"
    allowed = [problem.with_changes([replace(press, drifts=True) for press in problem.presses])]
    if bends:
        curved = [replace(press, drifts=True, bends=True) for press in problem.presses]
        risen = [replace(press, drifts=True, bends=True) for press in _with_rise(problem, best, False)]
        allowed += [problem.with_changes(curved), problem.with_changes(risen)]
    if allowed[-1].names == problem.names:
        return {}, []
    before = {name: (each.low, each.high) for name, each in best.intervals.items()}
    known = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in before.items())
    # the richest baseline for which the rows suffice
    enough = [other for other in allowed if other.count >= LEAST_PER_UNKNOWN * len(other.names)]
    if not enough or enough[-1].names == problem.names:
        few = f"{problem.count} rows are too few to fit a zero of the force that drifts"
        if all(press.air for press in problem.presses):
            return {}, [f"{few}: the intervals are valid only if it does not"]
        best.withhold()
        return before, [
            f"{few}, and no rows before contact show it: no interval is given. Record more rows, or rows before "
            f"contact. If you know that the zero does not drift, --drift none gives {known}"
        ]
    other = enough[-1]
    free = estimate(other, begin=from_minima(other, best))
    if free.is_open(problem.parameters[0]):
        best.withhold()
        option = "linear" if bends and all(press.drifts for press in problem.presses) else "none"
        return before, [
            "the rows do not distinguish the force from a zero that drifts: no interval is given. Record rows before "
            f"contact. If you know how the zero drifts, --drift {option} gives {known}"
        ]
    more, left = len(other.names) - len(problem.names), max(free.effective[0] - len(other.names), 1.0)
    gained = max(best.squares / free.squares - 1.0, 0.0) * left / more
    sure = any(press.bends for press in other.presses) and float(fisher.sf(gained, more, left)) < RARE
    few_in_contact = _gain_of_few_rows(problem, best)
    for p in problem.parameters:
        name, now, its = p.name, best.intervals[p.name], free.intervals[p.name]
        wide, wide_before = (p.to_search(each.high) - p.to_search(each.low) for each in (its, now))
        # the fit without is as likely, but another minimum; or the bends absorb noise
        other_minimum = not its.low <= now.value <= its.high
        before_too = keep or (not sure and (other_minimum or wide < wide_before or few_in_contact))
        ends = [now.value, its.low, its.high, *((now.low, now.high) if before_too else ())]
        best.intervals[name] = replace(now, low=min(ends), high=max(ends), profile=its.profile, curve=its.curve)
    return before, [
        "the zero of the force seems to drift along a curve or to rise before contact; the intervals include this"
    ] * sure


def undetermined_terms(problem: Problem, best: Estimate) -> list[str]:
    """A note if the rows do not determine as many Prony terms: where one of them may have any time or no share, the
    others lie in a flat valley, and are wrong by more than their intervals say if the noise is not normal."""
    count = int(problem.kind.partition(":")[2] or 0)
    terms = problem.parameters[len(problem.law.parameters) :]
    names = [p.name for p in terms if best.is_open(p)]
    if count < 2 or best.withheld or not names:
        return []
    return [
        f"the rows do not determine {count} Prony terms: {', '.join(names)} may lie at a limit of the search, and all "
        f"terms depend on it; fit fewer: --relaxation prony:{count - 1}"
    ]


def few_rows_with_gain(problem: Problem, best: Estimate) -> list[str]:
    """A note if the noise grows with the force and its correlation, which the intervals depend on, is not known."""
    if not _gain_of_few_rows(problem, best):
        return []
    return [
        "the noise grows with the force, and too few rows in contact show whether its errors are independent: the "
        "intervals may be too narrow. Record more rows in contact"
    ]


def _gain_of_few_rows(problem: Problem, best: Estimate) -> bool:
    """Whether the noise of a press grows with the force, and too few rows in contact show its correlation."""
    return not problem.relative and any(
        gain(force * w, residual * w, len(problem.names)) is not None and in_contact(force * w).sum() < SURE_ROWS
        for force, residual, w in zip(best.pressed, best.residuals, problem.weight, strict=True)
    )


def include_rise(
    problem: Problem, best: Estimate, chances: dict[str, float]
) -> tuple[Problem, Estimate, list[str], list[str]]:
    """The problem, its estimate, and notes, with a rise of the force before contact in each press if the residuals
    show one: it is no misfit of the law. The second notes are those of intervals that were widened."""
    if chances.get(RISE, 1.0) > RARE:
        return problem, best, [], []
    risen = problem.with_changes(_with_rise(problem, best, True))
    if risen.count < LEAST_PER_UNKNOWN * len(risen.names):
        return problem, best, [], []
    # the touch point of a fit without the rise may lie far before that with it: another minimum
    better = estimate(risen, begin=[*from_minima(risen, best), *starts(risen)[:TOUCH_STARTS]])
    sizes = [better.number(f"rise, {press.name}")[0] for press in risen.presses]
    if max(map(abs, sizes)) > 99.0 * MOST_RISE:  # at its limit: the begin of a law of this shape
        return problem, best, [], []
    notes = [
        f"{press.name}: the force rises before contact, by {abs(size):.2g} % of the peak; an exponential rise was "
        "fitted with the parameters, which widens the intervals"
        for press in risen.presses
        for size in [better.number(f"rise, {press.name}")[0]]
        if press.rise
    ]
    return risen, better, notes, _allow_for_contact(risen, better)


def _allow_for_contact(risen: Problem, better: Estimate) -> list[str]:
    """Widen or withhold the intervals of a fit with a rise before contact if presses that touch from the first row on
    explain the forces as well: what looks like the rise is then the begin of the law. Returns a note."""
    touching = [
        replace(press, touch=float(press.depth.min()), slack=float(np.ptp(press.depth)), air=False, rise=None,
                drifts=False)
        for press in risen.presses
    ]  # fmt: skip
    other = risen.with_changes(touching)
    if len(other.names) >= len(risen.names):
        return []
    free = estimate(other)
    more, left = len(risen.names) - len(other.names), max(better.effective[0] - len(risen.names), 1.0)
    gained = max(free.squares / better.squares - 1.0, 0.0) * left / more
    if float(fisher.sf(gained, more, left)) < RARE:
        return []
    if free.is_open(risen.parameters[0]):
        better.withhold()
        return [
            "the rows do not distinguish a rise before contact from a press that touches from the first row on: no "
            "interval is given. Record rows before contact"
        ]
    for p in risen.parameters:
        now, its = better.intervals[p.name], free.intervals[p.name]
        now.low, now.high = min(now.low, its.low), max(now.high, its.high)
    return ["the press may touch from the first row on; the intervals include this"]


def with_smooth_factor(law: Law, reach: float) -> Law:
    """The law times exp(a sqrt(x) + b x), x = s/reach."""

    def force(values: Values, s: np.ndarray) -> np.ndarray:
        x = s / reach
        return law.force(values, s) * np.exp(values["bend_1"] * np.sqrt(x) + values["bend_2"] * x)

    return replace(law, parameters=(*law.parameters, *BEND), force=force)


def widen(problem: Problem, best: Estimate, chances: dict[str, float]) -> tuple[list[str], list[str]]:
    """Widen or withhold the intervals of a fit if the law misfits. Returns two lists of notes.

    chances  p-values of `shape_chances`

    The second list is for presses whose correlated noise may hide a misfit.
    """
    limit = SUSPECT if best.effective[0] < SMOOTH * problem.count else UNLIKELY
    reach = max(float(p.depth.max()) - t for p, t in zip(problem.presses, best.touches, strict=True))
    drifting = [replace(press, drifts=True) for press in problem.presses]
    others: dict[str, dict[str, Any]] = {
        DRIFT: {"presses": drifting}, BENT: {"law": with_smooth_factor(problem.law, reach)},
        RATE: {"kind": "hunt-crossley"},
    }  # fmt: skip
    # fit each shape that explains the residuals, from the minimum of the law; widen the intervals to include it
    notes, lost = [], True
    given = {p.name: replace(best.intervals[p.name]) for p in problem.parameters}
    if chances.get(RISE, 1.0) <= limit:
        others[RISE] = {"presses": _with_rise(problem, best, True)}
    for what, change in others.items():
        if chances.get(what, 1.0) > limit:
            continue
        other = problem.with_changes(**change)
        if other.count < LEAST_PER_UNKNOWN * len(other.names):
            continue
        free = estimate(other, profiles=False, begin=from_minima(other, best))
        moved = []
        for p in problem.parameters:
            now, its = best.intervals[p.name], free.intervals[p.name]
            if max(given[p.name].low - its.low, its.high - given[p.name].high) > HARMLESS * abs(now.value):
                moved.append(f"{p.name} {its.value:.4g}")
            now.low, now.high = min(now.low, its.low), max(now.high, its.high)
        lost = lost and shape_chances(other, free)[BLOCKS] < RARE
        if moved:
            notes.append(f"with {what} it fits better and gives {', '.join(moved)}")
    # report, and withhold the interval if it spans too much or no shape explains the residuals
    if not notes and chances[BLOCKS] > RARE:
        return [], []
    text = "; ".join(notes) or "its residuals in contact are not only noise"
    first = best.intervals[problem.parameters[0].name]
    sure = chances[BLOCKS] <= RARE or min(chances[what] for what in chances if what != BLOCKS) <= UNLIKELY
    if sure and (first.low <= 0.0 or first.high / first.low > WITHHELD or lost):
        best.withhold()
        text += ". No interval is given: no single value fits the whole curve"
    else:
        text += ". The intervals were widened to include these"
    if sure:
        return [f"law {problem.law.name} misfits: {text}. Try another law (--compare), thickness, or --relaxation"], []
    few, count = best.effective
    return [], [
        f"law or noise: the residuals are correlated ({few:.0f} of {count} count as independent), which may hide a "
        f"misfit of law {problem.law.name}; {text}"
    ]


def shape_chances(problem: Problem, best: Estimate) -> dict[str, float]:
    """p-value of each alternative shape of the force, from the residuals of a fit.

    The shapes are small changes: a linear baseline, a smooth factor on the law, a factor that depends on the rate, and
    a shift of each block of rows in contact.
    """
    columns: dict[str, list[np.ndarray]] = {}
    blocks = max(2, min(BLOCKS_MOST, problem.count // (10 * len(problem.presses))))
    for i, (press, touch, w) in enumerate(zip(problem.presses, best.touches, problem.weight, strict=True)):
        x = np.maximum(press.depth - touch, 0.0)
        x, force = x / max(float(x.max()), 1e-300), best.pressed[i] * w
        pressed = np.flatnonzero(x > 0.0)
        shapes: dict[str, list[np.ndarray]] = {BENT: [force * np.sqrt(x), force * x], DRIFT: [w * press.elapsed]}
        if problem.kind == "none" and press.time is not None:
            shapes[RATE] = [force * press.rate]
        if rises := _rises(press, touch):
            shapes[RISE] = [w * column for _, column in rises]
        shapes[BLOCKS] = [w * np.isin(np.arange(len(x)), rows) for rows in np.array_split(pressed, blocks)]
        for what in {*shapes, *columns}:
            each = np.stack(shapes[what], axis=1) if what in shapes else np.zeros((len(x), 0))
            columns.setdefault(what, [np.zeros((len(p.depth), 0)) for p in problem.presses[:i]]).append(each)
    shared = {BENT: np.concatenate, RATE: np.concatenate}
    groups = {what: shared.get(what, lambda each: block_diag(*each))(each) for what, each in columns.items()}
    weighted = [r * w for r, w in zip(best.residuals, problem.weight, strict=True)]
    jacobian = problem.jacobian(best.at)
    chances = lack_of_fit(*_evened(problem, best, weighted, jacobian, groups), EXACT)
    if any(press.step for press in problem.presses):  # rounding is no misfit
        residual, own = np.concatenate(weighted), _basis(jacobian)
        for what, table in groups.items():
            basis = _basis(table - own @ (own.T @ table))
            if float(np.sum((basis.T @ residual) ** 2)) < ROUNDED * float(
                problem.residual_variance(basis.T, best.fitted).sum()
            ):
                chances[what] = 1.0
    return chances


def _evened(
    problem: Problem, best: Estimate, weighted: list[np.ndarray], jacobian: np.ndarray, groups: dict[str, np.ndarray]
) -> tuple[list[np.ndarray], np.ndarray, dict[str, np.ndarray]]:
    """Residuals, Jacobian and groups of columns; where the noise grows with the force, their rows are divided by its
    size, because the test assumes noise of one size."""
    sizes = []
    for force, residual, w in zip(best.pressed, weighted, problem.weight, strict=True):
        found = None if problem.relative else gain(force * w, residual, len(problem.names))
        size = np.ones(len(w)) if found is None else np.sqrt(np.diag(found[0]))
        sizes.append(size / math.sqrt(float(np.mean(size**2))))
    rows = np.concatenate(sizes)[:, None]
    even = [residual / size for residual, size in zip(weighted, sizes, strict=True)]
    return even, jacobian / rows, {name: columns / rows for name, columns in groups.items()}


def _rises(press: MeasuredPress, touch: float) -> list[tuple[float, np.ndarray]]:
    """Lengths [m] and shapes (n,) of exponential rises before contact; none without rows there."""
    away = touch - float(press.depth.min())
    if int((press.depth < touch).sum()) < LEAST_AIR:
        return []
    return [
        (share * away, np.exp(np.minimum(press.depth - touch, 0.0) / (share * away))) for share in LENGTHS
    ]  # fmt: skip


def _with_rise(problem: Problem, best: Estimate, free: bool) -> list[MeasuredPress]:
    """The presses with the rise before contact that explains most of their residuals. `free`: its length is an unknown
    of the fit, which only a rise that the residuals show determines."""
    out = []
    jacobian, at = problem.jacobian(best.at), 0
    for press, touch, residual, w in zip(problem.presses, best.touches, best.residuals, problem.weight, strict=True):
        own = _basis(jacobian[at : at + len(w)])
        at += len(w)
        if press.rise:
            out.append(press)
            continue
        gains = []
        for length, column in _rises(press, touch):
            rest = w * column - own @ (own.T @ (w * column))
            gains.append((float(rest @ (residual * w)) ** 2 / max(float(rest @ rest), 1e-300), length))
        away = touch - float(press.depth.min())
        out.append(replace(press, rise=Rise(max(gains)[1], away, free)) if gains else press)
    return out


def _basis(columns: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, k) of the space of columns."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, sizes, _ = np.linalg.svd(scaled, full_matrices=False)
    return basis[:, sizes > 1e-9 * sizes[0]]
