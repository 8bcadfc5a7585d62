"""What can go wrong in a benchmark, and how wrong a method is."""

from __future__ import annotations

from palpate.physics.errors import MISUSE, PalpateError


class BenchError(PalpateError, ValueError):
    """A touch, method, reference or device that there is not, or that does not fit; says what would."""

    exit_code = MISUSE


class MissingError(BenchError):
    """An outside solver, or a stored reference, that is not there; says how to get it."""


class Refused(BenchError):
    """A method that cannot compute a touch; says why. It is charged, not dropped."""
