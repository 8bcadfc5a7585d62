"""What `palpate fit tissue` does: presses in, parameters with their intervals, and what the data leave open."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from palpate.models.fe.progress import Report, unheard
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue import checks
from palpate.models.fit.tissue.estimate import ALIKE, Estimate, Problem, between, estimate
from palpate.models.fit.tissue.measured import LEAST_ROWS, Press
from palpate.models.fit.tissue.relaxing import parameters
from palpate.models.fit.tissue.rigs import SHAPES, Law, Rig, closed_form
from palpate.models.fit.tissue.tables import REFERENCE, check_tabulated, curve, tabulated
from palpate.physics.contact.layer import thickness_factor

MIXED = 2.0
"""Ratio of the greatest to the least stiffness of presses from which two indenters or specimens may be mixed."""
FINE = 14
"""Elements across of the press that checks the table's mesh."""


@dataclass
class Fit:
    """A law fitted to presses. `open_` says what the data cannot tell, `notes` what else a reader must know."""

    rig: Rig
    law: Law
    relaxation: str
    presses: list[Press]
    estimate: Estimate
    held_out: list[dict[str, Any]]
    sensitivity: dict[str, float]
    open_: list[str]
    notes: list[str]
    compared: list[dict[str, Any]] = field(default_factory=list)
    given: list[Press] = field(default_factory=list)
    """The presses with the rows that were left out."""

    @property
    def young(self) -> tuple[float, float, float] | None:
        """Young's modulus at rest with its interval [Pa]; None where the law has none."""
        own = self.estimate.intervals.get("young")
        return None if own is None or self.law.rest is None else (own.value, own.low, own.high)

    @property
    def deepest(self) -> float:
        """Greatest indentation [m] of the presses."""
        return max(float(p.depth.max()) - t for p, t in zip(self.presses, self.estimate.touches, strict=True))

    def errors(self) -> dict[str, float]:
        """RMS residual [N] and over the peak [1], the greatest over the force where that is above 5 % of the peak."""
        return _errors(self.presses, self.estimate.fitted)


def fit_tissue(
    presses: Sequence[Press],
    rig: Rig,
    name: str,
    relaxation: str = "none",
    *,
    held_out: Sequence[Press] = (),
    compare: Sequence[str] = (),
    touch: bool = True,
    relative: bool | None = None,
    deepest: float = math.inf,
    report: Report = unheard,
) -> Fit:
    """Fit a law to presses of one rig.

    compare   other laws, fitted to the same rows and ranked
    touch     whether the touch point is found with the parameters, or kept where the force shows it
    relative  weigh residuals by the force; None: for a cylinder, whose forces span decades
    deepest   [m] rows beyond are left out

    SessionError: what is wrong with the data, or no such law.
    """
    relative = rig.kind == "cylinder" if relative is None else relative
    if name == "hunt-crossley":
        name, relaxation = "power", name
    loaded: list[Press] = []
    notes: list[str] = []
    for press in presses:
        part, note = _kept(press, relaxation, deepest)
        loaded.append(part)
        notes += note
    reach = max(float(p.depth.max()) - p.touch for p in loaded)
    law, more = _law(rig, name, relaxation, loaded, touch, relative, reach, report)
    notes += more
    whole = loaded

    def made(some: Sequence[Press]) -> Problem:
        return Problem(some, law, relaxation, touch, relative)

    loaded = [p.part(p.depth - p.touch <= 1.02 * law.reach) for p in whole]
    problem = made(loaded)
    best = estimate(problem)
    slack = max(2.0 * best.number(f"touch, {p.name}")[1] * p.slack for p in loaded)
    found = max(float(p.depth.max()) - t for p, t in zip(whole, best.touches, strict=True))
    if min(reach, found - slack) > 1.02 * law.reach:  # by the force alone, and by the touch point that was fitted
        notes.append(f"pressed {1e3 * found:.3g} mm, law {law.name} is valid to {1e3 * law.reach:.3g} mm "
                     f"({law.remark}): the deeper rows are left out")  # fmt: skip
        loaded = [p.part(p.depth - t <= law.reach) for p, t in zip(whole, best.touches, strict=True)]
        problem = made(loaded)
        best = estimate(problem)
    between(problem, made, best)
    misfits, hidden = checks.widen(problem, best)
    notes += checks.baselines(problem, best) + misfits
    if rig.kind == "fingertip" and relaxation != "none":
        best.withhold()
        notes.append(
            "the law that relaxes is not that of a fingertip and a tissue in series, each with its own damping: no "
            "interval is given. Fit the recording's indentation of the tissue: --rig ball"
        )
    kept = [_kept(press, relaxation, min(deepest, law.reach + press.touch))[0] for press in held_out]
    fitted = Fit(rig, law, relaxation, loaded, best, [], {}, [], notes, given=list(presses))
    fitted.held_out = [_predicted(problem, best, press) for press in kept]
    fitted.sensitivity = _sensitivity(fitted, made)
    fitted.open_ = hidden + _open(fitted)
    if "finite elements" in law.remark:
        fitted.notes.append(_mesh_error(fitted))
    if compare:
        others = [_law(rig, one, relaxation, loaded, touch, relative, reach, report)[0] for one in compare]
        fitted.compared = _compared(fitted, [Problem(loaded, one, relaxation, touch, relative) for one in others])
    return fitted


