"""Files to begin from: `palpate new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.output import tell

Name = Annotated[str, typer.Argument(help="Name of the new file, without ending.")]
Folder = Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")]
HERE = Path()
Force = Annotated[bool, typer.Option("--force", help="Overwrite files that exist.")]


def write(texts: dict[str, str], folder: Path, force: bool) -> list[Path]:
    """Write texts to files of a folder. GraphError: some exist."""
    from palpate.engine.faults import Faults

    faults, files = Faults(), [folder / name for name in texts]
    for file in files:
        if file.exists() and not force:
            faults.add(f"{file} exists", "Choose another name, or overwrite it with --force.")
    faults.done()
    folder.mkdir(parents=True, exist_ok=True)
    for file, text in zip(files, texts.values(), strict=True):
        file.write_text(text, encoding="utf-8")
    return files


def copied(kind: str, name: str, like: str, folder: Path, force: bool, as_json: bool, command: str) -> None:
    """Write a copy of a shipped file under a new name, and print it with the command that uses it.

    kind  graph, scene, study or experiment
    like  name of the shipped file. GraphError: there is none
    """
    from palpate.engine.faults import Fault, GraphError
    from palpate.launch.load.files import GRAPHS, SCENES, find_file

    if not name.replace("-", "_").isidentifier():
        raise GraphError([Fault(f"{name!r} cannot name a {kind}; expected letters, digits, - and _, a letter first")])
    shipped = {"graph": GRAPHS, "scene": SCENES, "study": GRAPHS / "studies", "experiment": GRAPHS / "experiments"}[
        kind
    ]
    text = find_file(like, shipped, shipped, what=kind).read_text(encoding="utf-8")
    file = write({f"{name}.yaml": text.replace(f"record: {like}.mcap", f"record: {name}.mcap")}, folder, force)[0]
    if as_json:
        tell({"ok": True, "files": [str(file)]})
    else:
        typer.echo(f"{file}\nNext:  {command.format(file=file)}")
