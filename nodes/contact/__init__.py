"""Normal contact of fingertip and tissue. Each class is found by its name in any file of this folder."""

from typing import Any

from palpate.nodes.base.room import class_of
from palpate.nodes.contact.series import Series

__all__ = ["Series"]


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
