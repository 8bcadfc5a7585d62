"""How far a computation is."""

from collections.abc import Callable

Report = Callable[[float], None]  # Hears the share that is done, or of a solver the load that is reached


def unheard(done: float) -> None:
    """Nobody listens."""
