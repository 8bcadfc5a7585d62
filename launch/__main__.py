"""The command `palpate`. Each verb imports what it needs when it runs, so that help and listings answer at once."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.launch.commands.check import check
from palpate.launch.commands.common import Verbs
from palpate.launch.commands.compare import compare
from palpate.launch.commands.devices import devices
from palpate.launch.commands.doctor import doctor
from palpate.launch.commands.echo import echo
from palpate.launch.commands.export import export
from palpate.launch.commands.fe import fe
from palpate.launch.commands.fingertip import fingertip
from palpate.launch.commands.fit import fit
from palpate.launch.commands.indentation import record_indentation
from palpate.launch.commands.info import info
from palpate.launch.commands.join import join
from palpate.launch.commands.keys import keys
from palpate.launch.commands.messages import messages
from palpate.launch.commands.new import new
from palpate.launch.commands.nodes import nodes
from palpate.launch.commands.pictures import pictures
from palpate.launch.commands.plan import PlanCommand, plan
from palpate.launch.commands.recover import recover
from palpate.launch.commands.reduce import reduce
from palpate.launch.commands.replay import replay
from palpate.launch.commands.run import run
from palpate.launch.commands.top import top

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


app.command()(run)
app.command()(check)
app.command()(replay)
app.command()(compare)
app.command()(info)
app.command()(echo)
app.command()(top)
app.command()(export)
app.command()(recover)
app.command(cls=PlanCommand)(plan)
app.command()(nodes)
app.command()(messages)
app.command()(pictures)
app.command()(doctor)
app.command()(devices)
app.command()(reduce)
app.command()(fit)
app.command()(record_indentation)
app.command()(join)
app.command()(keys)
app.command()(fingertip)
app.add_typer(new, name="new")
app.add_typer(fe, name="fe")


def main() -> None:
    """Run the command line."""
    app(prog_name="palpate")


if __name__ == "__main__":
    main()
