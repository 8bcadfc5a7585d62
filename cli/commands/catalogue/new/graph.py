"""`palpate new graph`: a graph to change, from one that ships."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.templates import HERE, Folder, Force, Name, copied


def graph(
    name: Name,
    like: Annotated[str, typer.Option(help="Name of the shipped graph that is copied.")] = "kidney",
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a graph to change: a copy of one that ships, with its comments. It is valid as it stands."""
    copied("graph", name, like, out, force, as_json, "palpate check {file} && palpate run {file}")
