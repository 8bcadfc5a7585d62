"""The server of a page to touch: each page gets the newest frame only."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from palpate.launch.page.doors import SHARED, Doors
from palpate.launch.page.session import NoBody, Session


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends: a sample of its pointer, or what one of its switches asks for."""

    point: tuple[int, tuple[float, float, float], int] | None = None
    body: str | None = None
    effect: tuple[str, bool] | None = None
    reset: bool = False
    keep: bool | None = None


class Page(Doors):
    """Serves one session to any number of pages. Whoever points last steers."""

    files = SHARED | {"/": ("index.html", "text/html"), "/page.js": ("page.js", "text/javascript")}
    command = "palpate touch"

    def __init__(self, session: Session) -> None:
        super().__init__()
        self.session = session
        self._news = asyncio.Condition()
        self._steering: ServerConnection | None = None

    async def start(self, port: int) -> None:
        await super().start(port)
        loop = asyncio.get_running_loop()
        self.session.told = lambda: loop.call_soon_threadsafe(self._wake)

    async def close(self) -> None:
        self.session.told = lambda: None
        await super().close()

    def _wake(self) -> None:
        asyncio.ensure_future(self._notify())  # noqa: RUF006  ends at once

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

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
        if order.body is not None or order.effect is not None or order.reset:
            self.session.begin_again(order.body, order.effect)

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
