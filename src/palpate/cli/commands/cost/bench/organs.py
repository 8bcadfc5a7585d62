"""`palpate bench organs`: random touches of surfaces of all kinds, and the invariants that they break."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, NoPictures, out_option
from palpate.cli.terminal.output import print_json, say, write
from palpate.launch.run.progress import StageBars
from palpate.physics.errors import ArgumentError
from palpate.physics.extras import require_extra

EXAMPLE = "palpate bench organs --touches 500 --seed 1"


def organs(
    touches: Annotated[int, typer.Option(help="Number of touches.", min=1, max=10_000_000)] = 2000,
    seed: Annotated[int, typer.Option(help="Seed of the random touches.", min=0)] = 1,
    surface: Annotated[
        list[str] | None, typer.Option("--surface", help="Only this surface of the zoo; may be repeated.")
    ] = None,
    body: Annotated[list[str] | None, typer.Option(help="Only this body: MassSpring; may be repeated.")] = None,
    rate: Annotated[float | None, typer.Option(help="Only this rate, Hz.", min=100, max=20_000)] = None,
    fingers: Annotated[int | None, typer.Option(help="Only with this number of fingers.", min=1, max=2)] = None,
    worse: Annotated[int, typer.Option(help="Rounds that make each of the worst touches worse.", min=0)] = 0,
    pairs: Annotated[
        int, typer.Option(help="Touches of each smooth surface that are also turned, and put on a finer mesh.", min=0)
    ] = 0,
    widths: Annotated[
        int, typer.Option(help="Touches of each relation of a finger with a width: gaps, grooves, cuts.", min=0)
    ] = 0,
    results: Annotated[
        Path | None, typer.Option(help="File of results of --widths that a search adds to and resumes.")
    ] = None,
    fine: Annotated[bool, typer.Option("--fine", help="Also refine to 300 000 vertices: minutes per surface.")] = False,
    worst: Annotated[int, typer.Option(help="Number of the worst touches to print.", min=1)] = 10,
    out: Annotated[Path, out_option("Folder of meshes, report and pictures.")] = Path("organs"),
    no_pictures: NoPictures = False,
    as_json: Json = False,
) -> None:
    """Search for touches on which a force is not bounded or smooth.

    Touches surfaces of all kinds at random, as lanes of ensembles, and checks invariants (docs/your_organ.md). Prints
    the worst touches as commands. The exit code is 1 if an invariant is broken.
    """
    from palpate.physics.writable import check_folder
    from palpate.studies.organs.pairs import compare_pairs
    from palpate.studies.organs.pictures import draw_touches
    from palpate.studies.organs.report import plain, text, write_report
    from palpate.studies.organs.search import Results, search, worsen_touch
    from palpate.studies.organs.settings import choose_bodies
    from palpate.studies.organs.width_tasks import compare_widths
    from palpate.studies.organs.zoo import choose_specimens

    surfaces, bodies = choose_specimens(surface), choose_bodies(body)
    check_folder(out)
    meshes = (out / "meshes").absolute()
    with StageBars(silent=as_json) as bars:
        done = bars.begin(f"bench organs: {touches} touches", "")

        def show(share: float, so_far: Results) -> None:
            done(share, f"{sum(so_far.broken.values())} broken")

        found = search(surfaces, bodies, touches, seed, meshes, show, rate=rate, fingers=fingers, notes=True)
        if worse:
            leading = found.top(worst)
            done = bars.begin(f"make {len(leading)} touches worse", "")
            for number, one in enumerate(leading):
                better = worsen_touch(one, worse, seed + number, meshes)
                found.add(better.touch, better.invariant, better.score, counted=False)
                done((number + 1) / len(leading), f"{one.score.score:.3g} to {better.score.score:.3g} x its bound")
        if pairs:
            done = bars.begin("turn and refine", "", total=None)
            for pair in compare_pairs(surfaces, bodies, pairs, seed, meshes, fine):
                found.pairs.append(pair)
                done(0.0, f"{pair.invariant}: {pair.touch.setting.surface}, {pair.touch.setting.body}")
        if widths:
            done = bars.begin("relations of a finger with a width", "")
            with require_extra("bench organs --widths", "mesh", ArgumentError):
                for share, related, why in compare_widths(surfaces, bodies, widths, seed, meshes, results=results):
                    found.relate(related, why)
                    done(share, f"{found.related.total()} comparisons, {found.apart.total()} broken")
    files = write_report(found, meshes, out, worst)
    if not no_pictures:
        files |= draw_touches(found.top(worst), meshes, out)
    report = plain(found, meshes, worst)
    if as_json:
        print_json(report | {"files": {name: str(file) for name, file in files.items()}})
    else:
        write(text(found, meshes, worst))
        for name, file in files.items():
            say(f"{name:14} {file}")
    if not report["ok"]:
        raise typer.Exit(1)
