"""Prints the results of a study: a table of its points, its indices, or derivatives by its parameters."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.launch.run.notes import lines
from palpate.physics.errors import PalpateWarning

if TYPE_CHECKING:
    from palpate.studies.sweeps.study import Study

LISTED = 50  # points in the table


def print_local(found: Study, folder: Path, as_json: bool) -> None:
    """Compute, print and draw the derivatives of the kept results."""
    from palpate.studies.sweeps.local import draw_local, local_sensitivity

    with warnings.catch_warnings(action="ignore", category=PalpateWarning):
        result = local_sensitivity(found)
    if as_json:
        print_json({"ok": True, "rows": result.rows, "notes": result.notes})
        return
    heads = ("of", "parameter", ">value", "unit", ">derivative", ">by + 1 %")
    units = {one.text: one.unit for one in found.numbers}
    rows = [
        (r["of"], r["parameter"], f"{r['value']:.4g}", r["unit"], f"{r['derivative']:.5g}",
         f"{r['per_cent']:+.3g} {units[r['of']]}")
        for r in result.rows
    ]  # fmt: skip
    if rows:
        console(soft_wrap=True).print(table(heads, rows))
    for r in result.rows:
        if r["reason"]:
            say(f"{r['of']}, {r['parameter']}: {r['reason']}", "yellow")
    for line in result.notes:
        say(line)
    folder.mkdir(parents=True, exist_ok=True)
    for picture in draw_if_possible(draw_local, result, folder):
        say(picture)


def print_study(found: Study, folder: Path, as_json: bool) -> None:
    """Print and draw what a study has computed."""
    from palpate.studies.sweeps.picture import draw_all

    rows = found.rows()
    failed = [row for row in rows if row["error"]]
    indices = None if found.sensitivity is None or failed else found.indices()
    if as_json:
        shown = [{k: v for k, v in row.items() if k not in ("base", "slot", "notes")} for row in rows]
        data = {"ok": not failed, "folder": str(folder), "failed": len(failed), "points": shown,
                "notes": lines(found.notes, "point")}  # fmt: skip
        print_json(data | ({} if indices is None else {"indices": indices.to_dict("records")}))
        return
    if indices is None:
        units = {one.text: f">{one.text} [{one.unit}]" for one in found.numbers}
        _list(found, found.table().drop(columns=[] if failed else "error"), units)
    else:
        for one in found.numbers:
            _list(found, indices[indices["of"] == one.text].drop(columns="of"), {}, f"{one.text} [{one.unit}]")
        if found.sensitivity == "sobol" and not indices[["S1", "ST"]].stack().between(-0.05, 1.05).all():
            say("Shares below 0 or above 1 are noise of too few samples: take more, --samples 256.", "yellow")
    for line in lines(found.notes, "point"):
        say(line, "yellow")
    if failed:
        say(f"{len(failed)} of {len(rows)} points failed; --retry computes them again", "yellow")
        if found.sensitivity:
            say("No indices: they need the results of all points.", "yellow")
    say(f"stored in {folder}: points.parquet{', curves.zarr' * bool(found.curves)}")
    for picture in draw_all(found, folder):
        say(picture)


def _list(found: Study, listed: Any, units: dict[str, str], title: str = "") -> None:
    heads = [units.get(name, f">{name}" if kind.kind == "f" else name) for name, kind in listed.dtypes.items()]
    rows = (zip(listed, row, strict=True) for row in listed.head(LISTED).itertuples(index=False))
    body = [[found.value_text(name, value) for name, value in row] for row in rows]
    console(soft_wrap=True).print(table(heads, body, title=title))
    if len(listed) > LISTED:
        say(f"... and {len(listed) - LISTED} more")
