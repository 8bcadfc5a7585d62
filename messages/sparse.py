"""Messages whose plain default values are omitted on the wire."""

from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages.base import Message

NO_FLOATS = np.zeros(0)
NO_FLOATS.setflags(write=False)  # avoids a copy per message; as a default it is omitted on the wire by identity


def always_sent(value: Any) -> Any:
    """A default value that is nevertheless sent."""
    return msgspec.field(default_factory=lambda: value)


class Sparse(Message, frozen=True, kw_only=True, omit_defaults=True):
    """A message whose plain default values are omitted on the wire; the header is always sent."""

    tick: Annotated[int, "1"] = always_sent(-1)
    time: Annotated[int, "ns"] = always_sent(-1)
    source: Annotated[str, "1"] = always_sent("")
    used: Annotated[tuple[int, ...], "1", ("u",)] = always_sent(())
