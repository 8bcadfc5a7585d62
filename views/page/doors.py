"""What the pages share: static files and a socket on loopback, for whoever has the token."""

from __future__ import annotations

import hmac
import secrets
from http import HTTPStatus
from importlib import resources
from typing import ClassVar
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

from palpate.physics.errors import MISUSE, PalpateError

HOST = "127.0.0.1"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
SHARED = {
    "/page.css": ("page.css", "text/css"),
    "/scene.js": ("scene.js", "text/javascript"),
    "/charts.js": ("charts.js", "text/javascript"),
}


class PortTaken(PalpateError, OSError):
    """The page's port cannot be bound."""

    exit_code = MISUSE


class Doors:
    """A server of static files and one socket on loopback, behind a token.

    files    path of the address -> name of the file and its type
    command  that prints the address
    """

    files: ClassVar[dict[str, tuple[str, str]]] = {}
    command = ""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(24)
        self._server: Server | None = None
        self.port = 0

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    async def start(self, port: int) -> None:
        """Bind the port, 0 for any. PortTaken."""
        try:
            self._server = await serve(self._talk, HOST, port, process_request=self._answer, max_size=4096,
                                       compression=None, ping_interval=20)  # fmt: skip
        except OSError as error:
            raise PortTaken(f"port {port} of {HOST}: {error.strerror}; --port 0 takes any that is free") from None
        self.port = next(iter(self._server.sockets)).getsockname()[1]

    async def close(self) -> None:
        """Close all pages."""
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    async def _talk(self, connection: ServerConnection) -> None:
        raise NotImplementedError

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file, a refusal, or None: the socket may be opened."""
        try:
            parts = urlsplit(request.path)
            given = parse_qs(parts.query).get("token", [""])[0]
            origin = request.headers.get("Origin")
            strange = origin is not None and urlsplit(origin).hostname not in LOOPBACK
            known = hmac.compare_digest(given.encode(), self.token.encode())
        except (
            ValueError,
            MultipleValuesError,
        ):  # what no browser sends: http://[::1, two origins
            return _reply(HTTPStatus.BAD_REQUEST, b"this is no address, or its Origin is none\n")
        if parts.path == "/socket":
            if strange or origin is None or not known:
                return _reply(HTTPStatus.FORBIDDEN, b"the address of this page has a token, which is missing\n")
            return None
        if parts.path not in self.files:
            return _reply(HTTPStatus.NOT_FOUND, b"no such file\n")
        if strange or (parts.path == "/" and not known):
            told = f"open the address that `{self.command}` prints: it has a token\n"
            return _reply(HTTPStatus.FORBIDDEN, told.encode())
        name, kind = self.files[parts.path]
        body = resources.files("palpate.views.page").joinpath("static", name).read_bytes()
        return _reply(HTTPStatus.OK, body, kind)


def _reply(status: HTTPStatus, body: bytes, kind: str = "text/plain") -> Response:
    headers = Headers()
    headers["Content-Type"] = f"{kind}; charset=utf-8"
    headers["Content-Length"] = str(len(body))
    headers["Cache-Control"] = "no-store"
    headers["Referrer-Policy"] = "no-referrer"
    headers["X-Frame-Options"] = "DENY"
    headers["Content-Security-Policy"] = "default-src 'self'; connect-src 'self' ws:; img-src 'self' data: blob:"
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)
