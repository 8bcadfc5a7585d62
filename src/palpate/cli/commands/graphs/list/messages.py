"""`palpate list messages`: the message types with units and shapes."""

from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, say, table

EXAMPLE = "palpate list messages Contact"


def messages(
    name: Annotated[str | None, typer.Argument(help="One type, such as Contact.", metavar="[TYPE]")] = None,
    as_json: Json = False,
) -> None:
    """List the message types: fields, units and shapes.

    `(k)`: the length may differ in each message; `*`: a field without a default, which a sender must set.
    """
    from palpate.engine.faults import Fault, GraphError, choices
    from palpate.messages import Message
    from palpate.messages.docs import message_types

    kinds = message_types()
    if name is not None and name not in kinds:
        raise GraphError([Fault(f"no message type {name!r}", choices("Types", name, kinds))])
    shown: list[type] = [Message, *kinds.values()] if name is None else [kinds[name]]
    descriptions = [describe(kind) for kind in shown]
    if as_json:
        print_json({"messages": descriptions})
        return
    for data in descriptions:
        rows = []
        for field in data["fields"]:
            shape = f"({', '.join(map(str, field['shape']))})"
            rows.append((f"{'*' * field['required']:2}{field['name']}", f"[{field['unit']}]", shape, field["about"]))
        say(f"{data['name']}  {data['about']}", "bold", wrap=True)
        console().print(table(("", "", "", ""), rows), "")
    say("* a sender must give it; the others have a default", "dim")


def describe(kind: type) -> dict[str, Any]:
    """A message type as plain data; the descriptions of the fields come from the class's docstring."""
    import msgspec

    from palpate.messages.docs import documented_fields, summary

    required = {field.name for field in msgspec.structs.fields(kind) if field.required}
    listed = [{**field._asdict(), "required": field.name in required} for field in documented_fields(kind)]
    return {"name": kind.__name__, "about": summary(kind), "fields": listed}
