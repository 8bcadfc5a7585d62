"""Options, files and tables of the fit of a tissue to measured presses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.physics.archive import replace_text

if TYPE_CHECKING:
    from palpate.models.fit.tissue.fit import TissueFit
    from palpate.models.fit.tissue.rigs import Rig
    from palpate.models.fit.tissue.several import SpecimenFits

RIGS = ("ball", "punch", "fingertip", "cylinder")


def rig_of(rig: str, radius: str | None, diameter: str | None, height: str | None, plates: str, poisson: float) -> Rig:
    """The rig that the options describe. SessionError: an option is invalid."""
    from palpate.models.fit.sessions import SessionError
    from palpate.models.fit.tissue.rigs import Rig
    from palpate.studies.presses import length

    for option, found, known in (("--rig", rig, RIGS), ("--plates", plates, ("frictionless", "bonded"))):
        if found not in known:
            raise SessionError(f"{option}: found {found!r}, expected {', '.join(known)}")
    size = length("--radius", radius) if radius else 0.5 * length("--diameter", diameter) if diameter else None
    if (radius and diameter) or (rig != "fingertip" and size is None):
        raise SessionError(f"--rig {rig}: expected either --radius or --diameter, such as --radius '8 mm'")
    return Rig(rig, 8e-3 if size is None else size, length("--height", height) if height else None, plates, poisson)


def show_fit(fit: TissueFit, out: Path, as_json: bool) -> None:
    """Write and print the fit of one specimen."""
    result = write_fit(fit, out)
    if as_json:
        print_json({"ok": True, "out": str(out)} | result)
    else:
        print_fit(fit, result)
        say(f"written {out}/report.md, report.json, scene.yaml; next: palpate run kidney --scene {out}/scene.yaml")


def show_fits(found: SpecimenFits, out: Path, as_json: bool) -> None:
    """Write and print the fits of several specimens. SessionError: one could not be fitted; the others are written."""
    from palpate.models.fit.sessions import SessionError

    each = write_fits(found, out)
    if as_json:
        print_json({"ok": not found.refused, "out": str(out), "specimens": each})
    else:
        print_fits(found, out)
    if found.refused:
        raise SessionError("\n".join(f"specimen {label}: {text}" for label, text in found.refused.items()))


def write_fit(fit: TissueFit, out: Path) -> dict[str, Any]:
    """Write scene, reports and pictures; returns the content of report.json."""
    from palpate.models.fit.tissue.report import data, markdown, scene
    from palpate.views.pictures.models.fit_tissue import draw_fit

    result = data(fit)
    out.mkdir(parents=True, exist_ok=True)
    pictures = draw_if_possible(draw_fit, fit, out)
    replace_text(out / "scene.yaml", scene(fit))
    replace_text(out / "report.json", json.dumps(result, indent=1) + "\n")
    replace_text(out / "report.md", markdown(fit, pictures))
    return result


def write_fits(found: SpecimenFits, out: Path) -> dict[str, Any]:
    """Write each specimen to its folder, and the table of all; returns the content of every report.json by specimen."""
    from palpate.models.fit.tissue.several import overview

    each = {label: write_fit(fit, out / found.folders[label]) for label, fit in found.fits.items()}
    kept = ("parameters", "withheld", "shear_modulus_at_rest")
    short = {
        label: {"folder": found.folders[label], **{key: result[key] for key in kept}} for label, result in each.items()
    } | {label: {"refused": text} for label, text in found.refused.items()}
    replace_text(out / "report.json", json.dumps({"specimens": short}, indent=1) + "\n")
    replace_text(out / "report.md", overview(found))
    return each | {label: {"refused": text} for label, text in found.refused.items()}


def print_fits(found: SpecimenFits, out: Path) -> None:
    """Print a row per specimen, and the notes with the specimens that they belong to."""
    from palpate.models.fit.tissue.several import table_of_fits, texts_of_fits

    heads, rows = table_of_fits(found)
    console().print(table(heads, rows))
    for text in texts_of_fits({label: fit.read for label, fit in found.fits.items()}):
        say(text, "dim", wrap=True)
    for text in texts_of_fits({label: _texts(fit) for label, fit in found.fits.items()}):
        say(text, wrap=True)
    first = out / found.folders[next(iter(found.fits))]
    say(f"written {out}/report.md, report.json, and a folder per specimen; next: palpate run kidney --scene "
        f"{first}/scene.yaml")  # fmt: skip


def print_fit(fit: TissueFit, result: dict[str, Any]) -> None:
    """Print parameters with intervals, notes, and the error on held-out presses."""
    ends = "withheld" if fit.estimate.withheld else "{low:.4g} to {high:.4g}"
    rows = [(name, f"{p['value']:.5g}", ends.format(**p), str(p["unit"])) for name, p in result["parameters"].items()]
    console().print(table(("parameter", ">value", ">95 % interval", "unit"), rows))
    for text in fit.read:
        say(text, "dim", wrap=True)
    for text in _texts(fit):
        say(text, wrap=True)


def _texts(fit: TissueFit) -> list[str]:
    """Notes, what the data do not determine, the ranks of other laws, and the error on held-out presses."""
    from palpate.models.fit.tissue.report import held_out, scene_young

    return [
        *(f"not determined: {text}" for text in fit.open_), *fit.notes, *scene_young(fit),
        *(f"law {row['law']}: RMS {100 * row['rms_of_peak']:.2g} % of the peak, AICc {row['aicc']:.3g} above best"
          for row in fit.compared),
        *map(held_out, fit.held_out),
    ]  # fmt: skip
