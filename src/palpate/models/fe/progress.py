"""Progress of a computation."""

from collections.abc import Callable

Report = Callable[[float], None]  # Called with the completed fraction, by a solver with the load that it has reached


def unheard(done: float) -> None:
    """Ignores the progress."""
