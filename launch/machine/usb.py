"""Devices on USB: whether their firmware runs, and what is to be done before they can be used."""

from __future__ import annotations

from palpate.drivers.discover import Found
from palpate.physics.extras import install


def firmware_of(usb_device: Found) -> str:
    """Whether a Falcon has its firmware, or why that is not known; nothing is loaded, and no force commanded."""
    from palpate.drivers import falcon
    from palpate.drivers.errors import DeviceError
    from palpate.drivers.falcon import driver
    from palpate.drivers.transport import ftdi

    if usb_device.use != "device.Falcon" or next_step(usb_device):
        return ""
    device = driver.FalconDriver(lambda: ftdi.UsbFtdi(falcon.VENDOR, falcon.PRODUCT, falcon.NAME, usb_device.port))
    try:
        device.open()
    except DeviceError as error:
        return "none runs: give the setting `firmware`" if "no firmware" in str(error) else str(error)
    finally:
        device.close()
    return "runs"


def next_step(usb_device: Found) -> str:
    """What stands in the way; empty: nothing."""
    if usb_device.missing:
        return install("devices")
    if not usb_device.file:
        return "no device file: its kernel driver is not bound"
    if not usb_device.permitted:
        return "not permitted: palpate devices --install-udev"
    return ""