def _compared(fit: Fit, others: Sequence[Problem]) -> list[dict[str, Any]]:
    """Each law with its numbers to find, its error, and by how much its AICc is above the least,

        AICc = n ln(SSR/N) + 2 k + 2 k (k + 1)/(n - k - 1),

    n the least number of independent residuals that any of the laws leaves, of N rows. SessionError: one does not hold
    as deep as the rows go.
    """
    reach = fit.deepest
    found = [(fit.law.name, fit.estimate)]
    for other in others:
        if other.law.reach < 0.98 * reach:
            raise SessionError(
                f"--compare: {other.law.name} holds to {1e3 * other.law.reach:.3g} mm, the presses go to "
                f"{1e3 * reach:.3g} mm; --depth-limit leaves deeper rows out"
            )
        found.append((other.law.name, estimate(other, profiles=False)))
    n = min(best.effective[0] for _, best in found)
    rows: list[dict[str, Any]] = []
    for name, best in found:
        k = len(best.names)
        aicc = n * math.log(max(best.squares, 1e-300)) + 2 * k + 2 * k * (k + 1) / max(n - k - 1, 1e-9)
        errors = _errors(fit.presses, best.fitted)
        rows.append({"law": name, "numbers": k, "rms_of_peak": errors["rms_of_peak"], "aicc": aicc})
    least = min(row["aicc"] for row in rows)
    return [{**row, "aicc": row["aicc"] - least} for row in rows]


def _kept(press: Press, relaxation: str, deepest: float) -> tuple[Press, list[str]]:
    """The rows that a law is fitted to: without relaxation those of the loading alone."""
    keep = press.depth - press.touch <= deepest
    notes = []
    limit = checks.plateau(press, relaxation != "none")
    if limit is not None:
        begin, end = 1e3 * press.depth[limit], 1e3 * press.depth.max()
        notes.append(
            f"{press.name}: the force stays near {press.force[limit] + press.zero:.3g} N while the indentation rises "
            f"from {begin:.3g} to {end:.3g} mm: a saturated sensor, or a material that yields. The rows from there on "
            "are left out"
        )
        keep &= np.arange(len(keep)) < limit
    top = int(np.argmax(np.where(keep, press.depth, -np.inf)))
    if relaxation == "none" and top < len(press.depth) - 1:
        after = np.arange(len(press.depth)) > top
        lost = int((keep & after).sum())
        if lost > 2:
            up, s = press.depth[: top + 1], press.force[: top + 1]
            work = float(np.trapezoid(s, up))
            loop = work + float(np.trapezoid(press.force[top:], press.depth[top:]))
            notes.append(
                f"{press.name}: {lost} rows after the deepest are left out; the loop is {100 * loop / work:.0f} % of "
                "the work, so the numbers belong to this rate; --relaxation takes all rows"
            )
        keep &= ~after
    part = press.part(keep)
    if len(part.depth) < LEAST_ROWS or not (part.depth > part.touch).any():
        raise SessionError(f"{press.name}: fewer than {LEAST_ROWS} rows are left to fit")
    return part, notes


