"""The head of a message: what a replay follows."""

import msgspec

PROFILE = "palpate"
SCHEMA_VERSION = "1"


class Head(msgspec.Struct, frozen=True):
    """The part of a header that a replay follows."""

    tick: int
    time: int
    used: tuple[int, ...]


_DECODER = msgspec.msgpack.Decoder(Head)
_MAP_OF_THREE = 0x83


def head_of(payload: bytes) -> Head:
    """The head of a message in its wire form, or of a head alone."""
    return _DECODER.decode(payload)


def head_alone(payload: bytes) -> bytes:
    """The wire form of the head alone."""
    return msgspec.msgpack.encode(head_of(payload))


def is_head(payload: bytes) -> bool:
    """Whether these bytes are a head alone: a map of three. A message has four entries in its header alone."""
    return payload[0] == _MAP_OF_THREE
