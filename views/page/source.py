"""What a page shows, from the side of the server: a run that goes on, or recordings."""

from collections.abc import Callable
from typing import Any


class FrameSource:
    """Where a page's pictures come from.

    files         HTML and script of the page; command: the one that prints its address
    status, keep  what goes on, and whether the recording of the present run is kept. None: nothing comes unasked
    panel         what covers the picture: the texts and questions of an experiment. None: the page has no such things
    mesh, frame   the newest ones, packed for the page (see `feed`)
    rate          [1/s] of frames at most
    on_news       called, from any thread, whenever one of these is new
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
        """The page can be reached."""

    def close(self) -> None:
        """It cannot be reached any more."""

    def begin(self) -> list[bytes]:
        """What a page is sent when it opens."""
        return []

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Do what a page asks for; what it is answered. PalpateError, MsgspecError: why not."""
        return []

    def leave(self, page: object) -> None:
        """A page was closed."""
