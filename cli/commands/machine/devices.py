"""`palpate devices`: connected devices, their nodes and your permissions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, say, table, tell
from palpate.physics.errors import TROUBLE

if TYPE_CHECKING:
    from palpate.drivers.discover import Found

EXAMPLE = "palpate devices --probe"


def devices(
    install_udev: Annotated[
        bool, typer.Option("--install-udev", help="Write the udev rule that lets you use them. Needs root.")
    ] = False,
    probe: Annotated[
        bool, typer.Option("--probe", help="Open the devices that need firmware, and report whether it runs.")
    ] = False,
    as_json: Json = False,
) -> None:
    """List connected devices, their permissions and the next step.

    Without hardware, `port: emulator` on a device's node runs the whole graph with an emulator of its protocol.
    """
    if install_udev:
        _install(as_json)
    else:
        _list(probe, as_json)


def _install(as_json: bool) -> None:
    from palpate.drivers.catalogue import RULE, udev_rules

    ok, text = True, "Now: sudo udevadm control --reload && sudo udevadm trigger; or plug the devices in again."
    try:
        Path(RULE).write_text(udev_rules(), encoding="utf-8")
    except OSError as error:
        ok, text = False, f"{RULE}: {error.strerror}. Run it as root: sudo $(which palpate) devices --install-udev"
    if as_json:
        tell({"ok": ok, "file": RULE, "text": text})
    else:
        say(f"Wrote {RULE}. {text}" if ok else text, "" if ok else "red", err=not ok)
    if not ok:
        raise typer.Exit(TROUBLE)


def _list(probe: bool, as_json: bool) -> None:
    from palpate.drivers.discover import devices as plugged

    usb_devices = list(plugged())
    firmware = {f.port: _firmware_of(f) if probe else "" for f in usb_devices}
    if as_json:
        listing = [{**asdict(f), "firmware": firmware[f.port], "next": f.next_step} for f in usb_devices]
        tell({"ok": True, "devices": listing})
        return
    if not usb_devices:
        say("No known device on USB. Network devices (Inverse3, Net F/T) are not listed: give their address as `port`.",
            wrap=True)  # fmt: skip
        say("Nothing to do: `port: emulator` runs without one.", "dim", wrap=True)
        return
    rows = (
        (f"{f.name} {f.ids}", f.use, f.port or "-", f.bound or "-", firmware[f.port] or "-", f.next_step or "ready")
        for f in usb_devices
    )
    console().print(table(("device", "node", "port", "kernel driver", "firmware", "next step"), rows))


def _firmware_of(usb_device: Found) -> str:
    """Whether a Falcon has its firmware, or why that is not known; nothing is loaded, and no force commanded."""
    from palpate.drivers import falcon
    from palpate.drivers.errors import DeviceError
    from palpate.drivers.falcon import driver
    from palpate.drivers.transport import ftdi

    if usb_device.use != "device.Falcon" or usb_device.next_step:
        return ""
    device = driver.FalconDriver(lambda: ftdi.UsbFtdi(falcon.VENDOR, falcon.PRODUCT, falcon.NAME, usb_device.port))
    try:
        device.open()
    except DeviceError as error:
        return "none runs: give the setting `firmware`" if "no firmware" in str(error) else str(error)
    finally:
        device.close()
    return "runs"
