"""Encryption and authentication of TCP connections: ZeroMQ's CURVE, with one key pair for all machines of a rig.

Only users with the key file can take part in runs, read their streams and send messages. Frames cannot be read or
changed on the network. A run on one machine makes a temporary key.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import zmq

from palpate.compiler.trust import UntrustedError, check_trust
from palpate.physics.errors import RunError

NAME = "rig"  # default name of a key
LONGEST_NAME = 100
MOST_KEY = 1 << 12  # [bytes] of a key's file
Z85 = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#"


@dataclass(frozen=True)
class Key:
    """A key pair, 40 characters of Z85 each."""

    public: str
    secret: str = field(repr=False)

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
        from zmq.auth.thread import ThreadAuthenticator  # imports asyncio, which only encrypted connections need

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
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", name) or name.startswith(".") or len(name) > LONGEST_NAME:
        raise RunError(
            f"key {shortened(name)}: expected a name of at most {LONGEST_NAME} letters, digits, '-', '_' and '.'"
        )
    return folder() / f"{name}.json"


def shortened(name: str) -> str:
    return repr(name if len(name) <= LONGEST_NAME else f"{name[:20]}...")


def make(name: str = NAME) -> Path:
    """Write a new key to a file that only this user can read, in folders that only this user can enter. RunError: it
    exists, or another user can write to the folders."""
    path, key = path_of(name), Key.make()
    try:
        for parent in reversed(path.parents):  # `parents=True` would make them with the default mode
            with contextlib.suppress(FileExistsError):
                parent.mkdir(mode=0o700)
        with _trusted_folder(name) as at:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            number = os.open(path, flags, 0o600) if at is None else os.open(path.name, flags, 0o600, dir_fd=at)
    except FileExistsError:
        raise RunError(f"key {name!r}: {path} exists; remove it first, or use another name") from None
    except OSError as error:
        raise RunError(f"key {name!r}: {path} cannot be made: {error.strerror or error}") from None
    with os.fdopen(number, "wb") as file:
        file.write(msgspec.json.encode({"public": key.public, "secret": key.secret}) + b"\n")
    return path


def load(name: str = NAME) -> Key:
    """The key of this name. RunError: it is missing, readable by others, another user can have written it, or it is
    damaged."""
    path = path_of(name)
    try:
        with _trusted_folder(name) as at:
            content = _read(path, at)
        return _decoded(content)
    except FileNotFoundError:
        raise RunError(
            f"there is no key {name!r} ({path}). `palpate remote keys --make` makes one; copy that file to the same "
            "place on every machine that takes part. --unencrypted does without: then everybody on the network can "
            "read the run and send into it."
        ) from None
    except UntrustedError as error:
        raise RunError(f"key {name!r}: {path}: {error}, and make a new key if they have") from None
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise RunError(f"key {name!r}: {path} is damaged: {why}") from None


@contextlib.contextmanager
def _trusted_folder(name: str) -> Iterator[int | None]:
    """The descriptor of the folder of keys. It and the one above it belong to this user or to root, and no other
    user can write to them and exchange keys. RunError: they do not."""
    for place in (folder().parent, folder()):
        try:
            check_trust(os.stat(place))
        except UntrustedError as error:
            raise RunError(f"key {name!r}: the folder {place}: {error}") from None
    if os.open not in os.supports_dir_fd:  # Windows, where user folders have access lists
        yield None
        return
    at = os.open(folder(), os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_CLOEXEC", 0))
    try:
        try:
            check_trust(os.fstat(at))
        except UntrustedError as error:
            raise RunError(f"key {name!r}: the folder {folder()}: {error}") from None
        yield at
    finally:
        os.close(at)


def _read(path: Path, at: int | None) -> bytes:
    """The content of a key's file, which may be a link to a file of this user. UntrustedError: another user can read or
    write it. OSError: it cannot be read."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
    number = os.open(path, flags) if at is None else os.open(path.name, flags, dir_fd=at)
    with os.fdopen(number, "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise ValueError("it is no file")
        if hasattr(os, "geteuid") and found.st_uid != os.geteuid():
            raise UntrustedError(f"belongs to user {found.st_uid}, expected {os.geteuid()}; copy it")
        if hasattr(os, "geteuid") and found.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise UntrustedError(
                f"others can read or write it (mode {stat.S_IMODE(found.st_mode):o}); chmod 600 {path}, and make a new "
                "key if they have"
            )
        content = file.read(MOST_KEY + 1)
    if len(content) > MOST_KEY:
        raise ValueError(f"it has more than {MOST_KEY} bytes")
    return content


def _decoded(content: bytes) -> Key:
    """The key in a file. ValueError: it is damaged, or its halves are not a pair."""
    try:
        given = msgspec.json.decode(content)
        public, secret = given["public"], given["secret"]
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, RecursionError):
        raise ValueError("expected the texts `public` and `secret`") from None
    for what, text in (("public", public), ("secret", secret)):
        if not isinstance(text, str) or not _is_z85(text):
            raise ValueError(f"{what}: expected 40 characters of Z85")
    if zmq.curve_public(secret.encode()).decode() != public:
        raise ValueError("its public part does not belong to its secret part")
    return Key(public, secret)


def _is_z85(text: str) -> bool:
    """Whether a text is a key of 32 bytes in Z85 (rfc.zeromq.org/spec/32): 8 groups of 5 characters below 2^32."""
    if len(text) != 40 or not set(text) <= set(Z85):
        return False
    groups = (text[i : i + 5] for i in range(0, 40, 5))
    return all(
        sum(Z85.index(c) * 85**k for c, k in zip(group, (4, 3, 2, 1, 0), strict=True)) < 1 << 32 for group in groups
    )
