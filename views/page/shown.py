"""The page of a recording for Python: served from a thread, as long as the program runs or until it is closed."""

from __future__ import annotations

import asyncio
import html
import threading
from pathlib import Path
from typing import Any

from palpate.views.page.reel import Reel
from palpate.views.page.viewer import Viewer

PATIENCE = 30.0  # [s] for the page to open or to close


class Shown:
    """A page that shows recordings; `address` is what to open."""

    def __init__(self, files: list[Path], port: int = 0) -> None:
        self._reels = [Reel(file) for file in files]
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True, name="palpate view")
        self._thread.start()
        self._page = Viewer(self._reels)
        try:
            self._call(self._page.start(port))
        except BaseException:
            self._end()
            raise

    @property
    def address(self) -> str:
        """What to open in a browser of this machine."""
        return self._page.address

    def close(self) -> None:
        """End the page."""
        if self._loop.is_closed():
            return
        self._call(self._page.close())
        self._end()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()
        for reel in self._reels:
            reel.close()

    def _call(self, work: Any) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)

    def __repr__(self) -> str:
        return f"<view {self.address}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.address)
        return f'<a href="{address}" target="_blank" rel="noreferrer">{address}</a>'
