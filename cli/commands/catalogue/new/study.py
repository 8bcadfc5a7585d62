"""`palpate new study`: a study to change, from one that ships."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.templates import HERE, Folder, Force, Name, copied


def study(
    name: Name,
    like: Annotated[str, typer.Option(help="Name of the shipped study that is copied.")] = "kidney-stiffness",
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a study to change: a copy of one that ships, with its comments. It is valid as it stands."""
    copied("study", name, like, out, force, as_json, "palpate study {file}")