def check_laws(rig: Rig, names: Sequence[str], relaxation: str) -> None:
    """SessionError: the rig has no such law, lacks a length, or the relaxation is unknown. Needs no data."""
    for name in names:
        if _is_rubber(name) and (rig.kind == "ball" or (rig.kind == "cylinder" and rig.plates == "bonded")):
            check_tabulated(rig, name)
        else:
            closed_form(rig, name)
    parameters(relaxation, 1.0)


def _is_rubber(name: str) -> bool:
    return name in SHAPES and name != "linear"


def _law(
    rig: Rig, name: str, relaxation: str, loaded: list[Press], touch: bool, relative: bool, reach: float, report: Report
) -> tuple[Law, list[str]]:
    """The law in closed form, or tabulated about what the closed form finds."""
    if rig.kind == "cylinder" and _is_rubber(name) and rig.plates == "bonded":
        first = replace(rig, plates="frictionless")
        rough = estimate(Problem(loaded, closed_form(first, name), relaxation, touch, relative), profiles=False)
        middle = next((rough.values[p.name] for p in SHAPES[name]), None)
        note = f"with frictionless plates young is {rough.values['young']:.4g} Pa: the truth lies between the two"
        return tabulated(rig, name, reach, middle, report=report), [note]
    if rig.kind == "ball" and _is_rubber(name):
        return tabulated(rig, name, reach, count=6, report=report), []
    return closed_form(rig, name), []


def _errors(presses: Sequence[Press], forces: Sequence[np.ndarray]) -> dict[str, float]:
    off = np.concatenate([f - p.force for f, p in zip(forces, presses, strict=True)])
    peak = max(float(p.force.max()) for p in presses)
    force = np.concatenate([p.force for p in presses])
    large = force > 0.05 * peak
    rms = float(np.sqrt(np.mean(off**2)))
    return {"rms": rms, "rms_of_peak": rms / peak, "worst_of_force": float(np.abs(off[large] / force[large]).max())}


def _predicted(problem: Problem, best: Estimate, press: Press) -> dict[str, Any]:
    """The force on a press that was not fitted: its own touch point and zero are found, the parameters are kept."""
    alone = Problem([press], problem.law, problem.kind, problem.free_touch, problem.relative)
    own, count = alone.start(), len(problem.parameters)
    own[:count] = [p.searched(best.values[p.name]) for p in problem.parameters]
    if len(own) > count:
        ends = [side[count:] for side in alone.bounds()]
        own[count:] = least_squares(lambda rest: alone.residuals(np.r_[own[:count], rest]), own[count:], bounds=ends).x
    forces = alone.forces(own)
    return {"press": press.name, **_errors([press], forces), "depth": float(press.depth.max()),
            "curve": (press.depth, press.force, forces[0])}  # fmt: skip


def _sensitivity(fit: Fit, made: Callable[[Sequence[Press]], Problem]) -> dict[str, float]:
    """Change of the first parameter [%] for one more percent of what was fixed; of Poisson's ratio 0.01 less."""
    if "finite elements" in fit.law.remark:
        return {}
    first = fit.estimate.parameters[0].name
    out = {}
    for key in fit.law.fixed:
        if key not in ("radius", "height", "poisson") or (key == "poisson" and fit.rig.kind == "cylinder"):
            continue
        now = getattr(fit.rig, key)
        other = replace(fit.rig, **{key: now - 0.01 if key == "poisson" else 1.01 * now})
        problem = made(fit.presses)
        problem.law = closed_form(other, fit.law.name)
        x = problem.start()
        x[: len(problem.parameters)] = [p.searched(fit.estimate.values[p.name]) for p in problem.parameters]
        solved, _ = problem.solve(x)
        out[key] = 100.0 * (problem.values(solved)[first] / fit.estimate.values[first] - 1.0)
    return out


