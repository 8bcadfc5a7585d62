"""Interface between the server and the source of a page's frames: a run, or recordings."""

from collections.abc import Callable
from typing import Any


class FrameSource:
    """Provides the frames of a page.

    files         HTML and script of the page
    command       the command that prints its address
    status, keep  status text, and whether the recording of the current run is kept. Status None: frames only on request
    panel         texts and questions of an experiment, shown over the picture. None: no panel
    mesh, frame   the newest ones, packed for the page (see `feed`)
    rate          [1/s] highest rate of frames
    on_news       called, from any thread, when one of these changes
    """

    files = ("index.html", "page.js")
    command = "palpate run --view"
    status: str | None = None
    keep = False
    panel: dict[str, Any] | None = None
    mesh = frame = b""
    rate = 30.0

    def __init__(self) -> None:
        self.on_news: Callable[[], object] = lambda: None

    def open(self) -> None:
        """Called when the server is open."""

    def close(self) -> None:
        """Called when the server has closed."""

    def begin(self) -> list[bytes]:
        """Messages to a page when it opens."""
        return []

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Execute a request of a page; returns the answers. PalpateError, MsgspecError: the request is invalid."""
        return []

    def leave(self, page: object) -> None:
        """Called when a page is closed."""
