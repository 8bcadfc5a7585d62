"""A node class in words."""

from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from palpate.engine.graph import sent_by
from palpate.messages.docs import summary
from palpate.nodes.base import Node, Observer, inputs, settings


def describe(use: str, cls: type[Node]) -> dict[str, Any]:
    """A node class as plain data: ports, settings, units, first sentence of its docstring."""
    observer = issubclass(cls, Observer)
    return {
        "use": use,
        "about": summary(cls),
        "source": cls.paced,
        "sink": cls.sink,
        "observer": observer,
        "inputs": [
            {"name": p.name, "type": p.expects, "optional": p.optional, "drives": i == 0 and not cls.paced}
            for i, p in enumerate(() if observer else inputs(cls))
        ],
        "outputs": [kind.__name__ for kind in sent_by(cls)],
        "settings": [
            {"name": s.name, "unit": s.unit, "type": _type(s.type), "limits": _limits(s.type),
             "default": None if s.default is ... else s.default, "required": s.default is ...}
            for s in settings(cls).values()
        ],
    }  # fmt: skip


def _type(hint: Any) -> str:
    """A setting's type as a user writes it: "float", "steel or silicone", "float or none"."""
    plain = getattr(hint, "__origin__", hint) if hasattr(hint, "__metadata__") else hint
    if get_origin(plain) is Literal:
        return " or ".join(map(str, get_args(plain)))
    if get_origin(plain) in (Union, UnionType):
        return " or ".join("none" if member is type(None) else _type(member) for member in get_args(plain))
    return plain.__name__ if isinstance(plain, type) and not hasattr(plain, "__args__") else str(plain)


def _limits(hint: Any) -> str:
    """The bounds of a setting, "> 0, <= 1"."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "min_length": "length >=", "max_length": "length <="}
    bounds = []
    for meta in getattr(hint, "__metadata__", ()):
        bounds += [
            f"{sign} {getattr(meta, key)}" for key, sign in signs.items() if getattr(meta, key, None) is not None
        ]
    return ", ".join(bounds)
