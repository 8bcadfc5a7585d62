"""Results of a fit: `report.json`, `report.md`, and `scene.yaml` for `palpate run`."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from palpate.models.fit.tissue.fit import TissueFit
from palpate.models.fit.tissue.rigs import Rig
from palpate.physics.contact.under_finger import BASIS_POISSON, FINGER_RADIUS, round_settings, under_finger

WRITTEN = ("scene.yaml", "report.json", "report.md", "fit.png", "profiles.png")  # Files that a fit writes to its folder


def data(fit: TissueFit) -> dict[str, Any]:
    """The result in SI units."""
    best = fit.estimate
    parameters = {
        p.name: {"value": i.value, "low": i.low, "high": i.high, "unit": p.unit,
                 "profile": [None if math.isnan(v) else v for v in i.profile], "presses": i.presses}
        for p in best.parameters for i in [best.intervals[p.name]]
    }  # fmt: skip
    young, ratio = fit.young, _poisson(fit)
    shear = None if young is None else [v / (2.0 * (1.0 + ratio)) for v in young]
    return {
        "law": fit.law.name, "rig": fit.rig.kind, "relaxation": fit.relaxation, "remark": fit.law.remark,
        "parameters": parameters, "withheld": best.withheld,
        "drift": fit.drift,
        "without_drift" if fit.drift == "linear" else "without_curved_drift": {
            name: {"low": low, "high": high} for name, (low, high) in fit.steady.items()
        },
        "shear_modulus_at_rest": None if shear is None else dict(zip(("value", "low", "high"), shear, strict=True))
        | {"unit": "Pa"},
        "touch": {p.name: {"value": t, "unit": "m"} for p, t in zip(fit.presses, best.touches, strict=True)},
        "zero": {p.name: {"value": p.zero, "unit": "N"} for p in fit.presses},
        "residuals": fit.errors() | {"runs": best.runs, "effective": best.effective[0], "rows": best.effective[1]},
        "laws": fit.compared,
        "correlation": {"names": best.names, "matrix": best.correlation.tolist()},
        "condition": best.condition,
        "starts": best.starts,
        "not_determined": fit.open_,
        "fixed": {k: {"value": v, "unit": u} for k, (v, u) in fit.law.fixed.items()}
        | ({"plates": fit.rig.plates} if fit.rig.kind == "cylinder" else {}),
        "change_for_fixed": fit.sensitivity,
        "range": {"depth": fit.deepest, "rate": max(float(abs(p.rate).max()) for p in fit.presses)},
        "held_out": [{k: v for k, v in each.items() if k != "curve"} for each in fit.held_out],
        "notes": fit.notes,
        "read": fit.read,
    }  # fmt: skip


def markdown(fit: TissueFit, pictures: list[Path]) -> str:
    """The report as Markdown."""
    # Parameters with their intervals.
    result, best = data(fit), fit.estimate
    remark = f" {fit.law.remark[:1].upper()}{fit.law.remark[1:]}." if fit.law.remark else ""
    lines = [
        f"# {fit.law.name}, {fit.rig.kind}", "", f"Fitted to {', '.join(p.name for p in fit.presses)}.{remark}", "",
        "| parameter | value | 95 % interval | by profile | press by press |", "|---|---|---|---|---|",
    ]  # fmt: skip
    for p in best.parameters:
        i = best.intervals[p.name]
        low, high = (("open" if math.isnan(v) else f"{v:.4g}") for v in i.profile)
        each = ", ".join(f"{v:.4g}" for v in i.presses)
        ends = "withheld" if best.withheld else f"{i.low:.4g} to {i.high:.4g}"
        cells = (f"{p.name} [{p.unit}]", f"{i.value:.4g}", ends, f"{low} to {high}", each)
        lines.append(f"| {' | '.join(cells)} |")
    if shear := result["shear_modulus_at_rest"]:
        ends = "interval withheld" if best.withheld else f"{shear['low']:.4g} to {shear['high']:.4g}"
        lines += ["", f"Shear modulus at rest: {shear['value']:.4g} Pa ({ends}).", "", *scene_young(fit)]
    # Warnings, and parameters that the data do not determine.
    lines += ["", *(f"* {note}" for note in fit.notes)]
    lines += ["", "## Columns read", "", *(f"* {text}" for text in fit.read)] if fit.read else []
    lines += ["", "## What the data do not determine", "", *(f"* {text}" for text in fit.open_ or ["nothing found"])]
    # Residuals of the fit and of the held-out presses, and the comparison with other laws.
    errors = result["residuals"]
    lines += [
        "", "## Goodness of fit", "",
        f"RMS {errors['rms']:.3g} N, {100 * errors['rms_of_peak']:.2g} % of the peak; at most "
        f"{100 * errors['worst_of_force']:.2g} % of the force where that is above 5 % of the peak. {errors['rows']} "
        f"rows count as {errors['effective']:.0f} independent ones (runs test: {errors['runs']:.1f} standard "
        f"deviations too few runs). Condition number of the scaled Jacobian {best.condition:.3g}; "
        f"{100 * best.starts:.0f} % of the starts converged to this minimum.",
    ]  # fmt: skip
    for tried in fit.held_out:
        lines.append(held_out(tried) + ".")
    if fit.compared:
        lines += ["", "| law | unknowns | RMS, of the peak | AICc above the lowest |", "|---|---|---|---|"]
        lines += [f"| {row['law']} | {row['numbers']} | {100 * row['rms_of_peak']:.2g} % | {row['aicc']:.3g} |"
                  for row in fit.compared]  # fmt: skip
    # Pictures, fixed values with their influence, and the correlation matrix.
    lines += ["", *(f"![{p.stem}]({p.name})" for p in pictures), "", "## Fixed values", ""]
    lines += [f"* {k}: {v['value']:.4g} {v['unit']}" if isinstance(v, dict) else f"* {k}: {v}"
              for k, v in result["fixed"].items()]  # fmt: skip
    for key, change in fit.sensitivity.items():
        what = "0.01 lower" if key == "poisson" else "1 % larger"
        lines.append(f"* {key} {what} changes {best.parameters[0].name} by {change:+.2g} %")
    for press, touch in zip(fit.presses, best.touches, strict=True):
        lines.append(f"* {press.name}: touch at {1e3 * touch:.4g} mm, zero of force {press.zero:.3g} N")
    lines += ["", "## Correlation", "", "| | " + " | ".join(best.names) + " |", "|---" * (len(best.names) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(f"{v:.2f}" for v in row) + " |"
              for name, row in zip(best.names, best.correlation, strict=True)]  # fmt: skip
    return "\n".join([*lines, ""])


def held_out(tried: dict[str, Any]) -> str:
    """Error on a held-out press, on the scale of that of the fit."""
    text = (f"held out, {tried['press']}: RMS {tried['rms']:.3g} N, {100 * tried['rms_of_peak']:.2g} % of the peak of "
            f"the fitted presses, at most {100 * tried['worst_of_force']:.2g} % of the force")  # fmt: skip
    if beyond := tried["beyond"]:
        text += (f"; {beyond['rows']} rows are deeper than the fitted ones, extrapolated with RMS {beyond['rms']:.3g} "
                 f"N, {100 * beyond['rms_of_peak']:.2g} % of that peak")  # fmt: skip
    return text


def _poisson(fit: TissueFit) -> float:
    """Poisson's ratio for which Young's modulus was fitted."""
    return 0.5 if fit.rig.kind == "cylinder" or "finite" in fit.law.remark else fit.rig.poisson


def scene_young(fit: TissueFit) -> list[str]:
    """Why the Young's modulus of the scene differs from that of the report: one sentence, or none without a modulus."""
    if fit.young is None:
        return []
    tissue = under_finger(fit.young[0] / (1.0 - _poisson(fit) ** 2))
    return [
        f"young is {fit.young[0]:.5g} Pa with Poisson's ratio {_poisson(fit):g}; scene.yaml has young "
        f"{tissue['young']:.5g} Pa, because the basis of deformation.ReducedFE has Poisson's ratio {BASIS_POISSON:g}: "
        "E/(1 - nu²) stays the same, and so does the force"
    ]


