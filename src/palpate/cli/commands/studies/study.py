"""`palpate study`: run one graph at many parameter points, in parallel."""

from __future__ import annotations

import warnings
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.cli.terminal import options
from palpate.cli.terminal.output import say
from palpate.cli.terminal.studied import print_local, print_study
from palpate.launch.run.progress import steps
from palpate.physics.errors import TROUBLE, PalpateWarning

if TYPE_CHECKING:
    from palpate.launch.run.tasks.spread import Executor
    from palpate.studies.sweeps.study import Study

EXAMPLE = "palpate study kidney-stiffness --workers 2"


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
        print_local(load(path, None, samples, replaced), folder, as_json)
        return
    opened = cluster_or_local(scheduler, workers, folder / "workers.log", lambda text: say(text, "yellow", err=True))
    with opened as executor:  # its processes start while the study is loaded
        found = load(path, sensitivity, samples, replaced)
        _run(found, path.stem, folder, executor, as_json, retry=retry, yes=yes)
    print_study(found, folder, as_json)
    if any(row["error"] for row in found.rows()):
        raise typer.Exit(TROUBLE)


def _run(found: Study, name: str, folder: Path, executor: Executor, as_json: bool, **given: bool) -> None:
    """Compute the missing points."""
    left, report = len(found), (lambda text: None) if as_json else partial(say, err=True)
    with steps(f"study {name}", len(found), silent=as_json, timed=False) as done:

        def each(point: Any, computed: Any, remain: int) -> None:
            nonlocal left
            done(computed.error.partition("\n")[0] or f"point {point.slot}", left - remain)
            left = remain

        try:
            with warnings.catch_warnings(action="ignore", category=PalpateWarning):  # `print_study` prints the notes
                found.run(folder, executor, report=report, done=each, **given)
        except KeyboardInterrupt as error:
            stored = sum(row["error"] != "not computed" for row in found.rows()) if found.folder else 0
            error.add_note(f"{stored} of {len(found)} points are stored in {folder}, the same command resumes")
            raise
