"""`palpate remote join`: run one group of a placement on this machine for a launcher elsewhere."""

import os
from typing import Annotated

import typer

from palpate.cli.terminal.options import trust_packages
from palpate.cli.terminal.output import write

EXAMPLE = "palpate remote join tcp://10.0.0.1:5600 loop"


def join(
    address: Annotated[str, typer.Argument(help="Address of the launcher, tcp://host:port.", metavar="ADDRESS")],
    group: Annotated[str, typer.Argument(help="Name of the group in the placement.", metavar="GROUP")],
    timeout: Annotated[float, typer.Option(help="Time to wait for the launcher, in s.", min=0.1)] = 60.0,
    key: Annotated[str, typer.Option(help="Key that secures the run; see `palpate remote keys`.")] = "rig",
    unencrypted: Annotated[bool, typer.Option("--unencrypted", help="For a run without encryption.")] = False,
    trust: Annotated[
        list[str] | None,
        typer.Option(
            "--trust",
            help="Import this package if the launcher names it; by default only code of palpate runs. May be repeated.",
            metavar="PACKAGE",
            callback=trust_packages,
        ),
    ] = None,
) -> None:
    """Run a group of a placement here, for a launcher elsewhere.

    The launcher on the other machine is `palpate run GRAPH --place FILE --address tcp://HOST:PORT`. It may start any
    node of palpate here, with any settings; other code only with --trust.
    """
    from palpate.compiler.arithmetic import environment

    host, _, port = address.removeprefix("tcp://").rpartition(":")
    if not host or not port.isdecimal():
        raise typer.BadParameter(f"address: found {address!r}, expected tcp://host:port")
    os.environ.update(environment())  # as in the launcher's workers; must precede the import of numpy
    from palpate.launch.run.wire import keys
    from palpate.launch.run.work.process import join as serve

    secured = None if unencrypted else keys.load(key)
    write(f"waiting up to {timeout:g} s for the launcher at {address}", err=True)
    raise typer.Exit(serve(address, group, timeout, secured))
