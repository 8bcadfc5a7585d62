"""The page: what came out, in Markdown, with what it does not cover at its end."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from palpate.studies.accuracy.cells import Cell
from palpate.studies.accuracy.output.pareto import (
    advice,
    best,
    duration,
    elsewhere,
    front,
    of_bodies,
    of_laws,
    percent,
    point,
    summaries,
    unable,
)
from palpate.studies.accuracy.places import on_path, stored
from palpate.studies.accuracy.touches import TOUCHES
from palpate.studies.accuracy.truth import QUANTITIES

LEGEND = (
    "Bold: on the Pareto front of those that compute as many touches as any. Unsupported: touches that a method cannot "
    "do or breaks down on; they are in no error and no time."
)
LAWS = "Without a body: each on the test case that it describes, and none of them is a tissue."
COLUMNS = (
    "Times are processor times of one compiled tick: motion, contact, friction, spread and body with its surface. "
    "Below, errors are rms and worst, over the peak of the reference; *once* is building and starting."
)
SOLVER = {"fe": "full FE", "felupe": "FElupe"}  # Those of the references
NOT_COVERED = (
    "Organs other than a slab and the top of one kidney; of that, the shape of its surface and its viscosity.",
    "Measured tissue. Each reference solves equations; whether they are those of a kidney is not asked.",
    "The transport between processes: `python benchmarks/loop.py` prices that. Closest-point search and device, too.",
    "A soft finger with a shape of its own: it loads the slab through a patch of fixed shape, as in the scenes.",
    "Slip within the patch, anisotropy, inertia, and tissue that remembers longer than one retardation time.",
    "Just noticeable differences: no line is drawn, as no number for this contact was at hand with its source.",
)


def write(cells: Sequence[Cell], about: dict[str, Any], pictures: dict[str, Path], path: Path) -> None:
    told = summaries(of_bodies(cells))
    lines = ["# What accuracy costs in time", "", advice(told), *elsewhere(cells), ""]
    if "overview" in pictures:
        lines += [f"![Bodies on the test cases of tissue]({pictures['overview'].name})", ""]
    lines += ["| method, setting | error of the force, median | worst touch | p50 | p99 | computed | unsupported |"]
    lines += ["|---|---|---|---|---|---|---|"]
    bold = best(told)
    for k, s in enumerate(told):
        mark = "**" if k in bold else ""
        lines.append(
            f"| {mark}{s.title}, {s.fidelity}{mark} | {percent(s.error)} | {percent(s.worst)}, {s.hardest} | "
            f"{duration(s.p50)} | {duration(s.p99)} | {s.computed} | {s.charged or ''} |"
        )
    lines += ["", LEGEND, ""]
    lines += [f"Cannot do any touch: {', '.join(out)}.", ""] if (out := unable(cells)) else []
    if laws := of_laws(cells):
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
        lines += _of_touch([c for c in cells if c.touch == touch], pictures.get(touch))
    lines += ["## Run", "", *(f"* {k}: {_told(v)}" for k, v in about.items()), "", "## Not covered", ""]
    lines += [f"* {text}" for text in NOT_COVERED]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _told(value: Any) -> str:
    return ", ".join(f"{k} {v}" for k, v in value.items()) if isinstance(value, dict) else str(value)


def _of_touch(own: list[Cell], picture: Path | None) -> list[str]:
    touch = TOUCHES[own[0].touch]
    lines = [f"## {touch.name}: {touch.title}", "", _reference(own), ""]
    if picture is not None:
        lines += [f"![{touch.name}]({picture.name})", ""]
    told = [q for q in QUANTITIES if any(q in c.errors for c in own if c.status == "ok")]
    lines += [f"| method, setting | {' | '.join(told)} | p50 | p99 | memory | once | why not |",
              f"|---|{'---|' * (len(told) + 5)}"]  # fmt: skip
    bold = front([point(c) for c in own])
    for k, cell in enumerate(own):
        if cell.status == "refused":
            continue
        mark = "**" if k in bold else ""
        errors = " | ".join(_error(cell, q) for q in told)
        memory = "" if cell.memory is None else f"{cell.memory / 1e6:.1f} MB"
        lines.append(
            f"| {mark}{cell.title}, {cell.fidelity}{mark} | {errors} | {duration(cell.p50)} | {duration(cell.p99)} "
            f"| {memory} | {cell.offline:.1f} s | {cell.why} |"
        )
    refused = {c.title: c.why for c in own if c.status == "refused"}
    return [*lines, "", *(f"* {title} cannot: {why}" for title, why in refused.items()), ""]


def _reference(own: list[Cell]) -> str:
    touch = TOUCHES[own[0].touch]
    if not touch.place:
        return "Reference: a closed form."
    names = on_path(touch.place)
    about = stored(names[0]).about
    meshes = "; ".join(
        f"{SOLVER[name]} with {' and '.join(str(n) for n in told['unknowns'])} unknowns"
        for name, told in about["solvers"].items()
    )
    band = next((c.errors["force"]["band"] for c in own if c.status == "ok"), float("nan"))
    at = f", at {len(names)} places" if len(names) > 1 else ""
    return f"Reference: {meshes}{at}. It may be off by {percent(band)} of the peak force."


def _error(cell: Cell, quantity: str) -> str:
    own = cell.errors.get(quantity)
    if own is None:
        return ""
    if cell.at_reference(quantity):
        return "at the reference"
    return f"{percent(own['rms'])}, {percent(own['worst'])}"
