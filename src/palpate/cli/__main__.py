"""The command `palpate`. Each command imports its modules when it runs, so that help and listings start at once."""

import gc
import signal
import sys
import threading

_here = threading.current_thread() is threading.main_thread()
_before = signal.getsignal(signal.SIGINT)
if _here:  # Ctrl-C during the imports below ends the program at once, without a traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from typing import Annotated  # noqa: E402

import typer  # noqa: E402

from palpate.cli import commands  # noqa: E402
from palpate.cli.terminal.group import Verbs, group  # noqa: E402
from palpate.compiler.arithmetic import pin  # noqa: E402
from palpate.registry import with_room  # noqa: E402

COLLECTION = (700, 50, 20)
"""Thresholds of garbage collection, for 10 % of the usual full ones: imports make a million objects that stay."""

app = group(commands, commands.HELP, cls=Verbs, pretty_exceptions_enable=False)


def _version(value: bool) -> None:
    if value:
        from importlib.metadata import version

        typer.echo(f"palpate {version('palpate')}")
        raise typer.Exit


@app.callback(help=commands.HELP)
def _top(
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    pass


if _here:
    signal.signal(signal.SIGINT, _before)


def main() -> None:
    """Run the command line. Ctrl-C outside a command exits without a traceback."""
    pin()  # before a command imports numpy
    gc.set_threshold(*COLLECTION)
    try:
        with_room(app, prog_name="palpate")
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)


if __name__ == "__main__":
    main()
