"""`palpate study`: run one graph at many parameter points, in parallel."""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import console, draw_if_possible, print_json, say, table
from palpate.launch.run.notes import lines
from palpate.launch.run.progress import steps
from palpate.physics.errors import TROUBLE, PalpateWarning

if TYPE_CHECKING:
    from palpate.launch.run.tasks.spread import Executor
    from palpate.studies.sweeps.study import Study

EXAMPLE = "palpate study kidney-stiffness --workers 2"
LISTED = 50  # points in the table


def study(
    file: Annotated[str, typer.Argument(help="Study (.yaml), or the name of one that ships.", metavar="STUDY")],
    out: Annotated[Path | None, options.out_option("Folder of the results; default runs/studies/STUDY.")] = None,
    workers: Annotated[int | None, typer.Option(help="Number of processes; default: one per core.", min=1)] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Compute on a Dask cluster: address of its scheduler.", metavar="tls://HOST:PORT")
    ] = None,
    sensitivity: Annotated[str | None, typer.Option(help="sobol or morris: which parameter matters.")] = None,
    local: Annotated[
        bool, typer.Option("--local", help="Only derivatives by the parameters, at the settings of the scene.")
    ] = False,
    samples: Annotated[int | None, typer.Option(help="Number of samples, instead of the file's.", min=1)] = None,
    organ: options.OrganOption = None,
    unit: options.UnitOption = None,
    piece: options.PieceOption = None,
    label: options.LabelOption = None,
    repair: options.RepairOption = False,
    retry: Annotated[bool, typer.Option("--retry", help="Recompute points that failed before.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Compute more than 100,000 points.")] = False,
    as_json: options.Json = False,
) -> None:
    """Run one graph at many points, with sensitivities.

    Stores numbers, curves or recordings of each point. Skips points that the folder already has, so that the same
    command resumes after Ctrl-C. Exit code 1 if points failed, 130 after Ctrl-C.
    """
    from palpate.launch.run.tasks.cluster import cluster_or_local
    from palpate.studies.sweeps.file import find, load

    path = find(file)
    replaced = options.say_organ_file(organ, unit, piece, repair, silent=as_json, label=label)
    folder = out or Path("runs", "studies", path.stem)
    if local:
        _local(load(path, None, samples, replaced), folder, as_json)
        return
    opened = cluster_or_local(scheduler, workers, folder / "workers.log", lambda text: say(text, "yellow", err=True))
    with opened as executor:  # its processes start while the study is loaded
        found = load(path, sensitivity, samples, replaced)
        _run(found, path.stem, folder, executor, as_json, retry=retry, yes=yes)
    _print(found, folder, as_json)
    if any(row["error"] for row in found.rows()):
        raise typer.Exit(TROUBLE)


def _local(found: Study, folder: Path, as_json: bool) -> None:
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


def _run(found: Study, name: str, folder: Path, executor: Executor, as_json: bool, **given: bool) -> None:
    """Compute the missing points."""
    left, report = len(found), (lambda text: None) if as_json else partial(say, err=True)
    with steps(f"study {name}", len(found), silent=as_json, timed=False) as done:

        def each(point: Any, computed: Any, remain: int) -> None:
            nonlocal left
            done(computed.error.partition("\n")[0] or f"point {point.slot}", left - remain)
            left = remain

        try:
            with warnings.catch_warnings(action="ignore", category=PalpateWarning):  # `_print` prints the notes
                found.run(folder, executor, report=report, done=each, **given)
        except KeyboardInterrupt as error:
            stored = sum(row["error"] != "not computed" for row in found.rows()) if found.folder else 0
            error.add_note(f"{stored} of {len(found)} points are stored in {folder}, the same command resumes")
            raise


def _print(found: Study, folder: Path, as_json: bool) -> None:
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
