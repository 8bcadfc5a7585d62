"""`palpate build fe compare`: a finger on both plates, compared with the paper."""

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import console, drawn, print_json, table

EXAMPLE = "palpate build fe compare runs/fingertip/steel-calibrated-6-0.2 runs/fingertip/silicone-calibrated-6-0.2"


def compare(
    steel: Annotated[Path, typer.Argument(help="Folder of a run on steel, of `palpate build fe fingertip`.")],
    silicone: Annotated[Path, typer.Argument(help="Folder of a run on silicone.")],
    out: Annotated[Path, out_option("Folder for the pictures.")] = Path("runs/fingertip"),
    as_json: Json = False,
) -> None:
    """Compare runs on both plates with the paper.

    Prints which statements of the paper hold, and draws pictures like its Figures 3 to 5.
    """
    from palpate.models.fe.study.paper_claims import statements
    from palpate.models.fe.study.press_record import PressRun, check_pair
    from palpate.views.pictures.models.fe_fingertip import draw

    runs = {"steel": PressRun(steel), "silicone": PressRun(silicone)}
    check_pair(runs)
    rows = statements(*(run.record() for run in runs.values()))
    out.mkdir(parents=True, exist_ok=True)
    made = drawn(draw, runs, out)
    if as_json:
        print_json({"ok": True, "statements": rows, "pictures": [str(path) for path in made]})
        return
    _print(rows)
    for path in made:
        typer.echo(path)


def _print(rows: list[dict[str, Any]]) -> None:
    holds = {True: "yes", False: "no", None: "-"}
    plates = ("steel", "silicone")
    cells = (
        (row["statement"], *("-" if row[p] is None else f"{row[p]:.3g}" for p in plates), holds[row["holds"]])
        for row in rows
    )
    heads = ("the paper's statement", ">steel", ">silicone", ">holds")
    console().print(table(heads, cells, fixed=heads[1:]))
