"""Errors of the build of a page."""

from palpate.physics.errors import PalpateError


class WebError(PalpateError):
    """A graph, an option or a folder from which no page can be made."""
