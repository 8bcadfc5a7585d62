"""The server of a page to touch: pages are shown one session, and what they send is done."""

from __future__ import annotations

import asyncio
from typing import Annotated

import msgspec
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from palpate.nodes.device.mouse import FARTHEST
from palpate.views.page.live import Live
from palpate.views.page.session import NoBody, Session

Count = Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
Metres = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]


class Order(msgspec.Struct, forbid_unknown_fields=True):
    """What a page sends: a sample of its pointer, or what one of its switches asks for."""

    point: tuple[Count, tuple[Metres, Metres, Metres], Count] | None = None
    body: str | None = None
    effect: tuple[str, bool] | None = None
    reset: bool = False
    keep: bool | None = None


class Page(Live):
    """Serves one session to any number of pages. Whoever points last steers."""

    command = "palpate touch"

    def __init__(self, session: Session) -> None:
        super().__init__(session)
        self.session = session
        self._steering: ServerConnection | None = None

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
