"""What cannot be drawn or shown."""

from palpate.physics.errors import MISUSE, PalpateError


class PictureError(PalpateError, ValueError):
    """What cannot be drawn of a recording, or on this machine, and what can or what to install."""

    exit_code = MISUSE


class PageError(PalpateError, RuntimeError):
    """What cannot be shown in a browser, or touched from there, and what would work."""

    exit_code = MISUSE
