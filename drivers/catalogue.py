"""The devices that palpate knows: how each is found, which driver it has, and which permission a user needs."""

from dataclasses import dataclass

from palpate.drivers import falcon


@dataclass(frozen=True)
class Known:
    """One kind of device.

    name     as its maker calls it
    use      the node that drives it
    ids      USB vendor and product, both in hexadecimal of four digits
    through  "usb": its file of the system; "network": none
    needs    the module that the driver imports, "" for none
    """

    name: str
    use: str
    ids: tuple[tuple[str, str], ...]
    through: str
    needs: str


def _hex(number: int) -> str:
    return f"{number:04x}"


KNOWN = (
    Known(falcon.NAME, "device.Falcon", ((_hex(falcon.VENDOR), _hex(falcon.PRODUCT)),), "usb", "usb"),
    Known("Haply Inverse3", "device.Inverse3", (), "network", "websockets"),
    Known("ATI Net F/T", "sensor.NetFT", (), "network", ""),
)


def fitting(vendor: str, product: str) -> Known | None:
    for kind in KNOWN:
        for known_vendor, known_product in kind.ids:
            if vendor == known_vendor and product == known_product:
                return kind
    return None


RULE = "/etc/udev/rules.d/70-palpate.rules"


def udev_rules() -> str:
    """The text of a rules file that permits the user at the machine, and the group plugdev, to use all of them."""
    lines = ["# Devices that palpate drives. After a change: udevadm control --reload, then plug the device in again."]
    for kind in KNOWN:
        if not kind.ids:
            continue
        lines.append(f"# {kind.name}: {kind.use}")
        for vendor, product in kind.ids:
            grant = 'MODE="0660", GROUP="plugdev", TAG+="uaccess"'
            lines.append(
                f'SUBSYSTEM=="{kind.through}", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", {grant}'
            )
    return "\n".join(lines) + "\n"
