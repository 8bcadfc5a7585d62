"""`palpate devices`: connected devices, their nodes and your permissions."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.launch.commands.common import MISUSE, TROUBLE, Json, console, tell

if TYPE_CHECKING:
    from palpate.drivers.discover import Found
    from palpate.drivers.guard import DeviceSample


def devices(
    install_udev: Annotated[
        bool, typer.Option("--install-udev", help="Write the udev rule that lets you use them. Needs root.")
    ] = False,
    probe: Annotated[
        bool, typer.Option("--probe", help="Open the devices that need firmware, and report whether it runs.")
    ] = False,
    emulate: Annotated[
        str | None, typer.Option(help="Run an emulator instead and print its answers: falcon, rawhid, ...")
    ] = None,
    seconds: Annotated[float, typer.Option(help="How long to run it.", min=0.1, max=3600)] = 3.0,
    as_json: Json = False,
) -> None:
    """List the devices on this machine: node, port, permissions and the next step.

    Without hardware, `port: emulator` on a device's node runs the whole graph with an emulator of its protocol.
    """
    if install_udev:
        _install(as_json)
    elif emulate is not None:
        _emulate(emulate, seconds, as_json)
    else:
        _list(probe, as_json)


def _install(as_json: bool) -> None:
    from palpate.drivers.catalogue import RULE, udev_rules

    try:
        Path(RULE).write_text(udev_rules(), encoding="utf-8")
    except OSError as error:
        text = f"{RULE}: {error.strerror}. Run it as root: sudo $(which palpate) devices --install-udev"
        if as_json:
            tell({"ok": False, "file": RULE, "text": text})
        else:
            from rich.text import Text

            console(stderr=True, soft_wrap=True).print(Text(text, style="red"))
        raise typer.Exit(TROUBLE) from None
    text = "Now: sudo udevadm control --reload && sudo udevadm trigger; or plug the devices in again."
    if as_json:
        tell({"ok": True, "file": RULE, "text": text})
    else:
        typer.echo(f"Wrote {RULE}. {text}")


def _list(probe: bool, as_json: bool) -> None:
    from palpate.drivers.discover import devices as plugged

    usb_devices = list(plugged())
    firmware = {f.port: _firmware(f) if probe else "" for f in usb_devices}
    if as_json:
        listing = [{**asdict(f), "firmware": firmware[f.port], "next": _next(f)} for f in usb_devices]
        tell({"ok": True, "devices": listing})
        return
    from rich.table import Table
    from rich.text import Text

    out = console()
    if not usb_devices:
        out.print(
            "No known device on USB. Network devices (Inverse3, Net F/T) are not listed: give their address as `port`."
        )
        out.print(Text("Nothing to do: `port: emulator` runs without one.", style="dim"))
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("device", "node", "port", "kernel driver", "firmware", "next step"):
        table.add_column(title)
    for f in usb_devices:
        cells = (
            f"{f.name} {f.ids}",
            f.use,
            f.port or "-",
            f.bound or "-",
            firmware[f.port] or "-",
            _next(f) or "ready",
        )
        table.add_row(*map(Text, cells))
    out.print(table)


def _firmware(usb_device: Found) -> str:
    """Whether a Falcon has its firmware, or why that is not known; nothing is loaded, and no force commanded."""
    from palpate.drivers import falcon
    from palpate.drivers.errors import DeviceError
    from palpate.drivers.falcon import driver
    from palpate.drivers.transport import ftdi

    if usb_device.use != "device.Falcon" or _next(usb_device):
        return ""
    device = driver.FalconDriver(lambda: ftdi.UsbFtdi(falcon.VENDOR, falcon.PRODUCT, falcon.NAME, usb_device.port))
    try:
        device.open()
    except DeviceError as error:
        return "none runs: give the setting `firmware`" if "no firmware" in str(error) else str(error)
    finally:
        device.close()
    return "runs"


def _next(usb_device: Found) -> str:
    if usb_device.missing:
        return 'pip install "palpate[devices]"'
    if not usb_device.file:
        return "no device file: its kernel driver is not bound"
    if not usb_device.permitted:
        return "not permitted: palpate devices --install-udev"
    return ""


def _emulate(name: str, seconds: float, as_json: bool) -> None:
    """Run the driver of a device against its emulator and count what comes back."""
    import time

    from palpate.engine.faults import choices
    from palpate.launch.load.classes import catalogue
    from palpate.nodes.base.wired import Wired

    kinds = [entry.cls for entry in catalogue()[0]]
    known = {kind.__name__.lower(): kind for kind in kinds if issubclass(kind, Wired) and kind.paced}
    kind = known.get(name.lower())
    if kind is None:
        raise typer.BadParameter(f"--emulate: found {name!r}. {choices('Devices', name.lower(), sorted(known))}")
    node = kind(port="emulator")
    node.start()
    try:
        end, lines = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            sample = node.talk((0.0,) * node.exchange.driver.size, 1e-3)
            if not as_json and lines < 10 and time.monotonic() > end - seconds + lines * seconds / 10:
                lines += 1
                typer.echo(_told(sample))
            time.sleep(1e-3)
        counts = {"ok": node.exchange.answers > 0, "device": kind.__name__, "cycles": node.exchange.cycles,
                "answers": node.exchange.answers, "rate": node.exchange.answers / seconds}  # fmt: skip
    finally:
        node.stop()
    if as_json:
        tell(counts)
    else:
        typer.echo(f"{counts['answers']} answers of {counts['cycles']} cycles in {seconds:g} s")
    if not counts["ok"]:
        raise typer.Exit(MISUSE)


def _told(sample: DeviceSample | None) -> str:
    if sample is None:
        return "no answer yet"
    if sample.wrench:
        return "wrench " + ", ".join(f"{w:.3f}" for w in sample.wrench)
    if not sample.homed:
        return "not homed"
    place = ", ".join(f"{1e3 * p:.2f}" for p in sample.position)
    return f"position {place} mm, buttons {sample.buttons:b}"
