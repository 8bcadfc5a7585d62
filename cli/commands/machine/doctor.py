"""`palpate doctor`: diagnostics of this machine, with remedies."""

from dataclasses import asdict
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, tell
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate doctor --seconds 10"


def doctor(
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Do not test off-screen drawing.")] = False,
    seconds: Annotated[
        float, typer.Option(help="Seconds for each of two measurements of wake-up latency; 0: none.", min=0, max=600)
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Check this machine, with remedies.

    Python, packages, cores, wake-ups at 1 kHz, pictures and devices. Exit code 1 if palpate cannot run.
    """
    from rich.text import Text

    from palpate.cli.machine.findings import examine

    colours = {"ok": "green", "note": "yellow", "fault": "red"}
    out = console(soft_wrap=True, quiet=as_json)
    findings = []
    for finding in examine(pictures=not no_pictures, seconds=seconds):
        findings.append(finding)
        out.print(Text.assemble((f"{finding.state:6}", colours[finding.state]), f"{finding.what:20} {finding.found}"))
        if finding.cure:
            out.print(Text(f"{'':27}{finding.cure}", style="dim"))
    ok = all(finding.state != "fault" for finding in findings)
    if as_json:
        tell({"ok": ok, "diagnostics": [asdict(finding) for finding in findings]})
    if not ok:
        raise typer.Exit(TROUBLE)
