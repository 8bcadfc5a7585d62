"""What can go wrong in a benchmark, and how wrong a method is."""

from __future__ import annotations

from palpate.physics.errors import ArgumentError


class MissingError(ArgumentError):
    """An outside solver, or a stored reference, that is not there; says how to get it."""


class UnsupportedError(ArgumentError):
    """A method that cannot compute a touch; says why. It is charged, not dropped."""
