"""The page's server on loopback: static files, and a socket behind a token; each page gets the newest frame only."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import secrets
from http import HTTPStatus
from importlib import resources
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from palpate.launch.page.session import NoBody, Session
from palpate.physics.errors import MISUSE, PalpateError

HOST = "127.0.0.1"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
FILES = {
    "/": ("index.html", "text/html"),
    "/page.css": ("page.css", "text/css"),
    "/page.js": ("page.js", "text/javascript"),
    "/scene.js": ("scene.js", "text/javascript"),
    "/charts.js": ("charts.js", "text/javascript"),
}


class PortTaken(PalpateError, OSError):
    """The page's port cannot be bound."""

    exit_code = MISUSE


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends: a sample of its pointer, or what one of its switches asks for."""

    point: tuple[int, tuple[float, float, float], int] | None = None
    body: str | None = None
    reset: bool = False
    keep: bool | None = None


class Page:
    """Serves one session to any number of pages. Whoever points last steers."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self._news = asyncio.Condition()
        self._steering: ServerConnection | None = None
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
        loop = asyncio.get_running_loop()
        self.session.told = lambda: loop.call_soon_threadsafe(self._wake)

    async def close(self) -> None:
        """Close all pages."""
        self.session.told = lambda: None
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    def _wake(self) -> None:
        asyncio.ensure_future(self._notify())  # noqa: RUF006  ends at once

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file, a refusal, or None: the socket may be opened."""
        parts = urlsplit(request.path)
        given = parse_qs(parts.query).get("token", [""])[0]
        origin = request.headers.get("Origin")
        strange = origin is not None and urlsplit(origin).hostname not in LOOPBACK
        known = hmac.compare_digest(given.encode(), self.token.encode())
        if parts.path == "/socket":
            if strange or origin is None or not known:
                return _reply(HTTPStatus.FORBIDDEN, b"the address of this page has a token, which is missing\n")
            return None
        if parts.path not in FILES:
            return _reply(HTTPStatus.NOT_FOUND, b"no such file\n")
        if strange or (parts.path == "/" and not known):
            return _reply(HTTPStatus.FORBIDDEN, b"open the address that `palpate touch` prints: it has a token\n")
        name, kind = FILES[parts.path]
        body = resources.files("palpate.launch.page").joinpath("static", name).read_bytes()
        return _reply(HTTPStatus.OK, body, kind)

    async def _talk(self, connection: ServerConnection) -> None:
        writer = asyncio.create_task(self._show(connection))
        try:
            async for text in connection:
                try:
                    self._obey(connection, msgspec.json.decode(text, type=Order))
                except (msgspec.MsgspecError, NoBody) as error:
                    await connection.send(msgspec.json.encode({"kind": "refused", "text": str(error)}).decode())
        except ConnectionClosed:
            pass
        finally:
            writer.cancel()
            if self._steering is connection:
                self._steering = None
                self.session.lift()

    def _obey(self, connection: ServerConnection, order: Order) -> None:
        if order.point is not None:
            self._steering = connection
            self.session.point(*order.point)
        if order.keep is not None:
            self.session.keep = order.keep
        if order.body is not None or order.reset:
            self.session.begin_again(order.body)

    async def _show(self, connection: ServerConnection) -> None:
        """Send what is new; a page that is slow gets the next frame when it has taken the last one."""
        mesh = frame = b""
        status = None
        with contextlib.suppress(ConnectionClosed):
            while True:
                session = self.session
                news = (session.status, session.keep)
                if news != status:
                    status = news
                    told: dict[str, Any] = {"kind": "status", "text": session.status, "keep": session.keep}
                    await connection.send(msgspec.json.encode(told).decode())
                elif session.mesh is not mesh:
                    mesh = session.mesh
                    await connection.send(mesh)
                elif session.frame is not frame and mesh:
                    frame = session.frame
                    await connection.send(frame)
                else:
                    async with self._news:
                        with contextlib.suppress(TimeoutError):
                            await asyncio.wait_for(self._news.wait(), 0.5)


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
