"""The server of the pages: static files and a WebSocket, protected by a token; on loopback only for this user."""

import asyncio
import contextlib
import hmac
import html
import os
import secrets
import socket
import sys
import threading
import time
from http import HTTPStatus
from importlib import resources
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import msgspec
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers, MultipleValuesError
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from palpate.physics.errors import PalpateError
from palpate.views.errors import PageError
from palpate.views.page.feed import NO_VERTICES, RATE, FrameSource, binary, vertices_of

HOST, ANY = "127.0.0.1", "0.0.0.0"
LOOPBACK = ("127.0.0.1", "localhost", "::1")
RENDERERS = "/frames"
SHARED = (
    "page.css",
    "scene.js",
    "charts.js",
    "panel.js",
    "engine.js",
    "model.js",
    "hard.js",
    "sound.js",
)  # static files of all pages
KINDS = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
PATIENCE = 30.0  # [s] timeout of opening and closing the server
_USER = os.getuid() if hasattr(os, "getuid") else None  # of this process
RELOAD = 2.0  # [s] without a page after which the page counts as closed, not reloaded


class PageServer:
    """Serves one source to any number of pages in a separate thread until it is closed.

    port  0: any free port
    host  address of this machine to listen on; 0.0.0.0: all

    PageError: the port is in use, or the address does not belong to this machine.
    """

    def __init__(self, source: FrameSource, port: int = 0, host: str = HOST) -> None:
        self.source, self.port, self.host = source, port, host
        self.token = secrets.token_urlsafe(24)
        page, script = source.files
        self._files = {"/": page} | {f"/{name}": name for name in (script, *SHARED)}
        self._pages, self._left, self._renderers = 0, 0.0, 0
        self._server: Server | None = None
        self._news, self._order = asyncio.Condition(), asyncio.Lock()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name="palpate page")
        self._thread.start()
        try:
            self._call(self._start(port))
            source.open()
        except BaseException:
            self._end()
            raise

    @property
    def address(self) -> str:
        return f"http://{_outward() if self.host == ANY else self.host}:{self.port}/?token={self.token}"

    @property
    def deserted(self) -> bool:
        """Whether the last page was closed and not reloaded."""
        return not self._pages and self._left > 0.0 and time.monotonic() - self._left > RELOAD

    def close(self) -> None:
        if self._loop.is_closed():
            return
        self.source.on_news = lambda: None
        self._call(self._stop())
        self._end()
        self.source.close()

    def __repr__(self) -> str:
        return f"<view {self.address}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.address)
        return f'<a href="{address}" target="_blank" rel="noreferrer">{address}</a>'

    def _call(self, work: Any) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()

    # -- the thread ----------------------------------------------------------------------------------------------

    async def _start(self, port: int) -> None:
        try:
            self._server = await serve(self._talk, self.host, port, process_request=self._answer, max_size=4096,
                                       compression=None, ping_interval=20, family=socket.AF_INET)  # fmt: skip
        except OSError as error:
            cure = f"--port 0 takes any free port; --host {ANY} listens on all addresses of this machine"
            raise PageError(f"port {port} of {self.host}: {error.strerror}; {cure}") from None
        self.port = next(iter(self._server.sockets)).getsockname()[1]
        self.source.on_news = lambda: asyncio.run_coroutine_threadsafe(self._notify(), self._loop)

    async def _stop(self) -> None:
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _talk(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        renders = urlsplit(connection.request.path).path == RENDERERS
        writer = asyncio.create_task(self._show(connection, renders))
        self._pages += 1
        self._render(renders)
        try:
            with contextlib.suppress(ConnectionClosed):
                for data in self.source.begin():
                    await connection.send(data)
                async for text in connection:
                    for data in await self._answer_page(connection, text):
                        await connection.send(data)
        finally:
            self._pages, self._left = self._pages - 1, time.monotonic()
            writer.cancel()
            self._render(-renders)
            self.source.leave(connection)

    def _render(self, more: int) -> None:
        """Change the number of renderers; with renderers, frames are made at `RATE`."""
        self._renderers += more
        self.source.rate = RATE if self._renderers else type(self.source).rate

    async def _answer_page(self, connection: ServerConnection, text: str | bytes) -> list[Any]:
        """The answers to a page, in a thread, since reading a recording takes time."""
        try:
            async with self._order:
                return await asyncio.to_thread(self.source.take, connection, text)
        except (msgspec.MsgspecError, PalpateError) as error:
            return [msgspec.json.encode({"kind": "refused", "text": str(error)}).decode()]

    async def _show(self, connection: ServerConnection, renders: bool) -> None:
        """Send new messages, to a renderer in the form of `binary`. A slow page skips frames."""
        mesh = frame = b""
        status, figures, vertices, source = None, None, NO_VERTICES, self.source
        with contextlib.suppress(ConnectionClosed):
            while source.status is not None:
                news = (source.status, source.keep, source.panel)
                if news != status:
                    status = news
                    head: dict[str, Any] = {"kind": "status", "text": source.status, "keep": source.keep,
                                            "panel": source.panel}  # fmt: skip
                    await connection.send(msgspec.json.encode(head).decode())
                elif source.figures is not figures:
                    figures = source.figures
                    await connection.send(msgspec.json.encode({"kind": "figures", "figures": figures}).decode())
                elif source.mesh is not mesh:
                    mesh = source.mesh
                    vertices = vertices_of(mesh) if renders else NO_VERTICES
                    await connection.send(binary(mesh) if renders else mesh)
                elif source.frame is not frame and mesh:
                    frame = source.frame
                    await connection.send(binary(frame, vertices) if renders else frame)
                else:
                    async with self._news:
                        with contextlib.suppress(TimeoutError):
                            await asyncio.wait_for(self._news.wait(), 0.5)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file, an error, or None: accept the WebSocket."""
        try:
            parts = urlsplit(request.path)
            given = parse_qs(parts.query).get("token", [""])[0]
            origin = request.headers.get("Origin")
            here = (*LOOPBACK, connection.local_address[0])  # valid hosts of the page's URL
            strange = origin is not None and urlsplit(origin).hostname not in here
            strange |= _user(connection.remote_address, connection.local_address) not in (None, 0, _USER)
            known = hmac.compare_digest(given.encode(), self.token.encode())
        except (ValueError, MultipleValuesError):  # malformed, not from a browser: http://[::1, two origins
            return _reply(HTTPStatus.BAD_REQUEST, b"invalid address or Origin\n")
        if parts.path in ("/socket", RENDERERS):
            browser = parts.path == "/socket"  # other programs send no Origin
            if strange or (browser and origin is None) or not known:
                return _reply(HTTPStatus.FORBIDDEN, b"the token is missing or wrong, or of another user\n")
            return None
        if parts.path not in self._files:
            return _reply(HTTPStatus.NOT_FOUND, b"no such file\n")
        if strange or (parts.path == "/" and not known):
            text = f"open the address that `{self.source.command}` prints; it contains a token\n"
            return _reply(HTTPStatus.FORBIDDEN, text.encode())
        file = resources.files("palpate.views.page").joinpath("static", self._files[parts.path])
        return _reply(HTTPStatus.OK, file.read_bytes(), KINDS[file.name.partition(".")[2]])


def _outward() -> str:
    """The address of this machine for other machines; loopback without a network."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # documentation address (RFC 5737); connecting a UDP socket sends nothing
        return str(probe.getsockname()[0])
    return HOST


def _user(peer: tuple[str, int], here: tuple[str, int]) -> int | None:
    """User id of the peer of a local connection; None: the kernel does not list it. The token is not sufficient: other
    users can read it from the command line of a browser in the process list."""
    ends = [f"{int.from_bytes(socket.inet_aton(ip), sys.byteorder):08X}:{own:04X}" for ip, own in (peer, here)]
    with contextlib.suppress(OSError):
        for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]:
            row = line.split()
            if row[1:3] == ends:
                return int(row[7])
    return None


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
