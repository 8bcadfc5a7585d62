"""`palpate doctor`: diagnostics of this machine, with remedies."""

from dataclasses import asdict
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate doctor --seconds 10"


def doctor(
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Do not test off-screen drawing.")] = False,
    seconds: Annotated[
        float, typer.Option(help="Seconds for each of two measurements of wake-up latency; 0: none.", min=0, max=600)
    ] = 2.0,
    compile_first: Annotated[
        bool, typer.Option("--compile", help="First compile the kernels of the usual graphs.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check this machine, and print remedies.

    Python, packages, kernels, cores, wake-ups at 1 kHz, pictures and devices. Exit code 1 if palpate cannot run.
    """
    from rich.text import Text

    from palpate.cli.machine.diagnostics import examine

    if compile_first:
        from palpate.cli.machine.kernels import compile_usual

        compile_usual()
    colours = {"ok": "green", "note": "yellow", "fault": "red"}
    out = console(soft_wrap=True, quiet=as_json)
    diagnostics = []
    for one in examine(pictures=not no_pictures, seconds=seconds):
        diagnostics.append(one)
        out.print(Text.assemble((f"{one.state:6}", colours[one.state]), f"{one.what:20} {one.found}"))
        if one.cure:
            out.print(Text(f"{'':27}{one.cure}", style="dim"))
    ok = all(one.state != "fault" for one in diagnostics)
    if as_json:
        print_json({"ok": ok, "diagnostics": [asdict(one) for one in diagnostics]})
    if not ok:
        raise typer.Exit(TROUBLE)
