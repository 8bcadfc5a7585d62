"""Accuracy benchmark: error and step time of every model on standard test cases.

`palpate bench accuracy` runs it; docs/accuracy.md explains the report and the reference solutions.
"""

from palpate.physics.errors import ArgumentError


class UnsupportedError(ArgumentError):
    """A method does not support a test case; the report lists it with the reason."""
