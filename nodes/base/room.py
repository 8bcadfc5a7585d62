"""A folder of node files as one namespace: `device.Falcon` is the class Falcon in any file of nodes/device."""

import sys
from collections.abc import Callable
from functools import cache

from palpate.nodes.base.node import Node
from palpate.registry import classes, find


def room(name: str) -> tuple[Callable[[str], type[Node]], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a folder of nodes.

    `__getattr__` imports the file of a class at its first use, so that a graph imports only the devices that it uses.
    """

    @cache
    def get(wanted: str) -> type[Node]:
        kind = find(sys.modules[name], wanted, Node) if wanted[:1].isupper() else None
        if kind is None:
            raise AttributeError(f"module {name!r} has no attribute {wanted!r}")
        return kind

    return get, lambda: [*vars(sys.modules[name]), *classes(sys.modules[name], Node)]
