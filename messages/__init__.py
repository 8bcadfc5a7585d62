"""The typed messages that nodes exchange, with the unit and shape of each field, and their wire form."""

import sys
from typing import TYPE_CHECKING, Any

from palpate.messages.base import Message, pack, unpack
from palpate.messages.checks import check_finite
from palpate.messages.contact import Contact, Contacts, Friction, Load, Proximity
from palpate.messages.device import DeviceState, Force, Pointed, Pose, Torque
from palpate.messages.display import Pins
from palpate.messages.fields import Field, Floats, Ints, MessageError, Vector, Vector2, Vector3, fields
from palpate.messages.health import Health
from palpate.messages.ledger import Ledger
from palpate.messages.slip import Slip
from palpate.messages.tactile import Spikes, Subsurface, Tactile
from palpate.messages.tissue import Surface
from palpate.messages.uncertainty import ForceBand
from palpate.registry import find

__all__ = [
    "Contact", "Contacts", "DeviceState", "Field", "Floats", "Force", "ForceBand", "Friction", "Health", "Ints",
    "Ledger", "Load", "Message", "MessageError", "Pins", "Pointed", "Pose", "Proximity", "Slip", "Spikes", "Subsurface",
    "Surface", "Tactile", "Torque", "Vector", "Vector2", "Vector3", "check_finite", "fields", "pack", "unpack",
]  # fmt: skip

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """A message type from any other file of this folder."""
        kind = find(sys.modules[__name__], name, Message) if name[:1].isupper() else None
        if kind is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return kind
