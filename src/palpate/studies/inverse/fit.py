"""Fits parameters of a graph to recordings, with intervals, and says which of them the motion does not determine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.stats import t as student

from palpate.gradients.parameters import Parameter, find_parameter
from palpate.launch.load.checks.ideal import describe_jumps
from palpate.models.fit.tissue.estimate import INDISTINGUISHABLE, LEVEL, Estimate, estimate
from palpate.models.fit.tissue.residuals import inflation
from palpate.physics.errors import ArgumentError
from palpate.studies.inverse.descent import Point
from palpate.studies.inverse.measured import Measured
from palpate.studies.inverse.priors import read_priors
from palpate.studies.inverse.problem import FAILED, RunProblem
from palpate.studies.inverse.profiles import WIDEST, widen_to_profiles

STARTS = 3
LOOSE = 1e-3  # [m] Scale of the uncertain zero of a motion
ROUGH, LINEAR = 1e-2, 0.25
"""[1] Decrease of the sum of squares, over it, by a further step, below which a search for the best minimum ends; error
of the linear model of a minimum, over the change of the residuals, below which a point leads to this minimum."""
CLOSER, SAME, WEIGHED = 1e-3, 0.02, 4
"""[1] The same decrease while the weights of the fields are found; their change below which they are; rounds."""
FEW = 12  # runs from a start that is not the best one
ALIKE = 1.05  # [1] Sum of squares over the least one up to which two minima count as one
NO_EFFECT = 1e-9  # [1] Derivative over the peak of the fields, per scale of a parameter, below which it has none


@dataclass
class RunFit:
    """Result of a fit.

    parameters  numbers of the graph;  estimate  their values with intervals, see `models.fit.tissue.estimate`
    open_       by name, why a parameter is not determined
    couples     names of two parameters that cannot be distinguished, and their correlation
    measured    the recordings;  rms  [unit of the field] of the residuals of each field
    runs        number of runs that the fit has computed
    notes       lines for the user
    """

    parameters: list[Parameter]
    estimate: Estimate
    open_: dict[str, str]
    couples: list[tuple[str, str, float]]
    measured: list[Measured]
    rms: dict[str, float]
    held_out: dict[str, float]
    runs: int
    notes: list[str]
    jacobian: np.ndarray


def fit_run(
    measured: Sequence[Measured], free: Sequence[str], separate: Sequence[str] = (), held_out: Sequence[Measured] = (),
    starts: int = STARTS, scale: dict[str, float] | None = None, priors: Sequence[str] = (),
    report: Callable[[float], None] = lambda share: None,
) -> RunFit:  # fmt: skip
    """Fit parameters to recordings by bounded least squares from several starts.

    free    paths of the parameters;  separate  those with a value for each recording
    priors  of parameters, "tissue.stiffness=normal:200,30", see `priors.read_priors`
    report  called with shares of the work that are done

    ArgumentError, GraphError: a parameter or a recording does not fit.
    """
    loose = list(dict.fromkeys(path for each in measured for path in each.loose if path not in free))
    parameters = find_parameters(measured[0], [*free, *loose], dict.fromkeys(loose, LOOSE) | (scale or {}))
    separate = [*separate, *loose]
    if unknown := [path for path in separate if path not in (*free, *loose)]:
        raise ArgumentError(f"--each {unknown[0]}: expected one of the free parameters: {', '.join(free)}")
    known = read_priors(priors, parameters, measured[0].launch.load()) if priors else {}
    problem = RunProblem(measured, parameters, separate)
    try:
        found, agreeing = _search(problem, starts, report)
        found = problem.believe(known, _weigh(problem, found))
        ends = [problem.settle(found)]
        if problem.priors:
            x = problem.priors.middles(found.x)
            ends.append(problem.settle(Point(x, problem.residuals(x), found.slopes, False)))
        best = problem.minimum = min(ends, key=lambda each: each.squares)
        report(0.2)
        fitted = estimate(problem, profiles=False, begin=[best.x])
        fitted.starts = agreeing
        slopes = best.slopes[: problem.count]
        alone = problem.priors.combine(fitted, slopes) if problem.priors else []
        widen_to_profiles(problem, fitted, best)
        report(0.15)
        open_ = _open(problem, fitted, slopes)
        rms = _rms(problem, fitted)
        others = _held_out(problem, held_out, fitted)
        return RunFit(
            parameters, fitted, open_, _couples(fitted, open_), list(measured), rms, others,
            sum(each.count for each in problem.forward), [*alone, *_notes(problem, fitted)], slopes,
        )  # fmt: skip
    finally:
        problem.close()


def _search(problem: RunProblem, starts: int, report: Callable[[float], None]) -> tuple[Point, float]:
    """The best minimum that the search reaches from several starts, roughly, and the share of the starts that do.

    Further starts begin with the derivatives of the best minimum, and end where its linear model explains their
    residuals: from there the search would reach it.
    """
    begins, search = problem.begins(starts), problem.descent
    if (begins[0].r == FAILED).all():
        raise ArgumentError(f"all runs of the starts of the search fail: {problem.forward[0].failure}")
    best = search.run(search.renewed(begins[0]), ROUGH)
    report(0.6 / len(begins))
    ends = [best]
    for begin in begins[1:]:
        from_here = Point(begin.x, begin.r, best.slopes, False)
        ends.append(search.run(from_here, ROUGH, partial(_leads_to, best), True, FEW))
        best = min(best, ends[-1], key=lambda each: each.squares)
        report(0.6 / len(begins))
    return best, float(np.mean([_leads_to(best, end) for end in ends]))


def _weigh(problem: RunProblem, found: Point) -> Point:
    """A point nearer to the minimum with the weights that its residuals give to the fields."""
    found = problem.weigh(found)
    for _ in range(WEIGHED):
        before = [weight[0] for weight in problem.weight]
        found = problem.weigh(problem.descent.run(found, CLOSER))
        if all(abs(weight[0] / old - 1.0) < SAME for weight, old in zip(problem.weight, before, strict=True)):
            break
    return found


def _leads_to(best: Point, at: Point) -> bool:
    """Whether residuals at a point are those of the linear model of a minimum."""
    apart = at.r - best.r
    rest = apart - best.slopes @ (at.x - best.x)
    linear = float(rest @ rest) <= LINEAR**2 * float(apart @ apart)
    return at.squares >= best.squares and (linear or at.squares <= ALIKE * best.squares)


def find_parameters(measured: Measured, free: Sequence[str], scale: dict[str, float]) -> list[Parameter]:
    """The free parameters. ArgumentError: one cannot be fitted."""
    if not free or len(set(free)) < len(free):
        raise ArgumentError(
            f"--free: found {', '.join(free) or 'nothing'}, expected different settings: tissue.stiffness"
        )
    graph = measured.launch.load()
    before = measured.base.load().nodes
    for path in free:
        head = path.partition(".")[0]
        if head in before and head not in graph.nodes:
            raise ArgumentError(
                f"--free {path}: {head!r} does not run in this fit: no field of --to needs it, or the recorded motion "
                f"takes its place. Nodes with settings to fit: {', '.join(graph.nodes)}"
            )
    running = {name for name, spec in graph.nodes.items() if spec.off is None and not spec.observer}
    if jumps := describe_jumps(graph, running):
        raise ArgumentError(f"a fit needs results that do not jump: {jumps}")
    return [find_parameter(graph, path, running, scale.get(path)) for path in free]


def _open(problem: RunProblem, fitted: Estimate, slopes: np.ndarray) -> dict[str, str]:
    """Why parameters are not determined, by name."""
    found = {}
    quantile = float(student.ppf(0.5 + LEVEL / 2, fitted.effective[0] - len(fitted.at)))
    for i, p in enumerate(problem.parameters):
        scale = problem._scales()[i]
        believed = problem.priors is not None and problem.priors.known[i] is not None
        size = float(np.abs(slopes[:, i]).max()) * scale
        wide = quantile * float(fitted.errors[i]) / scale
        low, high = problem.bounds
        at_limit = min(fitted.at[i] - low[i], high[i] - fitted.at[i]) < 1e-4 * (high[i] - low[i])
        if size < NO_EFFECT and not believed:
            found[p.name] = "the motion has no effect of it"
        elif at_limit and not _is_limit(problem, i, fitted.at[i]):
            found[p.name] = f"the search ends at its bound, {p.value(fitted.at[i]):.4g} {p.unit}"
        elif not believed and (wide > WIDEST or (fitted.is_open(p) and not at_limit)):
            found[p.name] = f"its interval is as wide as {fitted.intervals[p.name].low:.3g} to " \
                            f"{fitted.intervals[p.name].high:.3g} {p.unit}"  # fmt: skip
    return found


def _is_limit(problem: RunProblem, i: int, at: float) -> bool:
    """Whether an unknown lies at a limit of its setting, not only of the search."""
    p = problem.parameters[i]
    number = next(
        n for places in problem.places for n, place in zip(problem.numbers, places, strict=True) if place == i
    )
    value = p.value(at)
    near = 1e-3 * number.scale
    return abs(value - number.low) < near or abs(value - number.high) < near


def _couples(fitted: Estimate, open_: dict[str, str]) -> list[tuple[str, str, float]]:
    names, found = fitted.names, []
    for i in range(len(names)):
        for j in range(i):
            if abs(fitted.correlation[i, j]) > INDISTINGUISHABLE and not {names[i], names[j]} & open_.keys():
                found.append((names[j], names[i], float(fitted.correlation[i, j])))
    return found


def _rms(problem: RunProblem, fitted: Estimate) -> dict[str, float]:
    """RMS of the residuals by recording and field."""
    return {
        press.name: float(np.sqrt(np.mean(r**2))) for press, r in zip(problem.presses, fitted.residuals, strict=True)
    }


def _held_out(problem: RunProblem, others: Sequence[Measured], fitted: Estimate) -> dict[str, float]:
    """RMS errors of the prediction of recordings that the fit has not seen, over their peaks."""
    found = {}
    for other in others:
        alone = RunProblem([other], problem.numbers)
        try:
            x = np.array([fitted.at[problem.places[0][k]] for k in range(len(problem.numbers))])
            for press, force in zip(alone.presses, alone.law_forces(x), strict=True):
                peak = float(np.abs(press.force).max()) or 1.0
                found[press.name] = float(np.sqrt(np.mean((force - press.force) ** 2))) / peak
        finally:
            alone.close()
    return found


def _notes(problem: RunProblem, fitted: Estimate) -> list[str]:
    """Lines about the residuals."""
    notes = []
    for press, r in zip(problem.presses, fitted.residuals, strict=True):
        peak = float(np.abs(press.force).max())
        tau = inflation([r], len(fitted.at))
        if tau > 20.0 and float(np.sqrt(np.mean(r**2))) > 1e-3 * peak:
            notes.append(
                f"{press.name}: residuals are correlated over {tau:.0f} rows: the noise is filtered, or the graph does "
                "not describe all of this recording; the intervals allow for it"
            )
        if press.step:
            notes.append(f"{press.name}: the field has steps of {press.step:.3g}, which the intervals allow for")
    return notes
