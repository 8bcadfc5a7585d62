"""`palpate fit tissue`: fit a material law to measured presses, with intervals and the limits of the data."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from palpate.models.fe.progress import Report, unheard
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue import checks
from palpate.models.fit.tissue.errors.hum import include_hum
from palpate.models.fit.tissue.estimate import INDISTINGUISHABLE, Estimate, Problem, estimate, widen_by_scatter
from palpate.models.fit.tissue.measured import LEAST_ROWS, STEEPEST, MeasuredPress, deepest_row, thin_press
from palpate.models.fit.tissue.mesh_error import include_mesh_error
from palpate.models.fit.tissue.plausible import check_units
from palpate.models.fit.tissue.relaxing import parameters
from palpate.models.fit.tissue.rigs import SHAPES, Law, Rig, closed_form
from palpate.models.fit.tissue.tabulated import check_tabulated, tabulate_law
from palpate.physics.contact.layer import thickness_factor

MIXED = 2.0
"""Ratio of the highest to the lowest stiffness of presses above which two indenters or specimens may be mixed."""
UNLOADED = 0.1  # [1] Indentation after unloading, over the largest one, up to which a press counts as unloaded
ELASTIC = 0.02  # [1] Dissipated share of the work below which a press counts as elastic
DRIFTS = ("curved", "linear", "none")
WIDER = 1.2  # [1] Ratio of the widths with and without a drifting zero above which the report lists both
EMPIRICAL = ("power", "exponential")
RANGES = 6  # Most turns in which touch points and the rows in the range of a law are found
WEAK = 0.5  # [1] Share of the force in the rows fitted below which a note follows


@dataclass
class TissueFit:
    """A law fitted to presses. `open_` lists what the data do not determine, `notes` other warnings."""

    rig: Rig
    law: Law
    relaxation: str
    presses: list[MeasuredPress]
    estimate: Estimate
    held_out: list[dict[str, Any]]
    sensitivity: dict[str, float]
    open_: list[str]
    notes: list[str]
    compared: list[dict[str, Any]] = field(default_factory=list)
    given: list[MeasuredPress] = field(default_factory=list)
    """The presses with all rows, including the excluded ones."""
    drift: str = "curved"
    """How the zero of the force may drift, one of `DRIFTS`."""
    steady: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Intervals of the parameters if the zero drifts less: without a curve, or not at all if `drift` is linear. Empty
    if no such fit was made."""

    @property
    def read(self) -> list[str]:
        """Which columns were read, and which lines were not."""
        return [text for p in self.given for text in p.remarks]

    @property
    def young(self) -> tuple[float, float, float] | None:
        """Young's modulus at rest with its interval [Pa]; None if the law has none."""
        young = self.estimate.intervals.get("young")
        return None if young is None else (young.value, young.low, young.high)

    @property
    def deepest(self) -> float:
        """Greatest indentation [m] of the presses."""
        return max(float(p.depth.max()) - t for p, t in zip(self.presses, self.estimate.touches, strict=True))

    def errors(self) -> dict[str, float]:
        """RMS residual [N] and relative to the peak [1]; largest relative error where the force exceeds 5 % of it."""
        return _errors(self.presses, self.estimate.fitted, self.estimate.pressed)


