"""Adapters to reference solvers; studies and benchmarks compare palpate's finite elements with them."""

from palpate.physics.errors import ArgumentError


class MissingError(ArgumentError):
    """A reference solver, or a stored reference solution, that is missing; says how to get it."""
