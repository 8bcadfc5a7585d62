"""The page in the browser shows a run or a recording. One server, several sources of frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.physics.extras import require_extra
from palpate.views.errors import PageError

if TYPE_CHECKING:
    from palpate.views.page.feed import FrameSource
    from palpate.views.page.server import PageServer


def check() -> None:
    """PageError: the package that serves the pages is missing."""
    with require_extra("the page", "page", PageError):
        import websockets  # noqa: F401


def serve(source: FrameSource, port: int = 0, host: str = "127.0.0.1") -> PageServer:
    """Serve a source of frames. PageError: the package is missing, or the port is in use."""
    check()
    from palpate.views.page.server import PageServer

    return PageServer(source, port, host)