def fit_tissue(
    presses: Sequence[MeasuredPress],
    rig: Rig,
    name: str,
    relaxation: str = "none",
    *,
    held_out: Sequence[MeasuredPress] = (),
    compare: Sequence[str] = (),
    touch: bool = True,
    deepest: float = math.inf,
    drift: str = "curved",
    table: Law | None = None,
    report: Report = unheard,
) -> TissueFit:
    """Fit a law to presses of one specimen by one rig.

    compare   other laws, fitted to the same rows and ranked
    touch     whether to fit the touch point with the parameters; else it stays at its estimate from the force
    deepest   [m] deeper rows are excluded
    drift     how the zero of the force may drift in time: curved (quadratic), linear or none
    table     the law of this rig from `tabulated`, if it was computed before

    SessionError: a fault in the data, or an unknown law.
    """
    if name == "hunt-crossley":
        name, relaxation = "power", name
    check_laws(rig, (name, *compare), relaxation, drift)
    if len(several := dict.fromkeys(press.specimen for press in presses)) > 1:
        raise SessionError(f"presses of the specimens {', '.join(several)}: fit each alone (`several.by_specimen`)")
    # select the rows: loading only without relaxation, no saturation
    whole: list[MeasuredPress] = []
    notes: list[str] = []
    for press in presses:
        part, note = _rows_to_fit(press, relaxation, deepest)
        whole.append(replace(part, drifts=part.drifts and drift != "none"))
        notes += note
    reach = max(float(p.depth.max()) - p.touch for p in whole)
    law, more = (table, []) if table else _law(rig, name, relaxation, whole, touch, reach, report)
    notes += more
    # fit the rows in the range of the law, and widen the intervals
    problem = Problem(whole, law, relaxation, touch, rig.kind == "cylinder")  # its forces span decades
    problem, best, more = _fit_in_range(problem)
    notes += more + _weak(whole, problem.presses)
    problem, best, more = include_hum(problem, best)
    loaded = problem.presses
    notes += more
    problem, best, steady, hidden, more = _widen(problem, best, rig, drift)
    notes += more
    if law.finer is not None:
        notes.append(include_mesh_error(problem, best, steady))
    # prediction of held-out presses, sensitivity to fixed lengths, comparison of laws
    kept = [_rows_to_fit(press, relaxation, min(deepest, law.reach + press.touch))[0] for press in held_out]
    fitted = TissueFit(
        rig, law, relaxation, loaded, best, [], {}, [], notes, given=list(presses), drift=drift, steady=steady
    )
    fitted.held_out = [_predict_press(problem, best, press, fitted.deepest) for press in kept]
    fitted.sensitivity = _sensitivity(fitted, problem)
    fitted.open_ = hidden + _open(fitted)
    fitted.open_ += _drift(fitted)
    fitted.notes += check_units(rig, _peak(best.pressed), fitted.deepest)
    if compare:
        others = [_law(rig, one, relaxation, loaded, touch, reach, report)[0] for one in compare]
        fitted.compared = _compare_laws(fitted, [problem.with_changes(law=one) for one in others])
    return fitted


def _fit_in_range(problem: Problem) -> tuple[Problem, Estimate, list[str]]:
    """Fit the rows in the range of the law, measured from the fitted touch point. Returns the problem with these rows,
    the estimate, and notes. SessionError: the law finds no contact in them."""
    loaded, notes = _in_range(problem)
    problem = problem.with_changes(loaded)
    best = estimate(problem)
    if any(touched := [_begins_in_contact(best, press) for press in loaded]):
        loaded = [replace(p, air=False, drifts=False, slack=float(np.ptp(p.depth))) if begins else p
                  for p, begins in zip(loaded, touched, strict=True)]  # fmt: skip
        problem = problem.with_changes(loaded)
        best = estimate(problem)
    for press, at in zip(loaded, best.touches, strict=True):
        if not press.depth.max() > at:
            raise SessionError(
                f"{press.name}: law {problem.law.name} finds no contact in the {len(press.depth)} rows fitted: the "
                f"best touch point lies below the deepest of them, {1e3 * float(press.depth.max()):.4g} mm. Try "
                "--touch detected, another law (power and exponential have no range), or a greater --depth-limit"
            )
    return problem, best, notes


def _widen(
    problem: Problem, best: Estimate, rig: Rig, drift: str
) -> tuple[Problem, Estimate, dict[str, tuple[float, float]], list[str], list[str]]:
    """Include a rise before contact; widen the intervals by the scatter between presses and by lack of fit; withhold
    them where the law is invalid. Returns the problem, the estimate, the intervals without drift, what the data do not
    determine, and notes."""
    chances, without = checks.shape_chances(problem, best), problem
    notes, touching = list[str](), list[str]()
    if drift == "curved":
        problem, best, notes, touching = checks.include_rise(problem, best, chances)
        chances = chances if problem is without else checks.shape_chances(problem, best)
    widen_by_scatter(problem, best)
    misfits, hidden = checks.widen(problem, best, chances)
    notes += touching + checks.baselines(problem, best) + misfits + checks.few_rows_with_gain(problem, best)
    widened = bool(touching or misfits or hidden or len(problem.presses) > 1)
    steady, more = checks.allow_for_drift(problem, best, drift, widened)
    notes += more + checks.undetermined_terms(problem, best)
    if limited := _limited(problem.law, best):
        best.withhold()
        notes.append(limited)
    if rig.kind == "fingertip" and problem.kind != "none":
        best.withhold()
        notes.append(
            "the relaxation law does not describe a fingertip and a tissue in series, each with its damping: no "
            "interval is given. Fit the recording's indentation of the tissue: --rig ball"
        )
    return problem, best, steady, hidden, notes


