"""Progress of a computation."""

from collections.abc import Callable

Report = Callable[[float], None]  # Called with the completed share; a solver calls it with the load it has reached


def unheard(done: float) -> None:
    """Ignores the progress."""
