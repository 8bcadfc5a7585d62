"""The server of a page that looks at recordings: it answers each time that a page asks for with its pictures."""

from __future__ import annotations

import asyncio
import contextlib

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from palpate.records.reader import RecordingError
from palpate.views.page.doors import SHARED, Doors
from palpate.views.page.reel import Reel, titles


class Ask(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends: the time [s] that it wants to see."""

    at: float


class Viewer(Doors):
    """Shows one recording or two, to any number of pages, each at its own time."""

    files = SHARED | {"/": ("view.html", "text/html"), "/view.js": ("view.js", "text/javascript")}
    command = "palpate view"

    def __init__(self, reels: list[Reel]) -> None:
        super().__init__()
        self.reels = reels
        self._reading = asyncio.Lock()

    async def _talk(self, connection: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            names = titles([reel.recording.path for reel in self.reels])
            for number, (reel, name) in enumerate(zip(self.reels, names, strict=True)):
                await connection.send(reel.begin(number, name))
            async for text in connection:
                try:
                    asked = msgspec.json.decode(text, type=Ask)
                    async with self._reading:
                        frames = await asyncio.to_thread(
                            lambda at: [reel.frame(at, number) for number, reel in enumerate(self.reels)], asked.at
                        )
                except (msgspec.MsgspecError, RecordingError) as error:
                    await connection.send(msgspec.json.encode({"kind": "refused", "text": str(error)}).decode())
                    continue
                for one in frames:
                    await connection.send(one)
