"""Normal contact of fingertip and tissue."""

from typing import Any

from palpate.nodes.contact.series import Series

__all__ = ["Probabilistic", "Series"]


def __getattr__(name: str) -> Any:
    """`contact.Probabilistic`, brought in when it is asked for: the force path does not need what it imports."""
    if name == "Probabilistic":
        from palpate.nodes.contact.probabilistic import Probabilistic

        return Probabilistic
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
