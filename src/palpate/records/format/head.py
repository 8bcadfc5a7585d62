"""The head of a message: the part of its header that a replay needs."""

from typing import Literal

import msgspec

PROFILE = "palpate"
SCHEMA_VERSION = "1"
Compression = Literal["zstd", "lz4", "none"]  # of the chunks of a file


class Head(msgspec.Struct, frozen=True):
    """Tick, time [ns], and ticks of the inputs used."""

    tick: int
    time: int
    used: tuple[int, ...]


_DECODER = msgspec.msgpack.Decoder(Head)
_MAP_OF_THREE = 0x83


def head_of(payload: bytes) -> Head:
    """The head of an encoded message or head."""
    return _DECODER.decode(payload)


def head_alone(payload: bytes) -> bytes:
    """The encoded head of an encoded message."""
    return msgspec.msgpack.encode(head_of(payload))


def is_head(payload: bytes) -> bool:
    """Whether these bytes are a head, a map of three entries. The header of a message has four."""
    return payload[0] == _MAP_OF_THREE
