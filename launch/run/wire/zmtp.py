"""ZMTP 3.1, the wire protocol of ZeroMQ (RFC 23 and 37), without sockets: bytes in, frames out.

A connection is a greeting of 64 bytes, a READY command with properties, and frames: messages and commands. A frame is a
byte of flags, its length in one byte or in eight, and its body. The only security mechanism is NULL: these connections
do not leave the machine, and only their user can enter the folder of their sockets.

Why not libzmq: nine processes of a force loop in C, on one core, need 123 us a tick with libzmq, 30 with this protocol
over the same Unix sockets; ours with nodes, codec and rules 80 on a busy machine (docs/decisions/0019-hop.md).

Subscriptions come as commands (3.1) or as messages that begin with a byte 1 or 0 (3.0, and libzmq's XSUB).
"""

from collections.abc import Iterator, Mapping

MORE, LONG, COMMAND = 1, 2, 4  # flags of a frame
MECHANISM = b"NULL".ljust(20, b"\0")
GREETING = b"\xff" + bytes(8) + b"\x7f" + b"\3\1" + MECHANISM + bytes(32)
"""Signature, version, mechanism, no server, filler."""
PUBLISHERS, SUBSCRIBERS = (b"PUB", b"XPUB"), (b"SUB", b"XSUB")
GROUP = b"x-group"  # property by which the workers of a run name their group to one another

Frame = tuple[int, bytes]  # flags, without LONG, and body


class ZmtpError(ValueError):
    """A peer does not follow ZMTP 3 as supported here."""


def frame(body: bytes, flags: int = 0) -> bytes:
    size = len(body)
    if size < 256:
        return bytes((flags, size)) + body
    return bytes((flags | LONG,)) + size.to_bytes(8, "big") + body


def command(name: bytes, data: bytes = b"") -> bytes:
    return frame(bytes((len(name),)) + name + data, COMMAND)


def split_command(body: bytes) -> tuple[bytes, bytes]:
    """Name and data of a command. ZmtpError: it has no name."""
    end = 1 + body[0] if body else 0
    if not 1 < end <= len(body):
        raise ZmtpError("a command without a name")
    return body[1:end], body[end:]


def ready(properties: Mapping[bytes, bytes]) -> bytes:
    named = (bytes((len(name),)) + name + len(value).to_bytes(4, "big") + value for name, value in properties.items())
    return command(b"READY", b"".join(named))


def properties(data: bytes) -> dict[bytes, bytes]:
    """The properties of a READY command, with names in lower case. ZmtpError: truncated."""
    found = {}
    while data:
        name, data = data[1 : 1 + data[0]], data[1 + data[0] :]
        size = int.from_bytes(data[:4], "big")
        if not name or len(data) < 4 + size:
            raise ZmtpError("properties that are cut off")
        found[name.lower()], data = data[4 : 4 + size], data[4 + size :]
    return found


def subscription(flags: int, body: bytes) -> tuple[bool, bytes] | None:
    """Subscription (True) or cancellation (False) and topic; None for other frames. ZmtpError: malformed command."""
    if flags == COMMAND:
        name, topic = split_command(body)
        return (name == b"SUBSCRIBE", topic) if name in (b"SUBSCRIBE", b"CANCEL") else None
    if flags == 0 and body[:1] in (b"\0", b"\1"):
        return body[0] == 1, body[1:]
    return None


def pong(flags: int, body: bytes) -> bytes | None:
    """The answer to a PING; None for other frames."""
    if flags != COMMAND:
        return None
    name, data = split_command(body)
    return command(b"PONG", data[2:18]) if name == b"PING" else None


class Decoder:
    """Splits a stream of bytes into frames.

    longest  [bytes] limit of a frame's body: a longer one is refused before it is buffered
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self.rest = bytearray()  # the beginning of a frame
        self._needs = 0

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that these bytes complete. ZmtpError: unknown flags, or too long a frame."""
        if self.rest:
            self.rest += data
            if len(self.rest) < self._needs:
                return []
            data = bytes(self.rest)
            self.rest.clear()
        frames: list[Frame] = []
        at, size = 0, len(data)
        while at < size:
            flags = data[at]
            if flags > 6 or flags & (MORE | COMMAND) == (MORE | COMMAND):
                raise ZmtpError(f"a frame with flags {flags:#x}")
            if flags & LONG:
                begin = at + 9
                length = int.from_bytes(data[at + 1 : begin], "big") if begin <= size else 0
            else:
                begin = at + 2
                length = data[at + 1] if begin <= size else 0
            if length > self._longest:
                raise ZmtpError(f"a frame of {length} bytes, longest {self._longest}")
            end = begin + length
            if end > size:
                self.rest += data[at:]
                self._needs = end - at
                break
            frames.append((flags & ~LONG, data[begin:end]))
            at = end
        return frames


class Connection:
    """One end of a connection, including the handshake.

    kind     socket type of this end
    peers    accepted socket types of the peer
    longest  see `Decoder`
    group    name of the worker at this end
    """

    def __init__(self, kind: bytes, peers: tuple[bytes, ...], longest: int, group: str) -> None:
        self.ready = ready({b"Socket-Type": kind, b"X-Group": group.encode()})
        """The READY command. A client sends it after its greeting, a server when the client is ready."""
        self.peer: dict[bytes, bytes] | None = None  # properties of the other end, once it is ready
        self.minor = 0  # its ZMTP version is 3.minor or later
        self._peers = peers
        self.decoder = Decoder(longest)
        self._greeting = b""

    def feed(self, data: bytes) -> list[Frame]:
        """The frames that these bytes complete; none before the handshake is complete. ZmtpError: not understood."""
        if self.peer is not None:
            return self.decoder.feed(data)
        need = len(GREETING) - len(self._greeting)
        if need and data:
            self._greeting += data[:need]
            self._check_greeting()
            data = data[need:]
        if not data:
            return []
        return list(self._shake(self.decoder.feed(data)))

    def _shake(self, frames: list[Frame]) -> Iterator[Frame]:
        for flags, body in frames:
            if self.peer is not None:
                yield flags, body
                continue
            name, data = split_command(body) if flags == COMMAND else (b"a message", b"")
            if name == b"ERROR":
                raise ZmtpError(f"ERROR {data[1:].decode(errors='replace')}")
            if name != b"READY":
                raise ZmtpError(f"{name.decode(errors='replace')} before READY")
            found = properties(data)
            kind = found.get(b"socket-type", b"")
            if kind not in self._peers:
                expected = " or ".join(peer.decode() for peer in self._peers)
                raise ZmtpError(f"a socket of type {kind.decode(errors='replace') or 'none'}, expected {expected}")
            self.peer = found

    def _check_greeting(self) -> None:
        """Check the part received so far. The eight bytes within the signature are ignored."""
        received = self._greeting
        if received[0] != GREETING[0] or (len(received) > 9 and received[9] != GREETING[9]):
            raise ZmtpError("no ZMTP of version 2 or later")
        if len(received) > 10 and received[10] < 3:
            raise ZmtpError(f"ZMTP {'2.0' if received[10] else '1.0'}, expected 3.0 or later")
        if len(received) < len(GREETING):
            return
        mechanism = received[12:32]
        if mechanism != MECHANISM:
            raise ZmtpError(f"mechanism {mechanism.rstrip(bytes(1)).decode(errors='replace')}, expected NULL")
        self.minor = received[11] if received[10] == 3 else 1
