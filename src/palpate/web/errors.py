"""Errors of the build of a page."""

from palpate.physics.errors import MISUSE, PalpateError


class WebError(PalpateError, ValueError):
    """A graph, an option or a folder from which no page that runs without a server can be made; says what would do."""

    exit_code = MISUSE
