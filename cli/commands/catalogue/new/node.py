"""`palpate new node`: a node and its test."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import tell


def node(
    name: Annotated[str, typer.Argument(help="Name of the class, such as MyDrag.")],
    takes: Annotated[str, typer.Option(help="Message type that drives it.")] = "Contact",
    sends: Annotated[str, typer.Option(help="Message type that it sends.")] = "Force",
    folder: Annotated[Path, typer.Option(help="Where to write.")] = Path(),
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
    for file in texts:
        if (folder / file).exists():
            faults.add(f"{folder / file} exists", "Choose another name, or remove the file.")
    faults.done()
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    module, test = texts
    use = f"{Path(module).stem}.{class_name(name)}"
    if as_json:
        tell({"ok": True, "files": [str(folder / file) for file in texts], "use": use})
        return
    typer.echo(f"{folder / module}\n{folder / test}\nTest:  cd {folder} && python -m pytest {test}")
    typer.echo(f"Graph: {{use: {use}, in: {{...}}}}")
