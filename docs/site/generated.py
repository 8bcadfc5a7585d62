"""The reference part of the site, generated from the code when Sphinx starts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from commands import commands
from prose import cell, prose, table
from python import library, public

from palpate.cli.commands.graphs.list.messages import describe as message
from palpate.cli.commands.graphs.list.nodes import switched_by
from palpate.launch.load.classes import catalogue, describe
from palpate.launch.load.launchfile import find, names
from palpate.launch.load.tissues import GRADES, tissues
from palpate.messages import Message
from palpate.messages.docs import message_types

HERE = Path(__file__).parents[1] / "reference"


def nodes() -> str:
    """Each node class with its ports, settings and effects."""
    entries, missing = catalogue()
    if missing:
        raise SystemExit(f"nodes that cannot be loaded: {missing}; the site needs all extras, pip install -e '.[all]'")
    lines = ["# Nodes", "", "The classes for `use:` in a graph. `palpate list nodes CLASS` prints the same.", ""]
    for entry in entries:
        data = describe(entry.use, entry.cls)
        lines += [f"## {entry.use}", "", prose(entry.cls.__doc__ or ""), ""]
        role = "The clock runs it." * data["source"] or "Listens to streams." * data["observer"]
        lines += [role, ""] if role else []
        ports = [
            (p["name"], f"`{p['type']}`", "drives" if p["drives"] else "optional" if p["optional"] else "held")
            for p in data["inputs"]
        ]
        lines += table(("input", "message", ""), ports)
        if data["outputs"]:
            lines += [f"Sends {', '.join(f'`{kind}`' for kind in data['outputs'])}.", ""]
        settings = [
            (f"`{s['name']}`", s["unit"], "required" if s["required"] else str(s["default"]), s["type"], s["limits"])
            for s in data["settings"]
        ]
        lines += table(("setting", "unit", "default", "type", "limits"), settings)
        effects = [
            (f"`{e['effect']}`", switched_by(e), ", ".join(f"`{name}`" for name in e["fields"]), e["about"])
            for e in data["effects"]
        ]
        lines += table(("effect", "switched by", "fields", ""), effects)
    return "\n".join(lines)


def messages() -> str:
    """Each message type with its fields."""
    lines = [
        "# Messages",
        "",
        "The messages of nodes: fields with unit and shape; a letter is a length determined at run time.",
        "",
    ]
    for kind in (Message, *message_types().values()):
        data = message(kind)
        rows = []
        for f in data["fields"]:
            shape, given = ", ".join(map(str, f["shape"])), "must be given" if f["required"] else ""
            rows.append((f"`{f['name']}`", f["unit"], f"({shape})", given, f["about"]))
        lines += ["", f"## {data['name']}", "", f"{cell(data['about'])}.", ""]
        lines += table(("field", "unit", "shape", "", ""), rows)
    return "\n".join(lines)


def graphs() -> str:
    """Each file of a graph and of a scene, as it ships."""
    lines = ["# Graph files", "", "The shipped graphs and their scenes. [Graphs](../graphs.md) explains them.", ""]
    files = dict.fromkeys(find(name).graph for name in names())
    for file in (*files, *sorted((next(iter(files)).parent / "scenes").glob("*.yaml"))):
        title = f"scene {file.stem}" if file.parent.name == "scenes" else file.stem
        lines += [f"## {title}", "", "```yaml", file.read_text(encoding="utf-8").rstrip(), "```", ""]
    return "\n".join(lines)


def published() -> str:
    """The published tissues with their sources."""
    found, left_out = tissues()
    lines = ["# Tissues", "", "Tissues that a scene can name: `scene: {tissue: liver-human}`.", ""]
    for name, record in found.items():
        rows = [(key, GRADES[value] if key == "grade" else str(value)) for key, value in record.items()]
        lines += [f"## {name}", "", *table(("", ""), rows)]
    lines += ["## Left out", "", *table(("tissue", "why"), list(left_out.items()))]
    return "\n".join(lines)


PAGES: dict[str, Callable[[], str]] = {
    "commands": commands,
    "nodes": nodes,
    "messages": messages,
    "graphs": graphs,
    "tissues": published,
    "python": public,
}


def pages() -> Iterator[tuple[str, str]]:
    """Name and text of each page."""
    for name, write in PAGES.items():
        yield name, write()
    formulas = dict(library())
    yield from formulas.items()
    tree = "\n".join(formulas)
    yield (
        "index",
        f"# Formulas\n\n`palpate.physics`: arrays in, arrays out.\n\n```{{toctree}}\n:maxdepth: 1\n\n{tree}\n```\n",
    )


def write(_: Any = None) -> None:
    """Write the changed pages only, so that Sphinx reads no unchanged ones."""
    HERE.mkdir(exist_ok=True)
    found = dict(pages())
    for file in HERE.glob("*.md"):
        if file.stem not in found:
            file.unlink()
    for name, text in found.items():
        file = HERE / f"{name}.md"
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Entry point for Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}