def _in_range(problem: Problem) -> tuple[list[MeasuredPress], list[str]]:
    """The rows in the range of the law from the fitted touch points, and a note if deeper ones are excluded.

    Rows and touch points depend on each other. The first touch points are those of all rows: the estimates from the
    force alone may lie so early that all rows in contact would be excluded.
    """
    whole, law = problem.presses, problem.law
    if max(float(p.depth.max()) - p.touch + 2.0 * p.slack for p in whole) <= law.reach:
        return whole, []
    touches = estimate(problem, profiles=False).touches
    loaded, at = whole, touches
    for _ in range(RANGES):
        deep = [p.depth - t <= law.reach for p, t in zip(whole, at, strict=True)]
        kept = [p if rows.all() else p.part(rows) for p, rows in zip(whole, deep, strict=True)]
        if [len(p.depth) for p in kept] == [len(p.depth) for p in loaded] or min(
            len(p.depth) for p in kept
        ) < LEAST_ROWS:
            break
        loaded = kept
        at = estimate(problem.with_changes(loaded), profiles=False).touches
    found = max(float(p.depth.max()) - t for p, t in zip(whole, at, strict=True))
    if loaded is whole or found <= 1.02 * law.reach:
        return whole, []
    valid = f"law {law.name} is valid to {1e3 * law.reach:.3g} mm ({law.remark})"
    return loaded, [f"pressed {1e3 * found:.3g} mm, {valid}: the deeper rows are excluded"]


def _limited(law: Law, best: Estimate) -> str:
    """A note if a constant of an empirical law lies at the end of its range, so that no value is best; else ""."""
    for p in law.parameters[1:] if law.name in EMPIRICAL else ():
        if p.at_limit(best.values[p.name]):
            other = " or ".join(name for name in EMPIRICAL if name != law.name)
            return (
                f"{p.name} lies at the limit of its range, {best.values[p.name]:g}: the law {law.name} does not follow "
                f"the press, or the rows do not determine it, so no interval is given; try --law {other}"
            )
    return ""


def _begins_in_contact(best: Estimate, press: MeasuredPress) -> bool:
    """Whether the drift that a fit finds is as large as a press: then its rows before contact are in contact."""
    size, _ = best.number(f"drift, {press.name}")
    return abs(size) * 0.01 * float(np.abs(press.force).max()) > STEEPEST * float(np.ptp(press.force))


def _weak(whole: Sequence[MeasuredPress], loaded: Sequence[MeasuredPress]) -> list[str]:
    """A note for each press of which the rows fitted carry less than half of the force."""
    return [
        f"{part.name}: the rows fitted reach {float(part.force.max()):.3g} N of {float(press.force.max()):.3g} N: most "
        "of the force is excluded, and the result describes the first contact only"
        for press, part in zip(whole, loaded, strict=True)
        if np.ptp(part.force) < WEAK * np.ptp(press.force[: deepest_row(press.depth) + 1])
    ]


def _compare_laws(fit: TissueFit, others: Sequence[Problem]) -> list[dict[str, Any]]:
    """Each law with its number of unknowns k, its error, and the difference of its AICc from the lowest,

        AICc = n ln(SSR/N) + 2 k + 2 k (k + 1)/(n - k - 1),

    for N rows and n independent residuals, the lowest number of any law. SessionError: a law is not valid at the
    deepest rows.
    """
    reach = fit.deepest
    found = [(fit.law.name, fit.estimate)]
    for other in others:
        if other.law.reach < 0.98 * reach:
            raise SessionError(
                f"--compare: {other.law.name} is valid to {1e3 * other.law.reach:.3g} mm, the presses go to "
                f"{1e3 * reach:.3g} mm; --depth-limit excludes deeper rows"
            )
        found.append((other.law.name, estimate(other, profiles=False)))
    n = min(best.effective[0] for _, best in found)
    rows: list[dict[str, Any]] = []
    for name, best in found:
        k = len(best.names)
        aicc = n * math.log(max(best.squares, 1e-300)) + 2 * k + 2 * k * (k + 1) / max(n - k - 1, 1e-9)
        errors = _errors(fit.presses, best.fitted, best.pressed)
        rows.append({"law": name, "numbers": k, "rms_of_peak": errors["rms_of_peak"], "aicc": aicc})
    least = min(row["aicc"] for row in rows)
    return [{**row, "aicc": row["aicc"] - least} for row in rows]


