"""The server of a page that shows what goes on: each page gets the newest frame only."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any, Protocol

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from palpate.views.page.doors import SHARED, Doors


class Source(Protocol):
    """Where a page's pictures come from. `told` is called, from any thread, whenever one of the others is new."""

    status: str
    keep: bool
    mesh: bytes
    frame: bytes
    told: Callable[[], object]


class Live(Doors):
    """Serves one source to any number of pages, which cannot do anything to it."""

    files = SHARED | {"/": ("index.html", "text/html"), "/page.js": ("page.js", "text/javascript")}
    command = "palpate run --view web"

    def __init__(self, source: Source) -> None:
        super().__init__()
        self._source = source
        self.open, self.left = 0, 0.0
        """Pages that are open, and when [s, monotonic] the last one was closed; 0: there was none."""
        self._news = asyncio.Condition()

    async def start(self, port: int) -> None:
        await super().start(port)
        loop = asyncio.get_running_loop()
        self._source.told = lambda: loop.call_soon_threadsafe(self._wake)

    async def close(self) -> None:
        self._source.told = lambda: None
        await super().close()

    def _wake(self) -> None:
        asyncio.ensure_future(self._notify())  # noqa: RUF006  ends at once

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _talk(self, connection: ServerConnection) -> None:
        writer = asyncio.create_task(self._show(connection))
        self.open += 1
        try:
            with contextlib.suppress(ConnectionClosed):
                async for _ in connection:
                    pass
        finally:
            self.open, self.left = self.open - 1, time.monotonic()
            writer.cancel()

    async def _show(self, connection: ServerConnection) -> None:
        """Send what is new; a page that is slow gets the next frame when it has taken the last one."""
        mesh = frame = b""
        status, source = None, self._source
        with contextlib.suppress(ConnectionClosed):
            while True:
                news = (source.status, source.keep)
                if news != status:
                    status = news
                    told: dict[str, Any] = {"kind": "status", "text": source.status, "keep": source.keep}
                    await connection.send(msgspec.json.encode(told).decode())
                elif source.mesh is not mesh:
                    mesh = source.mesh
                    await connection.send(mesh)
                elif source.frame is not frame and mesh:
                    frame = source.frame
                    await connection.send(frame)
                else:
                    async with self._news:
                        with contextlib.suppress(TimeoutError):
                            await asyncio.wait_for(self._news.wait(), 0.5)
