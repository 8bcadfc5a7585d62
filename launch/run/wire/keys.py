"""Encryption and authentication of TCP connections: ZeroMQ's CURVE, with one key pair for all machines of a rig.

Only users with the key file can take part in runs, read their streams and send messages. Frames cannot be read or
changed on the network. A run on one machine makes a temporary key.
"""

from __future__ import annotations

import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path

import msgspec
import zmq
from zmq.auth.thread import ThreadAuthenticator

from palpate.physics.errors import RunError
from palpate.physics.readable import MOST_TEXT, check_readable

NAME = "rig"  # default name of a key


@dataclass(frozen=True)
class Key:
    """A key pair, 40 characters of Z85 each."""

    public: str
    secret: str

    @classmethod
    def make(cls) -> Key:
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
    """Connect a socket, encrypted with a key or not; a socket may have connections of both kinds."""
    if key is not None:
        key.secure(socket, server=False)
    else:
        socket.set(zmq.CURVE_SERVER, 0)  # no encryption for connections from now on
    socket.connect(address)


class Authenticator:
    """Refuses connections to the sockets of a context without the key."""

    def __init__(self, context: zmq.Context, key: Key) -> None:
        self._key = key.public.encode()
        self._thread = ThreadAuthenticator(context)
        self._thread.start()
        self._thread.configure_curve_callback("*", self)

    def callback(self, domain: str, key: bytes) -> bool:
        """Whether the holder of this public key may connect."""
        return key == self._key

    def close(self) -> None:
        self._thread.stop()


def folder() -> Path:
    """The folder of this user's keys."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "palpate" / "keys"


def path_of(name: str) -> Path:
    """File of a key. RunError: invalid name."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", name) or name.startswith("."):
        raise RunError(f"key {name!r}: expected a name of letters, digits, '-', '_' and '.'")
    return folder() / f"{name}.json"


def make(name: str = NAME) -> Path:
    """Write a new key to a file that only this user can read. RunError: it exists."""
    path, key = path_of(name), Key.make()
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    try:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise RunError(f"key {name!r}: {path} exists; remove it first, or use another name") from None
    with os.fdopen(number, "wb") as file:
        file.write(msgspec.json.encode(key) + b"\n")
    return path


def load(name: str = NAME) -> Key:
    """The key of this name. RunError: it is missing, readable by others, or damaged."""
    path = path_of(name)
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise RunError(f"key {name!r}: others can read {path}; chmod 600 {path}, and make a new one if they have")
        check_readable(path, MOST_TEXT)
        key = msgspec.json.decode(path.read_bytes(), type=Key)
        zmq.curve_public(key.secret.encode())
    except FileNotFoundError:
        raise RunError(
            f"there is no key {name!r} ({path}). `palpate remote keys --make` makes one; copy that file to the same "
            "place on every machine that takes part. --unencrypted does without: then everybody on the network can "
            "read the run and send into it."
        ) from None
    except (msgspec.MsgspecError, OSError, ValueError, zmq.ZMQError) as error:
        raise RunError(f"key {name!r}: {path} is damaged ({error})") from None
    return key