def _rows_to_fit(press: MeasuredPress, relaxation: str, deepest: float) -> tuple[MeasuredPress, list[str]]:
    """The rows to fit, without saturation and, without relaxation, of the loading only; and notes on excluded rows."""
    keep = press.depth - press.touch <= deepest
    notes = []
    limit = checks.plateau(press, relaxation != "none")
    if limit is not None:
        begin, end = 1e3 * press.depth[limit], 1e3 * press.depth.max()
        notes.append(
            f"{press.name}: the force stays near {press.force[limit] + press.zero:.3g} N while the indentation rises "
            f"from {begin:.3g} to {end:.3g} mm: a saturated sensor, or a material that yields. The rows from this "
            "indentation on are excluded"
        )
        keep &= np.arange(len(keep)) < limit
    top = last = deepest_row(np.where(keep, press.depth, float(press.depth.min())))
    cycle = checks.last_cycle(press, top) if relaxation == "none" else 0
    loaded = checks.end_of_loading(press, cycle, top) if relaxation == "none" else top
    if loaded < top:
        begin, end = 1e3 * press.depth[loaded], 1e3 * press.depth[top]
        notes.append(
            f"{press.name}: the force is held while the indenter creeps from {begin:.3g} to {end:.3g} mm: these rows "
            "are excluded; --relaxation fits them"
        )
        top = loaded
    if relaxation == "none" and top < len(press.depth) - 1:
        after = np.arange(len(press.depth)) > top
        lost = int(keep[last + 1 :].sum())
        if lost > 2:
            notes.append(
                f"{press.name}: {lost} rows after the deepest are excluded; {_hysteresis(press, top)}; --relaxation "
                "fits all rows"
            )
        keep &= ~after
    if cycle:
        notes.append(f"{press.name}: {cycle} rows of earlier cycles are excluded; --relaxation fits all rows")
        keep &= np.arange(len(press.depth)) >= cycle
    part = press.part(keep)
    if len(part.depth) < LEAST_ROWS or not (part.depth > part.touch).any():
        raise SessionError(f"{press.name}: fewer than {LEAST_ROWS} rows remain to fit")
    return thin_press(part), notes  # of these rows only: else few averages would remain of a short loading


def _hysteresis(press: MeasuredPress, top: int) -> str:
    """Dissipated share of the work of loading; it exists only if the press unloads to the depth of first contact."""
    reach, back = float(press.depth[top]) - press.touch, press.depth[top:]
    work = float(np.trapezoid(press.force[: top + 1], press.depth[: top + 1]))
    if float(back.min()) - press.touch > UNLOADED * reach or work <= 0.0:
        return "they do not unload to the touch point, so the hysteresis is unknown"
    loop = work + float(np.trapezoid(press.force[top:], back))
    if loop > work:
        return "the force is negative while they unload (adhesion, or a zero that drifts), so the hysteresis is unknown"
    if loop < -ELASTIC * work:
        return "the force is larger while they unload (a zero that drifts), so the hysteresis is unknown"
    if loop < ELASTIC * work:
        return f"loading and unloading agree, hysteresis dissipates less than {100 * ELASTIC:g} % of the work"
    return (f"hysteresis dissipates {100 * loop / work:.0f} % of the work, so the parameters are valid at this rate "
            "only")  # fmt: skip


def check_laws(rig: Rig, names: Sequence[str], relaxation: str, drift: str = "curved") -> None:
    """SessionError: the rig does not support a law or lacks a length, or the relaxation or the drift is unknown."""
    if drift not in DRIFTS:
        raise SessionError(f"--drift: found {drift!r}, expected {', '.join(DRIFTS)}")
    for name in names:
        if _in_table(rig, name):
            check_tabulated(rig, name)
        else:
            closed_form(rig, name)
    parameters(relaxation, 1.0)


def _in_table(rig: Rig, name: str) -> bool:
    """Whether a law of a rig has no closed form: rubber under a ball or between bonded plates."""
    rubber = name in SHAPES and name != "linear"
    return rubber and (rig.kind == "ball" or (rig.kind == "cylinder" and rig.plates == "bonded"))


