"""`palpate new scene`: a scene to change, from one that ships."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.templates import HERE, Folder, Force, Name, copied


def scene(
    name: Name,
    like: Annotated[str, typer.Option(help="Name of the shipped scene that is copied.")] = "kidney",
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a scene to change: a copy of one that ships, with its comments. It is valid as it stands."""
    copied("scene", name, like, out, force, as_json, "palpate run kidney --scene {file}")
