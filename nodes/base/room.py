"""A folder of node files as one room: `device.Falcon` is the class Falcon of any file of nodes/device."""

import sys
from collections.abc import Callable

from palpate.nodes.base.node import Node
from palpate.registry import classes, find


def room(name: str) -> tuple[Callable[[str], type[Node]], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a folder of nodes: a class, whose file is read when it is asked for, so that a
    graph with one device needs no other; and the names of all."""

    def get(wanted: str) -> type[Node]:
        kind = find(sys.modules[name], wanted, Node) if wanted[:1].isupper() else None
        if kind is None:
            raise AttributeError(f"module {name!r} has no attribute {wanted!r}")
        return kind

    return get, lambda: [*vars(sys.modules[name]), *classes(sys.modules[name], Node)]