def _law(
    rig: Rig, name: str, relaxation: str, loaded: list[MeasuredPress], touch: bool, reach: float, report: Report
) -> tuple[Law, list[str]]:
    """The law in closed form, or tabulated by finite elements; and notes.

    The table of a cylinder with bonded plates is centred on the shape parameter that frictionless plates give.
    """
    if not _in_table(rig, name):
        return closed_form(rig, name), []
    if rig.kind == "cylinder":
        first = replace(rig, plates="frictionless")
        rough = estimate(Problem(loaded, closed_form(first, name), relaxation, touch, True), profiles=False)
        middle = next((rough.values[p.name] for p in SHAPES[name]), None)
        note = f"with frictionless plates young is {rough.values['young']:.4g} Pa: the true value is between the two"
        return tabulate_law(rig, name, reach, middle, report=report), [note]
    return tabulate_law(rig, name, reach, count=6, report=report), []


def _errors(
    presses: Sequence[MeasuredPress], forces: Sequence[np.ndarray], pressed: Sequence[np.ndarray],
    peak: float | None = None,
) -> dict[str, float]:  # fmt: skip
    """Errors of forces, relative to a peak [N]; by default the largest force of the law. `pressed` are the forces of
    the law alone, without the zero of the sensor."""
    off = np.concatenate([f - p.force for f, p in zip(forces, presses, strict=True)])
    peak = _peak(pressed) if peak is None else peak
    force = np.concatenate(pressed)
    large = force > 0.05 * peak
    rms = float(np.sqrt(np.mean(off**2)))
    return {
        "rms": rms,
        "rms_of_peak": rms / peak,
        "worst_of_force": float(np.abs(off[large] / force[large]).max(initial=0.0)),
    }


def _peak(pressed: Sequence[np.ndarray]) -> float:
    return max(float(force.max()) for force in pressed)


def _predict_press(problem: Problem, best: Estimate, press: MeasuredPress, deepest: float) -> dict[str, Any]:
    """The force on a held-out press: the parameters stay, its touch point and baseline are fitted.

    Errors are those within the fitted indentation [m], over the peak of the fitted presses, so that they compare with
    those of the fit; `beyond` has those of deeper rows, which are extrapolated.
    """
    alone = problem.with_changes([press])
    x, count = alone.start(), len(problem.parameters)
    x[:count] = [p.to_search(best.values[p.name]) for p in problem.parameters]
    if len(x) > count:
        ends = [side[count:] for side in alone.bounds]
        x[count:] = least_squares(lambda rest: alone.residuals(np.r_[x[:count], rest]), x[count:], bounds=ends).x
    (forces,), (pressed,), touch, peak = alone.forces(x), alone.law_forces(x), alone.touches(x)[0], _peak(best.pressed)
    inside = press.depth - touch <= deepest * (1.0 + 1e-9)
    beyond = None if inside.all() else _errors([press.part(~inside)], [forces[~inside]], [pressed[~inside]], peak)
    if beyond is not None:
        beyond["rows"] = int((~inside).sum())
    within = _errors([press.part(inside)], [forces[inside]], [pressed[inside]], peak)
    return {"press": press.name, **within, "beyond": beyond,
            "depth": float(press.depth.max()), "curve": (press.depth - touch, press.force, forces)}  # fmt: skip


def _sensitivity(fit: TissueFit, problem: Problem) -> dict[str, float]:
    """Change of the first parameter [%] if a fixed length is 1 % larger, or Poisson's ratio 0.01 lower."""
    if fit.law.finer is not None:
        return {}
    first = fit.estimate.parameters[0].name
    out = {}
    for key in fit.law.fixed:
        if key not in ("radius", "height", "poisson") or (key == "poisson" and fit.rig.kind == "cylinder"):
            continue
        now = getattr(fit.rig, key)
        other = replace(fit.rig, **{key: now - 0.01 if key == "poisson" else 1.01 * now})
        moved = problem.with_changes(law=closed_form(other, fit.law.name))
        x = moved.start()
        x[: len(moved.parameters)] = [p.to_search(fit.estimate.values[p.name]) for p in moved.parameters]
        solved, _ = moved.solve(x)
        out[key] = 100.0 * (moved.values(solved)[first] / fit.estimate.values[first] - 1.0)
    return out


