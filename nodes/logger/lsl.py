"""Streams for the Lab Streaming Layer (https://labstreaminglayer.org), by which experiments record force beside EEG,
gaze or markers on one clock."""

import socket
import time
from typing import Annotated, Any

import msgspec

from palpate.messages import Field, Message, fields, unpack
from palpate.nodes.base import Observer, SettingError, Stream
from palpate.physics.extras import install, missing

SETTLE = 1.0
"""[s] that listeners have to fetch the last samples: recorders look twice a second, and what is under way then is lost
with the outlet."""


class LSL(Observer):
    """Sends chosen numbers of its streams to the Lab Streaming Layer, each stream of the graph as one of LSL.

    A stream of LSL is called `NAME.STREAM`, its type is that of the message, and each of its channels has label and
    unit, `force[0]` in N. Samples have the graph's time, carried over to LSL's clock: of the tick, not of the sending.
    """

    fields: Annotated[tuple[str, ...], "1", msgspec.Meta(min_length=1)]
    """Fields to send, of each stream that has them: numbers, flags and vectors of fixed length."""
    name: Annotated[str, "1", msgspec.Meta(min_length=1)] = "palpate"  # Tells rigs in one network apart

    def start(self) -> None:
        lsl = library()
        chosen = {stream.name: chosen_fields(stream, self.fields) for stream in self.streams}
        unheard = [name for name in self.fields if not any(f.name == name for own in chosen.values() for f in own)]
        if unheard:
            raise SettingError(f"fields: none of the streams {', '.join(chosen)} has a field {unheard[0]!r}")
        self._kinds = {stream.name: stream.type for stream in self.streams}
        self._picks = {name: [field.name for field in own] for name, own in chosen.items()}
        rate = float(self.about["plan"]["rate"])
        self._outlets = {
            stream.name: lsl.StreamOutlet(self._info(lsl, stream, chosen[stream.name], rate / stream.every))
            for stream in self.streams
        }
        self._ahead = lsl.local_clock() - time.monotonic()
        self._begin = lsl.local_clock()

    def _info(self, lsl: Any, stream: Stream, chosen: tuple[Field, ...], rate: float) -> Any:
        labels = [(label, field.unit) for field in chosen for label in _labels(field)]
        name = f"{self.name}.{stream.name}"
        info = lsl.StreamInfo(
            name, stream.type.__name__, len(labels), rate, lsl.cf_double64, f"{name} on {socket.gethostname()}"
        )
        channels = info.desc().append_child("channels")
        for label, unit in labels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", label)
            channel.append_child_value("unit", unit)
        info.desc().append_child_value("manufacturer", "palpate")
        return info

    def begun(self, origin: int) -> None:
        self._begin = origin * 1e-9 + self._ahead

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        outlet = self._outlets.get(stream)
        if outlet is None or not outlet.have_consumers():
            return
        message = unpack(payload, self._kinds[stream])
        outlet.push_sample(sample(message, self._picks[stream]), self._begin + message.time * 1e-9)

    def stop(self) -> None:
        if any(outlet.have_consumers() for outlet in self.__dict__.get("_outlets", {}).values()):
            time.sleep(SETTLE)
        self._outlets = {}


def chosen_fields(stream: Stream, names: tuple[str, ...]) -> tuple[Field, ...]:
    """Those of these fields that a stream has. SettingError: it has none of them, or one without a fixed number of
    numbers."""
    own = fields(stream.type)
    chosen = tuple(field for field in own if field.name in names)
    if not chosen:
        can = [field.name for field in own if _labels(field)]
        raise SettingError(
            f"fields: stream {stream.name!r} has none of {', '.join(names)}; it can send {', '.join(can) or 'none'}"
        )
    for field in chosen:
        if not _labels(field):
            raise SettingError(f"fields: {stream.name}.{field.name} is a text or an array of changing length; "
                               "expected a number, a flag or a vector of fixed length")  # fmt: skip
    return chosen


def sample(message: Message, names: list[str]) -> list[float]:
    """The numbers of these fields, one after the other; a flag is 0 or 1."""
    values: list[float] = []
    for name in names:
        value = getattr(message, name)
        values += map(float, value) if isinstance(value, tuple) else (float(value),)
    return values


def _labels(field: Field) -> list[str]:
    """A name for each of its numbers; none where it is a text or has no fixed length."""
    if field.dtype is not None or field.type is str:
        return []
    if not field.shape:
        return [field.name]
    (length,) = field.shape
    return [f"{field.name}[{i}]" for i in range(length)] if isinstance(length, int) else []


def library() -> Any:
    """pylsl. SettingError: it is not installed, or does not find the C library that it loads."""
    try:
        import pylsl
    except ImportError as error:
        raise SettingError(missing("LSL", error.name, "lsl")) from None
    except (OSError, RuntimeError) as error:
        raise SettingError(f"LSL: pylsl cannot load the library liblsl: {error}; {install('lsl')}") from None
    return pylsl
