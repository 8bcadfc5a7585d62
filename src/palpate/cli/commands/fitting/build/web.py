"""`palpate build web`: a graph as a page that runs in a browser, without a server."""

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import print_json, say
from palpate.cli.terminal.run_options import RunOptions, takes_run

EXAMPLE = "palpate build web kidney -o site/"


@takes_run("kidney")
def web(
    chosen: RunOptions,
    scene: Annotated[
        list[str] | None,
        typer.Option("--scene", help="Scene to use instead of the graph's; several: the page has a switch."),
    ] = None,
    organ: Annotated[
        list[Path] | None,
        typer.Option(
            "--organ", help="Organ instead of the scene's: mesh (.stl, .ply, .obj), segmentation (.nii.gz, .nrrd ...)."
        ),
    ] = None,
    out: Annotated[Path, out_option("New or empty folder for the page.")] = Path("site"),
    bodies: Annotated[
        list[str] | None, typer.Option("--body", help="A body to offer, as MassSpring; by default all that fit.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Build a page that runs a graph in a browser.

    The page is that of `palpate touch`; the nodes run in it as WebAssembly, with the bytes of a run. Open index.html,
    or put the folder on any static server.
    """
    from palpate.bases import build_missing
    from palpate.launch.run.progress import StageBars
    from palpate.studies.body_figures import measure_bodies
    from palpate.web.folder import build, check_empty
    from palpate.web.variants import Place

    check_empty(out)
    scenes: list[str | None] = [*scene] if scene else [None]
    organs: list[Path | None] = [*organ] if organ else [None]
    places = []
    for one, file in itertools.product(scenes, organs):
        launch = replace(chosen, scene=one, organ=file).launch(silent=as_json)
        build_missing(launch.load(), quiet=as_json)
        places.append(Place(launch, Path(one).stem if one else "", file.name.partition(".")[0] if file else ""))
    with StageBars(as_json) as stages:
        built = build(places, out, bodies or [], lambda name: stages.begin(name, ""), measure_bodies)
    page = out / "index.html"
    if as_json:
        print_json({"page": str(page), **vars(built)})
        return
    for node, why in built.left_out.items():
        say(f"left out: {node}, {why}", "yellow")
    say(f"{page}: {built.variants} variants, {built.whole / 1e6:.1f} MB in all")
    say(f"the page loads {built.first / 1e6:.2f} MB at first, with {built.code / 1e3:.0f} kB of code")
