"""What accuracy costs in time: every model on standard touches, its error beside its price.

`palpate bench accuracy` runs it; docs/accuracy.md says how to read what comes out and how each reference was made.
"""

from palpate.physics.errors import ArgumentError


class UnsupportedError(ArgumentError):
    """A method that cannot compute a touch; says why. It is charged, not dropped."""
