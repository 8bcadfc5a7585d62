"""Solvers that others wrote, each behind one adapter: studies and benchmarks hold ours against them."""

from palpate.physics.errors import ArgumentError


class MissingError(ArgumentError):
    """A reference solver, or a stored reference solution, that is missing; says how to get it."""
