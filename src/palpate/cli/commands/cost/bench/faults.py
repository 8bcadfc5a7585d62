"""`palpate bench faults`: random faults of messages and nodes in virtual time, and the invariants that they break."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.launch.run.progress import StageBars

EXAMPLE = "palpate bench faults --seeds 100 --seed 1"


def faults(
    seeds: Annotated[int, typer.Option(help="Number of touches with faults.", min=1, max=10_000_000)] = 100,
    seed: Annotated[int, typer.Option(help="The first seed.", min=0, max=2**53)] = 1,
    worst: Annotated[int, typer.Option(help="Number of the worst touches to print.", min=1)] = 5,
    out: Annotated[Path, out_option("Folder of the report.")] = Path("faults"),
    as_json: Json = False,
) -> None:
    """Search for faults after which a force is too large, is lost or stays.

    Runs touches by the rules of the real clock in virtual time: messages are lost, late or doubled, nodes stop, die and
    return, and the machine stalls (docs/proof.md). Prints the worst with the fewest faults that cause them. The exit
    code is 1 if an invariant is broken.
    """
    from palpate.physics.writable import check_folder
    from palpate.studies.faults.report import plain, text, write_report
    from palpate.studies.faults.search import Results, search

    check_folder(out)
    with StageBars(silent=as_json) as bars:
        done = bars.begin(f"bench faults: {seeds} touches", "")

        def show(share: float, found: Results) -> None:
            done(share, f"{found.broken.total()} broken")

        results = search(seed, seeds, show)
    files = write_report(results, out, worst)
    if as_json:
        print_json(plain(results, worst) | {"files": {name: str(file) for name, file in files.items()}})
    else:
        write(text(results, worst))
        for name, file in files.items():
            say(f"{name:14} {file}")
    if results.broken.total():
        raise typer.Exit(1)
