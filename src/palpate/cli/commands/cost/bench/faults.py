"""`palpate bench faults`: random faults of messages, nodes and processes in virtual time, and the invariants that they
break."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.launch.run.progress import StageBars

EXAMPLE = "palpate bench faults --seeds 100 --seed 1"


def faults(
    seeds: Annotated[
        int, typer.Option(help="Number of touches, or of runs, with faults.", min=1, max=10_000_000)
    ] = 100,
    seed: Annotated[int, typer.Option(help="The first seed.", min=0, max=2**53)] = 1,
    worst: Annotated[int, typer.Option(help="Number of the worst ones to print.", min=1)] = 5,
    launcher: Annotated[
        bool, typer.Option("--launcher", help="Faults of processes and of their connections, instead of messages.")
    ] = False,
    fingers: Annotated[int, typer.Option(help="Fingers of each touch, each on a separate device.", min=1, max=2)] = 1,
    out: Annotated[Path, out_option("Folder of the report.")] = Path("faults"),
    as_json: Json = False,
) -> None:
    """Search for faults after which a force is too large, is lost or stays.

    Runs touches by the rules of the real clock in virtual time: messages are lost, late or doubled, nodes stop, die and
    return, and the machine stalls (docs/proof.md). Prints the worst with the fewest faults that cause them. The exit
    code is 1 if an invariant is broken.

    With --launcher the faults are those of processes: workers and the fork server are killed, hang, fail or are stopped
    at any moment of a run, connections to other machines break, and the user presses Ctrl-C. Then the run must end and
    name the failed node.
    """
    from palpate.physics.writable import check_folder

    check_folder(out)
    if launcher:
        from palpate.studies.faults.launcher import report, search
    else:
        from palpate.studies.faults import report, search  # type: ignore[no-redef]
    if launcher and fingers != 1:
        raise typer.BadParameter("not with --launcher, whose runs have no hand", param_hint="--fingers")
    what = "runs" if launcher else "touches"
    with StageBars(silent=as_json) as bars:
        done = bars.begin(f"bench faults: {seeds} {what}", "")

        def show(share: float, found: Any) -> None:
            done(share, f"{found.broken.total()} broken")

        results: Any = search.search(seed, seeds, show, **({} if launcher else {"fingers": fingers}))
    files = report.write_report(results, out, worst)
    if as_json:
        print_json(report.plain(results, worst) | {"files": {name: str(file) for name, file in files.items()}})
    else:
        write(report.text(results, worst))
        for name, file in files.items():
            say(f"{name:14} {file}")
    if results.broken.total():
        raise typer.Exit(1)
