"""`palpate doctor`: diagnostics of this machine, with remedies."""

from dataclasses import asdict
from typing import Annotated

import typer

from palpate.launch.terminal.options import Json
from palpate.launch.terminal.output import console, tell
from palpate.physics.errors import TROUBLE


def doctor(
    pictures: Annotated[bool, typer.Option(help="Test off-screen drawing; takes some seconds.")] = True,
    seconds: Annotated[
        float, typer.Option(help="Seconds for each of two measurements of wake-up latency; 0: none.", min=0, max=600)
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Check Python, packages, cores, wake-ups at 1 kHz, pictures and devices. Exit code 1 if palpate cannot run."""
    from palpate.launch.machine.findings import examine

    if as_json:
        findings = list(examine(pictures=pictures, seconds=seconds))
        tell({"ok": all(f.state != "fault" for f in findings), "diagnostics": [asdict(f) for f in findings]})
    else:
        from rich.text import Text

        colours = {"ok": "green", "note": "yellow", "fault": "red"}
        out = console(soft_wrap=True)
        findings = []
        for finding in examine(pictures=pictures, seconds=seconds):
            findings.append(finding)
            line = Text.assemble((f"{finding.state:6}", colours[finding.state]), f"{finding.what:20} {finding.found}")
            out.print(line)
            if finding.cure:
                out.print(Text(f"{'':27}{finding.cure}", style="dim"))
    if any(f.state == "fault" for f in findings):
        raise typer.Exit(TROUBLE)
