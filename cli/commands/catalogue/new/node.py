"""`palpate new node`: a node and its test."""

from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import tell
from palpate.cli.terminal.templates import HERE, Folder, Force, write


def node(
    name: Annotated[str, typer.Argument(help="Name of the class, such as MyDrag.")],
    takes: Annotated[str, typer.Option(help="Message type that drives it.")] = "Contact",
    sends: Annotated[str, typer.Option(help="Message type that it sends.")] = "Force",
    out: Folder = HERE,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a node and its test, which passes unchanged."""
    from palpate.engine.faults import Fault, Faults, GraphError, choices
    from palpate.launch.template import class_name, node_files
    from palpate.messages.docs import message_types

    faults = Faults()
    kinds = message_types()
    for option, given in (("--takes", takes), ("--sends", sends)):
        if given not in kinds:
            faults.add(f"{option}: no message type {given!r}", choices("Types", given, kinds))
    faults.done()
    try:
        texts = node_files(name, kinds[takes], kinds[sends])
    except ValueError as error:
        raise GraphError([Fault(str(error))]) from None
    module, test = write(texts, out, force)
    use = f"{module.stem}.{class_name(name)}"
    if as_json:
        tell({"ok": True, "files": [str(module), str(test)], "use": use})
        return
    typer.echo(f"{module}\n{test}\nTest:  cd {out} && python -m pytest {test.name}")
    typer.echo(f"Graph: {{use: {use}, in: {{...}}}}")
