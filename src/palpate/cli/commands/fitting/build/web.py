"""`palpate build web`: a graph as a page that runs in a browser, without a server."""

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
    from palpate.web.folder import build, check_empty

    check_empty(out)
    launch = chosen.launch(silent=as_json)
    build_missing(launch.load(), quiet=as_json)
    with StageBars(as_json) as stages:
        built = build(launch, out, bodies or [], lambda name: stages.begin(name, ""))
    page = out / "index.html"
    if as_json:
        print_json({"page": str(page), **vars(built)})
        return
    for node, why in built.left_out.items():
        say(f"left out: {node}, {why}", "yellow")
    say(f"{page}: {built.variants} variants, {built.whole / 1e6:.1f} MB in all")
    say(f"the page loads {built.first / 1e6:.2f} MB at first, with {built.code / 1e3:.0f} kB of code")