def _open(fit: Fit) -> list[str]:
    """What the data cannot tell, one plain sentence each."""
    best, said = fit.estimate, []
    reach = fit.deepest
    what, size = ("height", fit.rig.height or 1.0) if fit.rig.kind == "cylinder" else ("radius", fit.rig.radius)
    deep = f"pressed {1e3 * reach:.3g} mm, {reach / size:.2g} of the {what}"
    length = max((float(np.ptp(p.time)) for p in fit.presses if p.time is not None), default=0.0)
    for p in best.parameters:
        own = best.intervals[p.name]
        low, high = own.profile
        if p.name.startswith(("time_", "retardation")) and (own.value > 0.5 * length or math.isnan(high)):
            least = own.value if math.isnan(low) else low
            said.append(f"{p.name}: the record of {length:.3g} s is too short for it; it is above {least:.3g} s, and "
                        "the share that belongs to it is open")  # fmt: skip
        elif math.isnan(low) and math.isnan(high):
            said.append(f"{p.name}: not determined, any value from {p.low:g} to {p.high:g} fits ({deep})")
        elif math.isnan(low) or math.isnan(high):
            known = f"above {low:.3g}" if math.isnan(high) else f"below {high:.3g}"
            said.append(f"{p.name}: only {known} {p.unit} is certain ({deep})")
        elif p.name == "alpha" and low < 2.0 < high:
            said.append(f"alpha: from {low:.3g} to {high:.3g}, which holds the 2 of the neo-Hooke law: the data show "
                        f"no stiffening ({deep})")  # fmt: skip
    names = best.names
    for i in range(len(names)):
        for j in range(i):
            if abs(best.correlation[i, j]) > ALIKE:
                said.append(f"{names[j]} and {names[i]} cannot be told apart: correlation {best.correlation[i, j]:.3f}")
    if fit.law.rest is not None and fit.rig.kind != "cylinder":
        said.append(f"young and poisson: only E/(1 - nu²) shows in a press; nu was fixed at {fit.rig.poisson:g}")
    if fit.law.name == "hertz" and fit.rig.kind == "ball":
        said.append(_thickness(fit.rig, reach))
    if fit.rig.kind == "cylinder":
        said.append("young and the friction of the plates: fit with --plates frictionless and bonded; the truth lies "
                    "between")  # fmt: skip
    if len({p.name for p in fit.presses}) > 1 and (own := best.intervals[best.parameters[0].name]).presses:
        ratio = max(own.presses) / min(own.presses)
        if ratio > MIXED:
            said.append(f"the presses differ {ratio:.2g} times in {best.parameters[0].name}: are two indenters or two "
                        "specimens mixed?")  # fmt: skip
    if best.starts < 0.5:
        said.append(
            f"only {100 * best.starts:.0f} % of the starts came to this minimum: there are others nearly as good"
        )
    return said


def _thickness(rig: Rig, deepest: float) -> str:
    """How thick the tissue must be for Hertz's law, and what it means if it is not."""
    factor, across = thickness_factor(rig.poisson), math.sqrt(rig.radius * deepest)
    chi = np.linspace(0.0, float(factor.x[-1]), 1000)
    least = across / float(np.interp(0.1, factor(chi) - 1.0, chi))
    if rig.height and rig.height < least:
        more = 100.0 * (float(factor(min(across / rig.height, float(factor.x[-1])))) - 1.0)
        return (f"young and the thickness: hertz ignores --height, and a bonded layer of {1e3 * rig.height:.3g} mm is "
                f"{more:.0f} % stiffer at the deepest row than the half-space; fit --law layer")  # fmt: skip
    return (f"young and the thickness: hertz is the law of a half-space; a layer bonded to a stiff ground is more than "
            f"10 % stiffer at the deepest row if it is thinner than {1e3 * least:.3g} mm, and young that much too "
            "great: --law layer with --height")  # fmt: skip


def _mesh_error(fit: Fit) -> str:
    """What table and mesh leave of the force, at the deepest row."""
    reach = min(fit.deepest, fit.law.reach)
    shape = {k: v for k, v in fit.estimate.values.items() if k != "young"}
    depths = reach * np.linspace(0.0, 1.0, 9)[1:]
    fine = curve(fit.rig, fit.law.name, shape, depths, FINE)
    table = fit.law.force({**fit.estimate.values, "young": REFERENCE}, depths)
    off = np.abs(table / fine - 1.0)
    if np.isnan(off).all():
        return "the finer mesh found no equilibrium, so the error of the mesh is not known"
    return f"mesh and table: at most {100 * np.nanmax(off):.1f} % of the force, against {FINE} elements across"
