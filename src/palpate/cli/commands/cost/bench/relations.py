"""`palpate bench relations`: random scenes, and the relations between runs that they break."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.launch.run.progress import StageBars

EXAMPLE = "palpate bench relations --comparisons 300 --seed 1"


def relations(
    comparisons: Annotated[int, typer.Option(help="Number of comparisons of runs.", min=1, max=10_000_000)] = 1000,
    seed: Annotated[int, typer.Option(help="Seed of the random scenes.", min=0)] = 1,
    relation: Annotated[
        list[str] | None, typer.Option("--relation", help="Only this relation: turned; may be repeated.")
    ] = None,
    body: Annotated[list[str] | None, typer.Option(help="Only this body: MassSpring; may be repeated.")] = None,
    worst: Annotated[int, typer.Option(help="Number of the worst comparisons to print.", min=1)] = 5,
    out: Annotated[Path, out_option("Folder of meshes and report.")] = Path("relations"),
    as_json: Json = False,
) -> None:
    """Search for scenes in which a change does not have the effect that it must have.

    Draws scenes at random, changes each in ways of known effect (docs/proof.md) and compares the runs. Prints the worst
    comparisons as commands. The exit code is 1 if a relation is broken.
    """
    from palpate.physics.writable import check_folder
    from palpate.studies.relations.draw import choose_bodies
    from palpate.studies.relations.report import plain, text, write_report
    from palpate.studies.relations.rules import choose_relations
    from palpate.studies.relations.search import Results, search

    chosen, bodies = choose_relations(relation), choose_bodies(body)
    check_folder(out)
    with StageBars(silent=as_json) as bars:
        done = bars.begin(f"bench relations: {comparisons} comparisons", "")

        def show(share: float, found: Results) -> None:
            done(share, f"{found.broken.total()} broken")

        results = search(chosen, comparisons, seed, (out / "meshes").absolute(), show, bodies=bodies)
    files = write_report(results, chosen, out, worst)
    if as_json:
        print_json(plain(results, chosen, worst) | {"files": {name: str(file) for name, file in files.items()}})
    else:
        write(text(results, chosen, worst))
        for name, file in files.items():
            say(f"{name:14} {file}")
    if results.broken.total():
        raise typer.Exit(1)
