"""`palpate messages`: the message types with units and shapes."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from palpate.launch.commands.common import Json, console, tell


def messages(
    name: Annotated[str | None, typer.Argument(help="One type, such as Contact.", metavar="[TYPE]")] = None,
    as_json: Json = False,
) -> None:
    """List the message types: fields, units and shapes; `(k)` is a length found at run time, `*` a field that a sender
    must give."""
    from palpate.engine.faults import Fault, GraphError, choices
    from palpate.messages import Message
    from palpate.messages.docs import message_types

    kinds = message_types()
    if name is not None and name not in kinds:
        raise GraphError([Fault(f"no message type {name!r}", choices("Types", name, kinds))])
    shown: list[type] = [Message, *kinds.values()] if name is None else [kinds[name]]
    descriptions = [describe(kind) for kind in shown]
    if as_json:
        tell({"messages": descriptions})
        return
    from rich.table import Table
    from rich.text import Text

    out = console()
    for data in descriptions:
        title = f"{data['name']}  {data['about']}"
        table = Table(
            box=None, pad_edge=False, title=Text(title, style="bold"), title_justify="left", show_header=False
        )
        for column in ("name", "unit", "shape", "text"):
            table.add_column(column, overflow="fold")
        for field in data["fields"]:
            shape = f"({', '.join(map(str, field['shape']))})"
            table.add_row(
                *map(Text, (f"{'*' * field['required']:2}{field['name']}", f"[{field['unit']}]", shape, field["about"]))
            )
        out.print(table)
        out.print()
    out.print("* a sender must give it; the others have a default", style="dim")


def describe(kind: type) -> dict[str, Any]:
    """A message type as plain data; the words on each field come from the class's docstring."""
    import msgspec

    from palpate.messages.docs import documented, summary

    required = {field.name for field in msgspec.structs.fields(kind) if field.required}
    listed = [{**field._asdict(), "required": field.name in required} for field in documented(kind)]
    return {"name": kind.__name__, "about": summary(kind), "fields": listed}
