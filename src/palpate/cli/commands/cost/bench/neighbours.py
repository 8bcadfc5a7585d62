"""`palpate bench neighbours`: random pairs and stacks of organs that touch, and the invariants that they break."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import print_json, write
from palpate.launch.run.progress import StageBars

EXAMPLE = "palpate bench neighbours --pairs 100 --stacks 100 --seed 1"


def neighbours(
    pairs: Annotated[int, typer.Option(help="Number of pairs that a finger presses.", min=0, max=10_000_000)] = 50,
    stacks: Annotated[int, typer.Option(help="Number of rows of organs on foundations.", min=0, max=10_000_000)] = 50,
    seed: Annotated[int, typer.Option(help="Seed of the random organs.", min=0, max=2**53)] = 0,
    first: Annotated[int, typer.Option(help="Number of the first pair and stack.", min=0, max=2**53)] = 0,
    worst: Annotated[int, typer.Option(help="Number of the worst to print.", min=1)] = 10,
    as_json: Json = False,
) -> None:
    """Search for organs that touch and overlap, gain energy or jump.

    Pairs of all bodies under a finger, and rows of two to four organs on foundations that hit each other: overlap,
    energy, momentum, change of the force on the hand, exchanged bodies (docs/equations/between.md). Prints the worst.
    The exit code is 1 if an invariant is broken.
    """
    from palpate.studies.neighbours_report import pair_row, stack_row, text
    from palpate.studies.organ_pairs import search
    from palpate.studies.organ_stacks import search_stacks

    if not pairs and not stacks:
        raise typer.BadParameter("found 0 pairs and 0 stacks, expected one of them above 0")
    found: dict[str, list[dict[str, Any]]] = {"pairs": [], "stacks": []}
    with StageBars(silent=as_json) as bars:
        for name, count in (("pairs", pairs), ("stacks", stacks)):
            if not count:
                continue
            done, broken = bars.begin(f"bench neighbours: {count} {name}", ""), 0
            rows = (
                (pair_row(each) for each in search(count, seed, first))
                if name == "pairs"
                else (stack_row(each) for each in search_stacks(count, seed, first))
            )
            for row in rows:
                found[name].append(row)
                broken += bool(row["faults"])
                done(len(found[name]) / count, f"{broken} with faults")
    if as_json:
        print_json(found)
    else:
        write(text(found, worst))
    if any(row["faults"] for rows in found.values() for row in rows):
        raise typer.Exit(1)
