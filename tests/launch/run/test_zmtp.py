"""The bytes of the wire protocol as in RFC 37, and arbitrary data from a peer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.launch.run.wire.zmtp import (
    COMMAND,
    GREETING,
    MORE,
    PUBLISHERS,
    SUBSCRIBERS,
    Connection,
    Decoder,
    ZmtpError,
    command,
    frame,
    pong,
    properties,
    ready,
    split_command,
    subscription,
)

LIBZMQ = bytes.fromhex("ff00000000000000017f0301") + b"NULL" + bytes(48)
"""The greeting of libzmq 4.3, which sets a bit in the padding."""
SUB = ready({b"Socket-Type": b"SUB", b"Identity": b""})


def subscriber(longest: int = 1024) -> Connection:
    """The publisher's end of a connection to a subscriber."""
    return Connection(b"PUB", SUBSCRIBERS, longest, "here")


def test_the_greeting_equals_that_of_the_rfc():
    assert len(GREETING) == 64
    assert GREETING[:12] == bytes.fromhex("ff00000000000000007f0301")
    assert GREETING[12:33] == b"NULL" + bytes(17) and not any(GREETING[33:])


def test_frames_and_commands_equal_those_of_the_rfc():
    assert frame(b"abc") == b"\x00\x03abc"
    assert frame(b"") == b"\x00\x00"
    assert frame(bytes(255))[:2] == b"\x00\xff"
    assert frame(bytes(256))[:9] == b"\x02" + bytes([0, 0, 0, 0, 0, 0, 1, 0])
    assert command(b"SUBSCRIBE", b"A") == b"\x04\x0b\x09SUBSCRIBEA"
    assert command(b"CANCEL", b"A") == b"\x04\x08\x06CANCELA"
    assert ready({b"Socket-Type": b"PUB"}) == b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03PUB"


@given(st.lists(st.tuples(st.sampled_from([0, MORE, COMMAND]), st.binary(max_size=600)), max_size=8), st.data())
def test_frames_survive_a_round_trip_in_any_pieces(frames, data):
    stream = b"".join(frame(body, flags) for flags, body in frames)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    decoder, found = Decoder(600), []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += decoder.feed(stream[begin:end])
    assert found == frames and not decoder.rest


@given(st.dictionaries(st.binary(min_size=1, max_size=20).map(bytes.lower), st.binary(max_size=300), max_size=5))
def test_properties_survive_a_round_trip(given):
    name, data = split_command(Decoder(10_000).feed(ready(given))[0][1])
    assert name == b"READY" and properties(data) == given


@given(st.lists(st.binary(max_size=200), max_size=6), st.booleans())
def test_any_data_of_a_peer_is_decoded_or_refused(parts, greets):
    connection = subscriber()
    try:
        for data in [GREETING + SUB, *parts] if greets else parts:
            for flags, body in connection.feed(data):
                subscription(flags, body)
                pong(flags, body)
    except ZmtpError:
        return
    assert len(connection.decoder.rest) <= 1024 + 9


@pytest.mark.parametrize("length", [1025, 1 << 32, (1 << 63) - 1, (1 << 64) - 1])
def test_a_length_is_refused_before_any_data_is_buffered(length):
    decoder = Decoder(1024)
    with pytest.raises(ZmtpError, match=f"a frame of {length} bytes, longest 1024"):
        decoder.feed(b"\x02" + length.to_bytes(8, "big"))
    assert not decoder.rest


def test_a_long_frame_uses_no_more_memory_than_was_received():
    decoder = Decoder(1 << 28)
    assert decoder.feed(b"\x02" + (1 << 28).to_bytes(8, "big") + b"x") == []
    assert len(decoder.rest) == 10


@pytest.mark.parametrize("flags", [5, 7, 8, 0x80, 0xFF])
def test_unknown_flags_are_refused(flags):
    with pytest.raises(ZmtpError, match=f"flags {flags:#x}"):
        Decoder(100).feed(bytes((flags, 0)))


@pytest.mark.parametrize(
    ("printed", "why"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "no ZMTP of version 2 or later"),
        (b"\x01\x00", "no ZMTP of version 2 or later"),  # ZMTP 1.0 without an identity
        (bytes.fromhex("ff00000000000000017f00"), "ZMTP 1.0, expected 3.0 or later"),
        (bytes.fromhex("ff00000000000000017f01") + b"\x02\x00\x00", "ZMTP 2.0, expected 3.0 or later"),
        (GREETING[:12] + b"CURVE" + bytes(47), "mechanism CURVE, expected NULL"),
        (GREETING + frame(b"hello"), "a message before READY"),
        (GREETING + command(b"SUBSCRIBE", b""), "SUBSCRIBE before READY"),
        (GREETING + command(b"ERROR", b"\x04nope"), "ERROR nope"),
        (GREETING + command(b"", b"READY"), "a command without a name"),
        (GREETING + ready({b"Socket-Type": b"PUSH"}), "a socket of type PUSH, expected SUB or XSUB"),
        (GREETING + ready({}), "a socket of type none, expected SUB or XSUB"),
        (GREETING + ready({b"Socket-Type": b"SUB"})[:-1].replace(b"\x19", b"\x18"), "cut off"),
    ],
)
def test_the_error_names_the_incompatibility_of_a_peer(printed, why):
    with pytest.raises(ZmtpError, match=why):
        subscriber().feed(printed)


@pytest.mark.parametrize(
    "greeting", [GREETING, LIBZMQ, GREETING[:11] + b"\x00" + GREETING[12:], b"\xff" * 9 + b"\x7f\x04" + GREETING[11:]]
)
@pytest.mark.parametrize("step", [1, 7, 200])
def test_a_peer_of_version_3_or_later_is_accepted_in_any_pieces(greeting, step):
    connection, frames = subscriber(), []
    printed = greeting + SUB + frame(b"\x01pose\0") + command(b"SUBSCRIBE", b"force\0")
    for at in range(0, len(printed), step):
        frames += connection.feed(printed[at : at + step])
    assert connection.peer == {b"socket-type": b"SUB", b"identity": b""}
    assert [subscription(*given) for given in frames] == [(True, b"pose\0"), (True, b"force\0")]


def test_a_publisher_knows_the_version_of_its_subscriber():
    for greeting, minor in (
        (GREETING, 1),
        (GREETING[:11] + b"\x00" + GREETING[12:], 0),
        (GREETING[:10] + b"\x04\x00" + GREETING[12:], 1),
    ):
        connection = Connection(b"SUB", PUBLISHERS, 100, "here")
        connection.feed(greeting)
        assert connection.minor == minor


def test_subscriptions_are_commands_or_messages():
    assert subscription(0, b"\x01pose") == (True, b"pose")
    assert subscription(0, b"\x00pose") == (False, b"pose")
    assert subscription(COMMAND, b"\x06CANCELpose") == (False, b"pose")
    assert subscription(0, b"\x07pose") is None and subscription(0, b"") is None
    assert subscription(COMMAND, b"\x04JOINpose") is None


def test_a_ping_is_answered_with_its_context():
    assert pong(COMMAND, b"\x04PING\x00\x00context") == command(b"PONG", b"context")
    assert len(pong(COMMAND, b"\x04PING\x00\x00" + bytes(1000))) == 2 + 5 + 16
    assert pong(COMMAND, b"\x04PONGx") is None and pong(0, b"\x04PING\x00\x00") is None
