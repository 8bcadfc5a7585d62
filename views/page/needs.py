"""What the pages need and an installation may lack."""

from __future__ import annotations

from palpate.launch.load.extras import install
from palpate.physics.errors import MISUSE, PalpateError


class PageError(PalpateError, RuntimeError):
    """What a page needs and is not installed."""

    exit_code = MISUSE


def check() -> None:
    """PageError: the package that serves the pages is missing, with what to type."""
    try:
        import websockets  # noqa: F401
    except ImportError:
        raise PageError(f"the page needs the package websockets: {install('page')}") from None