def scene(fit: TissueFit) -> str:
    """Scene kidney with the fitted tissue under its finger: a power law for MassSpring, a modulus for ReducedFE."""
    tissue, why = under_patch(fit.rig, _poisson(fit), fit.estimate.values, fit.deepest)
    if fit.relaxation == "hunt-crossley":
        tissue |= {"damping": fit.estimate.values["damping"], "retardation": 0.0}
    elif fit.relaxation == "kelvin-voigt":
        tissue["retardation"] = fit.estimate.values["retardation"]
    body = yaml.safe_dump({"extends": "kidney", "tissue": round_settings(tissue)}, sort_keys=False)
    head = f"# Fitted by `palpate fit tissue` to {', '.join(p.name for p in fit.presses)}: {fit.law.name}. SI units."
    return "\n".join([head, *(f"# {text}." for text in (why, *scene_young(fit))), body])


def under_patch(rig: Rig, poisson: float, values: Mapping[str, float], depth: float) -> tuple[dict[str, Any], str]:
    """The tissue of a scene from a fitted law, and how it was derived. depth [m]: greatest indentation."""
    tissue: dict[str, Any]
    if "young" in values:
        tissue = under_finger(values["young"] / (1.0 - poisson**2))
        why = (
            f"the law of a finger's patch of {1e3 * FINGER_RADIUS:g} mm with the modulus at rest, without strain "
            "stiffening"
        )
    elif "exponent" in values:
        ratio = 1.0 if rig.kind == "fingertip" else math.sqrt(FINGER_RADIUS / rig.radius)
        tissue = {"stiffness": values["stiffness"] * ratio, "exponent": values["exponent"]}
        why = "the power law as fitted" + (
            "" if ratio == 1.0 else ", scaled from the indenter's to the finger's radius"
        )
    else:
        steep = values["hardening"] * depth
        power = steep * math.exp(steep) / math.expm1(steep)
        force = values["stiffness"] / values["hardening"] * math.expm1(steep)
        exponent = min(max(power, 1.0), 3.0)
        tissue = {"stiffness": force / depth**exponent, "exponent": exponent}
        why = f"a power law with the force and the stiffness of the exponential at {1e3 * depth:.3g} mm"
    return tissue, why
