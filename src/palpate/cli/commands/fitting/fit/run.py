"""`palpate fit run RECORDING --free ... --to ...`: parameters of a graph that explain recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.fitted_run import print_run_fit, write_run_fit
from palpate.cli.terminal.options import Force, Json, Sets, check_new, out_option
from palpate.cli.terminal.output import print_json

EXAMPLE = "palpate fit run press.mcap --free tissue.stiffness tissue.retardation --to contact.force -o fit"


def run(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings; all are fitted together.")],
    free: Annotated[
        list[str], typer.Option(help="A numeric setting to fit, such as tissue.stiffness; more may follow it.")
    ],
    to: Annotated[list[str] | None, typer.Option(help="A recorded field to explain.")] = None,
    each: Annotated[list[str] | None, typer.Option(help="A free setting that each recording has for itself.")] = None,
    prior: Annotated[
        list[str] | None,
        typer.Option(
            help="Prior of a free setting: NAME=normal:MEAN,DEVIATION, NAME=lognormal:MEDIAN,FACTOR, or a tissue."
        ),
    ] = None,
    holdout: Annotated[list[Path] | None, typer.Option(help="A recording that is predicted, not fitted.")] = None,
    graph: Annotated[str | None, typer.Option(help="A graph instead of the recorded one.")] = None,
    scene: Annotated[str | None, typer.Option(help="A scene instead of the recorded one.")] = None,
    sets: Sets = None,
    until: Annotated[str | None, typer.Option(help="Leave out what follows: '2 s'.")] = None,
    starts: Annotated[int, typer.Option(help="Number of starts of the search.", min=1, max=20)] = 3,
    plan: Annotated[bool, typer.Option("--plan", help="Compare motions by the intervals they would give.")] = False,
    out: Annotated[Path, out_option("Folder for the launch file, report and picture.")] = Path("fit"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Fit settings of a graph to recordings: the recorded motion drives the graph again.

    Bounded least squares from several starts, with 95 % intervals that allow for correlated noise. Says which settings
    the motion does not determine, and which motion would. Writes a launch file with the fitted settings, report.json
    and a picture of fit and residuals.
    """
    from palpate.cli.terminal.options import seconds
    from palpate.launch.run.progress import steps
    from palpate.studies.inverse.fit import fit_run
    from palpate.studies.inverse.motions import plan_touches
    from palpate.studies.inverse.opening import read_run
    from palpate.studies.inverse.report import WRITTEN, cures

    # `--free a b c`: words that name no file continue the list
    paths = [path for path in recordings if path.exists() or not _is_setting(path)]
    more = [str(path) for path in recordings if path not in paths]
    names = [name for text in [*free, *more] for name in text.replace(",", " ").split()]
    if not paths:
        raise typer.BadParameter("expected a recording before --free")
    check_new([out / name for name in WRITTEN], force)
    fields, length = to or ["contact.force"], seconds(until) if until else None
    read = [read_run(path, fields, graph, scene, sets or (), length) for path in paths]
    others = [read_run(path, fields, graph, scene, sets or (), length) for path in holdout or []]
    with steps(f"fit run: {len(names)} settings, {len(read)} recordings", 1, silent=as_json, timed=False) as done:
        fit = fit_run(
            read, names, each or (), others, starts, priors=prior or (), report=lambda share: done("runs", share)
        )
        planned = plan_touches(fit, read[0]) if plan or fit.open_ else []
    result = write_run_fit(fit, planned, out)
    if as_json:
        print_json({"ok": True, "out": str(out)} | result)
    else:
        print_run_fit(fit, planned if plan else [], cures(fit, planned, read[0]), out)


def _is_setting(path: Path) -> bool:
    """Whether a word that is no file looks like a setting: tissue.stiffness."""
    return "/" not in str(path) and path.suffix.lower() not in (".mcap", ".csv", ".txt", ".xlsx")
