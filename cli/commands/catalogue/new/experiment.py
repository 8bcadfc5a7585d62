"""`palpate new experiment`: an experiment to change, from one that ships."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.templates import HERE, Folder, Force, Name, copied


def experiment(
    name: Name,
    like: Annotated[str, typer.Option(help="Name of the shipped experiment that is copied.")] = "kidney-stiffness",
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write an experiment to change: a copy of one that ships, with its comments. It is valid as it stands."""
    copied("experiment", name, like, out, force, as_json, "palpate experiment {file} --simulate")