def _open(fit: TissueFit) -> list[str]:
    """Limits of the data: undetermined quantities, one sentence each."""
    best, notes = fit.estimate, []
    reach = fit.deepest
    what, size = ("height", fit.rig.height or 1.0) if fit.rig.kind == "cylinder" else ("radius", fit.rig.radius)
    deep = f"pressed {1e3 * reach:.3g} mm, {reach / size:.2g} of the {what}"
    length = max((float(np.ptp(p.time)) for p in fit.presses if p.time is not None), default=0.0)
    # parameters whose profile has no end on one side or both
    for p in best.parameters:
        interval = best.intervals[p.name]
        low, high = interval.profile
        if p.name.startswith(("time_", "retardation")) and (interval.value > 0.5 * length or math.isnan(high)):
            least = interval.value if math.isnan(low) else low
            notes.append(f"{p.name}: the record of {length:.3g} s is too short for it; it is above {least:.3g} s, and "
                        "its share is not determined")  # fmt: skip
        elif math.isnan(low) and math.isnan(high):
            notes.append(f"{p.name}: not determined, any value from {p.low:g} to {p.high:g} fits ({deep})")
        elif math.isnan(low) or math.isnan(high):
            known = f"above {low:.3g}" if math.isnan(high) else f"below {high:.3g}"
            notes.append(f"{p.name}: only {known} {p.unit} is certain ({deep})")
        elif p.name == "alpha" and low < 2.0 < high:
            notes.append(f"alpha: from {low:.3g} to {high:.3g}, which includes the 2 of the neo-Hooke law: the data "
                        f"show no stiffening ({deep})")  # fmt: skip
    # parameters that the data or the rig cannot distinguish
    names = best.names
    for i in range(len(names)):
        for j in range(i):
            if abs(best.correlation[i, j]) > INDISTINGUISHABLE:
                notes.append(f"{names[j]} and {names[i]} cannot be distinguished: correlation "
                            f"{best.correlation[i, j]:.3f}")  # fmt: skip
    if fit.young is not None and fit.rig.kind != "cylinder":
        notes.append(f"young and poisson: a press determines only E/(1 - nu²); nu was fixed at {fit.rig.poisson:g}")
    if fit.law.name == "hertz" and fit.rig.kind == "ball":
        notes.append(_thickness(fit.rig, reach))
    if fit.rig.kind == "cylinder":
        notes.append("young and the friction of the plates: fit with --plates frictionless and bonded; the true value "
                    "is between the two")  # fmt: skip
    # mixed specimens, local minima
    if len({p.name for p in fit.presses}) > 1 and (values := best.intervals[best.parameters[0].name].presses):
        ratio = max(values) / min(values)
        if ratio > MIXED:
            notes.append(f"the presses differ {ratio:.2g} times in {best.parameters[0].name}: are two indenters or two "
                        "specimens mixed?")  # fmt: skip
    if best.starts < 0.5:
        notes.append(
            f"only {100 * best.starts:.0f} % of the starts converged to this minimum: others are nearly as good"
        )
    return notes


def _drift(fit: TissueFit) -> list[str]:
    """How much narrower the intervals are without the drift of the zero that they allow for, if that matters."""
    wider = [
        f"{name} {low:.4g} to {high:.4g}"
        for name, (low, high) in fit.steady.items()
        for now in [fit.estimate.intervals[name]]
        if now.high - now.low > WIDER * (high - low)
    ]
    if not wider or fit.estimate.withheld:
        return []
    what = "along a curve" if fit.drift == "curved" else "linearly"
    lines = fit.drift == "curved" and all(press.drifts for press in fit.presses)
    less, option = ("at most linearly", "linear") if lines else ("not at all", "none")
    return [f"the zero of the force: it may drift {what}, unseen below the press, and the intervals allow for it. If "
            f"you know that it drifts {less} (--drift {option}), they are {', '.join(wider)}"]  # fmt: skip


def _thickness(rig: Rig, deepest: float) -> str:
    """The least thickness for Hertz's law, and the error of young if the tissue is thinner."""
    factor, across = thickness_factor(rig.poisson), math.sqrt(rig.radius * deepest)
    chi = np.linspace(0.0, float(factor.x[-1]), 1000)
    least = across / float(np.interp(0.1, factor(chi) - 1.0, chi))
    if rig.height and rig.height < least:
        more = 100.0 * (float(factor(min(across / rig.height, float(factor.x[-1])))) - 1.0)
        return (f"young and the thickness: hertz ignores --height, and a bonded layer of {1e3 * rig.height:.3g} mm is "
                f"{more:.0f} % stiffer at the deepest row than the half-space; fit --law layer")  # fmt: skip
    return (f"young and the thickness: hertz is the law of a half-space; a layer bonded to a stiff ground and thinner "
            f"than {1e3 * least:.3g} mm is more than 10 % stiffer at the deepest row, and young too high by as much: "
            "fit --law layer with --height")  # fmt: skip
