"""`palpate new`: write a new graph, scene, study, experiment, launch file or node."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Force, Json, check_new, one_of, out_option
from palpate.cli.terminal.output import print_json, write
from palpate.physics.archive import replace_text

EXAMPLE = "palpate new graph mine --like kidney"
NODE = "node"
TAKES, SENDS = "Contact", "Force"
INSTALL = "python -m pip install pytest && "
KINDS = {
    "graph": ("", "kidney", "palpate check {file} && palpate run {file}"),
    "scene": ("scenes", "kidney", "palpate run kidney --scene {file}"),
    "study": ("studies", "kidney-stiffness", "palpate study {file}"),
    "experiment": ("experiments", "kidney-stiffness", "palpate experiment {file} --simulate"),
    "launch": ("", "kidney", "palpate run {file}"),
}
"""For each kind: folder of shipped files below graphs/, default file to copy, and the command that uses the copy."""
_LAUNCH = """\
# One run: palpate run {file}
graph: {graph}
# scene: frictionless                # instead of the graph's scene
# place: two                         # processes; without it each node has one, `fused` means a single one
clock: simulated                     # or real
duration: 2 s
record: all                          # or sources (smaller, the rest is recomputed), or NAME.mcap
# set: {{rate: 500}}                   # values as for `--set`, such as tissue.stiffness: 200
"""


def new(
    kind: Annotated[str, typer.Argument(help=f"{', '.join(KINDS)} or {NODE}.", metavar="KIND")],
    name: Annotated[str, typer.Argument(help="Name of the file without extension; for a node, its class: MyDrag.")],
    like: Annotated[str | None, typer.Option(help="Shipped file to copy; for a launch file, the graph to run.")] = None,
    takes: Annotated[str, typer.Option(help="For a node: message type that drives it.")] = TAKES,
    sends: Annotated[str, typer.Option(help="For a node: message type that it sends.")] = SENDS,
    compiled: Annotated[bool, typer.Option("--compiled", help="For a node: its step is a compiled kernel.")] = False,
    out: Annotated[Path, out_option("Folder to write to.")] = Path(),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Write a graph, scene, study, experiment, launch file or node.

    Each is valid without changes: a copy of a shipped file with its comments, a launch file, or a node with its test.
    """
    one_of("KIND", kind, *KINDS, NODE)
    if kind != NODE and (takes, sends, compiled) != (TAKES, SENDS, False):
        raise typer.BadParameter(f"--takes, --sends and --compiled are for a node, found {kind}")
    if kind == NODE:
        texts, following = _node(name, takes, sends, compiled, out)
    else:
        texts, following = _file(kind, name, like, out)
    files = {out / file: text for file, text in texts.items()}
    check_new(files, force)
    out.mkdir(parents=True, exist_ok=True)
    for file, text in files.items():
        replace_text(file, text)
    if as_json:
        print_json({"ok": True, "files": [str(file) for file in files], "next": following})
    else:
        write("\n".join([*map(str, files), f"Next:  {following}"]))


def _file(kind: str, name: str, like: str | None, out: Path) -> tuple[dict[str, str], str]:
    """Name and text of the new file, and the command that uses it. GraphError: invalid name, or no file to copy."""
    from palpate.engine.faults import Fault, GraphError
    from palpate.launch.load.files import GRAPHS, find_file
    from palpate.launch.load.launchfile import find

    if not name.replace("-", "_").isidentifier():
        raise GraphError([Fault(f"{name!r} cannot name a {kind}; expected letters, digits, - and _, a letter first")])
    folder, usual, command = KINDS[kind]
    like, file = like or usual, out / f"{name}.yaml"
    if kind == "launch":
        graph = find(like).graph
        text = _LAUNCH.format(file=file, graph=graph.stem if graph.parent == GRAPHS else graph)
    else:
        text = find_file(like, GRAPHS / folder, GRAPHS / folder, what=kind).read_text(encoding="utf-8")
        if kind == "graph" and (run := find(like)).duration is not None and "\nrun:" not in text:
            text += f"run: {{clock: {run.clock}, duration: {run.duration:g} s, record: {name}.mcap}}\n"
    return {file.name: text}, command.format(file=file)


def _node(name: str, takes: str, sends: str, compiled: bool, out: Path) -> tuple[dict[str, str], str]:
    """File names and texts of a node and its test, and how to use it. GraphError: invalid name or message type."""
    from palpate.engine.faults import Fault, Faults, GraphError, choices
    from palpate.launch.template import class_name, node_files
    from palpate.messages.docs import message_types

    faults, kinds = Faults(), message_types()
    for option, given in (("--takes", takes), ("--sends", sends)):
        if given not in kinds:
            faults.add(f"{option}: no message type {given!r}", choices("Types", given, kinds))
    faults.done()
    try:
        texts = node_files(name, kinds[takes], kinds[sends], compiled)
    except ValueError as error:
        raise GraphError([Fault(str(error))]) from None
    module, test = texts
    use = f"{{use: {module.removesuffix('.py')}.{class_name(name)}, in: {{...}}}}"
    return texts, f"{'' if find_spec('pytest') else INSTALL}python -m pytest {out / test}; in a graph: {use}"
