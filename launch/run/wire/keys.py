"""Keys that secure what goes over TCP: ZeroMQ's CURVE, with one pair of keys for all machines of a rig.

Who holds the key file takes part in runs, hears their streams and sends into them; nobody else does, and nobody on
the way reads or changes a frame. A run whose groups are all on this machine makes a key of its own, which it tells to
nobody else.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec
import zmq
from zmq.auth.thread import ThreadAuthenticator

from palpate.physics.errors import RunError

NAME = "rig"  # name of the key that is taken where none is named


@dataclass(frozen=True)
class Key:
    """A pair of keys, as 40 characters of Z85 each."""

    public: str
    secret: str

    @classmethod
    def make(cls) -> Key:
        """A new pair."""
        public, secret = zmq.curve_keypair()
        return cls(public.decode(), secret.decode())

    def secure(self, socket: zmq.Socket, server: bool) -> None:
        """Secure a socket, before it binds (as server) or connects."""
        socket.set(zmq.CURVE_PUBLICKEY, self.public.encode())
        socket.set(zmq.CURVE_SECRETKEY, self.secret.encode())
        if server:
            socket.set(zmq.CURVE_SERVER, 1)
        else:
            socket.set(zmq.CURVE_SERVERKEY, self.public.encode())


def connect(socket: zmq.Socket, address: str, key: Key | None) -> None:
    """Connect a socket to an address that a key secures, or none; a socket may have connections of both kinds."""
    if key is not None:
        key.secure(socket, server=False)
    else:
        socket.set(zmq.CURVE_SERVER, 0)  # back to no security for the connections from now on
    socket.connect(address)


class Authenticator:
    """Lets nobody in at the sockets of a context who does not hold the key."""

    def __init__(self, context: zmq.Context, key: Key) -> None:
        self._key = key.public.encode()
        self._thread = ThreadAuthenticator(context)
        self._thread.start()
        self._thread.configure_curve_callback("*", self)

    def callback(self, domain: str, key: bytes) -> bool:
        """Whether the holder of this public key may connect."""
        return key == self._key

    def close(self) -> None:
        """End its thread."""
        self._thread.stop()


def folder() -> Path:
    """Where the keys of this user lie."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "palpate" / "keys"


def path_of(name: str) -> Path:
    """File of a key. RunError: no name for one."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", name) or name.startswith("."):
        raise RunError(f"key {name!r}: expected a name of letters, digits, '-', '_' and '.'")
    return folder() / f"{name}.json"


def make(name: str = NAME) -> Path:
    """A new key in a file that only this user can read. RunError: there is one of that name."""
    path, key = path_of(name), Key.make()
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise RunError(f"key {name!r}: {path} is there already; remove it first, or take another name") from None
    with os.fdopen(number, "wb") as file:
        file.write(msgspec.json.encode(key) + b"\n")
    return path


def load(name: str = NAME) -> Key:
    """The key of this name. RunError: there is none, others can read it, or it is damaged."""
    path = path_of(name)
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise RunError(f"key {name!r}: others can read {path}; chmod 600 {path}, and make a new one if they have")
        key = msgspec.json.decode(path.read_bytes(), type=Key)
        zmq.curve_public(key.secret.encode())
    except FileNotFoundError:
        raise RunError(
            f"there is no key {name!r} ({path}). `palpate remote keys --make` makes one; copy that file to the same "
            "place on every machine that takes part. --unencrypted does without: then everybody on the network can "
            "read the run and send into it."
        ) from None
    except (msgspec.MsgspecError, ValueError, zmq.ZMQError) as error:
        raise RunError(f"key {name!r}: {path} is damaged ({error})") from None
    return key


def known() -> Iterator[tuple[str, Path]]:
    """Names and files of the keys of this user."""
    yield from ((path.stem, path) for path in sorted(folder().glob("*.json")))
