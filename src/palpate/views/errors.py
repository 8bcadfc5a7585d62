"""Errors of pictures and pages."""

from palpate.physics.errors import MISUSE, PalpateError


class PictureError(PalpateError, ValueError):
    """A picture cannot be drawn; says what can, or what to install."""

    exit_code = MISUSE


class PageError(PalpateError, RuntimeError):
    """A graph cannot be shown or steered in a browser; says what would work."""

    exit_code = MISUSE
