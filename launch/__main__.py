"""The command `palpate`. Each verb imports what it needs when it runs, so that help and listings answer at once."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.launch.commands import verbs
from palpate.launch.commands.common import Verbs

app = typer.Typer(
    cls=Verbs,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="What a fingertip feels on soft tissue: a graph of message-passing nodes.",
)


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        typer.echo(f"palpate {version('palpate')}")
        raise typer.Exit


@app.callback()
def _top(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    """What a fingertip feels on soft tissue: a graph of message-passing nodes."""


for _name, _verb, _kind in verbs():
    if isinstance(_verb, typer.Typer):
        app.add_typer(_verb, name=_name)
    else:
        app.command(cls=_kind)(_verb)


def main() -> None:
    """Run the command line."""
    app(prog_name="palpate")


if __name__ == "__main__":
    main()
