"""`palpate nodes`: the catalogue of node classes."""

from __future__ import annotations

import inspect
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

import typer

from palpate.launch.commands.common import Json, console, tell

if TYPE_CHECKING:
    from palpate.nodes.base import Node


def nodes(
    name: Annotated[str | None, typer.Argument(help="One class, such as contact.Series.", metavar="[CLASS]")] = None,
    as_json: Json = False,
) -> None:
    """List the node classes, or show one with its inputs, outputs, settings and units."""
    from palpate.engine.faults import Fault, GraphError
    from palpate.launch.load.classes import ClassError, catalogue, find_class

    if name is not None:
        try:
            cls = find_class(name)
        except ClassError as error:
            raise GraphError([Fault(str(error).removeprefix("use: "), error.cure)]) from None
        if as_json:
            tell(describe(name, cls))
        else:
            _show(name, cls)
        return
    entries, missing = catalogue()
    if as_json:
        tell({"nodes": [describe(e.use, e.cls) for e in entries], "missing": missing})
        return
    from rich.text import Text

    out = console(soft_wrap=True)
    for entry in entries:
        data = describe(entry.use, entry.cls)
        takes = ", ".join(p["type"] + "?" * p["optional"] for p in data["inputs"])
        takes = takes or ("streams" if data["observer"] else "the clock")
        sends = ", ".join(data["outputs"]) or "nothing"
        out.print(Text.assemble((f"{entry.use:28}", "bold"), f" {takes} -> {sends}"))
        out.print(Text(f"    {entry.about}", style="dim"))
    for module, why in missing.items():
        out.print(f"[yellow]{module}[/] cannot be loaded. {why}", markup=True)


def describe(use: str, cls: type[Node]) -> dict[str, Any]:
    """A node class as plain data: ports, settings, units, first sentence of its docstring."""
    from palpate.engine.graph import sent_by
    from palpate.messages.docs import summary
    from palpate.nodes.base import Observer, inputs, settings

    observer = issubclass(cls, Observer)
    return {
        "use": use,
        "about": summary(cls),
        "source": cls.paced,
        "sink": cls.sink,
        "observer": observer,
        "inputs": [
            {"name": p.name, "type": p.type.__name__, "optional": p.optional, "drives": i == 0 and not cls.paced}
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


def _show(name: str, cls: type[Node]) -> None:
    from rich.table import Table
    from rich.text import Text

    data = describe(name, cls)
    out = console()
    out.print(Text(name, style="bold"))
    out.print(Text(inspect.getdoc(cls) or ""))
    kind = "source (the clock runs it)" * data["source"] or "observer (listens to streams)" * data["observer"]
    if kind:
        out.print(f"\n{kind}")
    ports = Table(box=None, pad_edge=False, title="\ninputs", title_justify="left", show_header=False)
    for port in data["inputs"]:
        note = "drives" if port["drives"] else "optional" if port["optional"] else "held"
        ports.add_row(port["name"], port["type"], note)
    if data["inputs"]:
        out.print(ports)
    if data["outputs"]:
        out.print(f"\nsends {', '.join(data['outputs'])}")
    table = Table(box=None, pad_edge=False, title="\nsettings", title_justify="left")
    for column in ("name", "unit", "default", "type", "limits"):
        table.add_column(column)
    for s in data["settings"]:
        default = "required" if s["required"] else str(s["default"])
        table.add_row(*map(Text, (s["name"], s["unit"], default, s["type"], s["limits"])))
    if data["settings"]:
        out.print(table)
