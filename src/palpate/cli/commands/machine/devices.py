"""`palpate devices`: connected devices, their nodes and your permissions."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, say, table
from palpate.physics.archive import replace_text
from palpate.physics.errors import RunError

EXAMPLE = "palpate devices --json"


def devices(
    install_udev: Annotated[
        bool, typer.Option("--install-udev", help="Write the udev rule that lets you use them. Needs root.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List connected devices, their permissions and the next step.

    Without hardware, `port: emulator` on a device's node runs the whole graph with an emulator of its protocol.
    """
    if install_udev:
        _install(as_json)
    else:
        _list(as_json)


def _install(as_json: bool) -> None:
    from palpate.drivers.discover import RULE, udev_rules

    try:
        Path(RULE).parent.stat()  # without udev, a rule has no effect
        replace_text(Path(RULE), udev_rules())
    except OSError as error:
        cure = "Run it as root: sudo $(which palpate) devices --install-udev"
        raise RunError(f"{RULE}: {error.strerror}. {cure}") from None
    text = "Now: sudo udevadm control --reload && sudo udevadm trigger; or plug the devices in again."
    if as_json:
        print_json({"ok": True, "file": RULE, "text": text})
    else:
        say(f"Wrote {RULE}. {text}")


def _list(as_json: bool) -> None:
    from palpate.drivers.discover import devices as plugged

    usb_devices = list(plugged())
    if as_json:
        print_json({"ok": True, "devices": [{**asdict(f), "next": f.next_step} for f in usb_devices]})
        return
    if not usb_devices:
        say("No known device on USB. Network devices (Inverse3, Net F/T) are not listed: give their address as `port`.",
            wrap=True)  # fmt: skip
        say("Nothing to do: `port: emulator` runs without one.", "dim", wrap=True)
        return
    rows = ((f"{f.name} {f.ids}", f.use, f.port, f.next_step or "ready") for f in usb_devices)
    console().print(table(("device", "node", "port", "next step"), rows))
