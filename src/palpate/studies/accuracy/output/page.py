"""The report of the benchmark in Markdown; it ends with the limits of the benchmark."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.physics.archive import replace_text
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.output import pareto
from palpate.studies.accuracy.output.pareto import duration, percent
from palpate.studies.accuracy.reference import QUANTITIES
from palpate.studies.accuracy.sites import load_reference, on_path
from palpate.studies.meeting.stored import reference

LEGEND = (
    "Bold: on the Pareto front of the settings that compute the largest number of touches. Unsupported: touches that a "
    "method does not support or fails on; errors and times exclude them."
)
LAWS = "Laws without a body or tissue, each on the test case that it describes."
COLUMNS = (
    "Times are processor times of one compiled tick: motion, contact, friction, spread and body with its surface. "
    "Below, errors are RMS and maximum, over the peak of the reference; *once* is the time to build and start."
)
SOLVER = {"fe": "full FE", "felupe": "FElupe"}  # Those of the references
NOT_COVERED = (
    "Organs other than a slab and the top of one kidney; the shape of the kidney surface, and its viscosity.",
    "Measured tissue. The references solve equations; the benchmark does not show whether a kidney follows them.",
    "Transport between processes, closest-point search and device: `python benchmarks/loop.py` measures them.",
    "The shape of a soft finger: it loads the slab through a patch of fixed shape, as in the scenes.",
    "Slip within the patch, anisotropy, inertia, and tissue with a memory longer than one retardation time.",
    "Just noticeable differences: no published value for this contact was available.",
)


def write(cells: Sequence[Cell], about: dict[str, Any], overview: Path | None, path: Path) -> None:
    points = pareto.summaries(pareto.of_bodies(cells))
    lines = ["# What accuracy costs in time", "", pareto.advice(points), *pareto.elsewhere(cells), ""]
    if overview is not None:
        lines += [f"![Bodies on the test cases of tissue]({overview.name})", ""]
    lines += ["| method, setting | error of the force, median | worst touch | p50 | p99 | computed | unsupported |"]
    lines += ["|---|---|---|---|---|---|---|"]
    bold = pareto.best(points)
    for k, s in enumerate(points):
        mark = "**" if k in bold else ""
        lines.append(
            f"| {mark}{s.title}, {s.fidelity}{mark} | {percent(s.error)} | {percent(s.worst)}, {s.hardest} | "
            f"{duration(s.p50)} | {duration(s.p99)} | {s.computed} | {s.charged or ''} |"
        )
    lines += ["", LEGEND, ""]
    lines += [f"Methods that support no touch: {', '.join(out)}.", ""] if (out := pareto.unable(cells)) else []
    if laws := pareto.of_laws(cells):
        lines += ["## Laws of contact alone", "", LAWS, "", "| law, setting | test case | force error | p50 | p99 |"]
        lines += ["|---|---|---|---|---|"]
        lines += [
            f"| {c.title}, {c.fidelity} | {c.touch} | {percent(c.errors['force']['rms'])} | {duration(c.p50)} | "
            f"{duration(c.p99)} |"
            for c in laws
        ]
        lines += [""]
    lines += [COLUMNS, ""]
    for touch in dict.fromkeys(c.touch for c in cells):
        lines += _of_touch([c for c in cells if c.touch == touch])
    lines += ["## Run", "", *(f"* {k}: {_text(v)}" for k, v in about.items()), "", "## Not covered", ""]
    lines += [f"* {text}" for text in NOT_COVERED]
    replace_text(path, "\n".join(lines) + "\n")


def _text(value: Any) -> str:
    return ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)


def _of_touch(cells: list[Cell]) -> list[str]:
    touch = TOUCHES[cells[0].touch]
    lines = [f"## {touch.name}: {touch.title}", "", _reference(cells), ""]
    quantities = [q for q in QUANTITIES if any(q in c.errors for c in cells if c.status == "ok")]
    lines += [f"| method, setting | {' | '.join(quantities)} | p50 | p99 | memory | once | reason of failure |",
              f"|---|{'---|' * (len(quantities) + 5)}"]  # fmt: skip
    bold = pareto.front([pareto.point(c) for c in cells])
    for k, cell in enumerate(cells):
        if cell.status == "refused":
            continue
        mark = "**" if k in bold else ""
        errors = " | ".join(_error(cell, q) for q in quantities)
        memory = "" if cell.memory is None else f"{cell.memory / 1e6:.1f} MB"
        lines.append(
            f"| {mark}{cell.title}, {cell.fidelity}{mark} | {errors} | {duration(cell.p50)} | {duration(cell.p99)} "
            f"| {memory} | {cell.offline:.1f} s | {cell.why} |"
        )
    refused = {c.title: c.why for c in cells if c.status == "refused"}
    return [*lines, "", *(f"* {title}: unsupported, {why}" for title, why in refused.items()), ""]


def _reference(cells: list[Cell]) -> str:
    touch = TOUCHES[cells[0].touch]
    band = next((c.errors["force"]["band"] for c in cells if c.status == "ok"), float("nan"))
    if touch.meeting:
        fewer, more = reference(touch.meeting)["unknowns"]
        return (
            f"Reference: fe.Solver and fe.Pair with {fewer} and {more} unknowns. Its uncertainty is {percent(band)} of "
            "the peak force."
        )
    if not touch.place:
        return "Reference: a closed form."
    names = on_path(touch.place)
    about = load_reference(names[0]).about
    meshes = "; ".join(
        f"{SOLVER[name]} with {' and '.join(str(n) for n in solved['unknowns'])} unknowns"
        for name, solved in about["solvers"].items()
    )
    at = f", at {len(names)} sites" if len(names) > 1 else ""
    return f"Reference: {meshes}{at}. Its uncertainty is {percent(band)} of the peak force."


def _error(cell: Cell, quantity: str) -> str:
    error = cell.errors.get(quantity)
    if error is None:
        return ""
    return "at the reference" if cell.at_reference(quantity) else f"{percent(error['rms'])}, {percent(error['worst'])}"
