"""`palpate list nodes`: the catalogue of node classes."""

import inspect
from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, say, table

EXAMPLE = "palpate list nodes contact.Series"


def nodes(
    name: Annotated[str | None, typer.Argument(help="One class, such as contact.Series.", metavar="[CLASS]")] = None,
    as_json: Json = False,
) -> None:
    """List the node classes, or show one with ports, settings, units and effects."""
    from palpate.engine.faults import Fault, GraphError
    from palpate.launch.load.classes import ClassError, catalogue, describe, find_class

    if name is not None:
        try:
            cls = find_class(name)
        except ClassError as error:
            raise GraphError([Fault(str(error).removeprefix("use: "), error.cure)]) from None
        if as_json:
            print_json(describe(name, cls))
        else:
            _show(describe(name, cls), inspect.getdoc(cls) or "")
        return
    entries, missing = catalogue()
    if as_json:
        print_json({"nodes": [describe(e.use, e.cls) for e in entries], "missing": missing})
        return
    from rich.text import Text

    out = console(soft_wrap=True)
    for entry in entries:
        data = describe(entry.use, entry.cls)
        takes = ", ".join(p["type"] + "?" * p["optional"] for p in data["inputs"])
        takes = takes or ("streams" if data["observer"] else "the clock")
        sends = ", ".join(data["outputs"]) or "nothing"
        out.print(Text.assemble((f"{entry.use:28}", "bold"), f" {takes} -> {sends}"))
        out.print(Text(f"    {data['about']}", style="dim"))
    for module, why in missing.items():
        out.print(Text.assemble((module, "yellow"), f" cannot be loaded. {why}"))


def _show(data: dict[str, Any], text: str) -> None:
    out = console()
    say(data["use"], "bold", wrap=True)
    say(text, wrap=True)
    kind = "source (the clock runs it)" * data["source"] or "observer (listens to streams)" * data["observer"]
    if kind:
        out.print(f"\n{kind}")
    ports = [
        (port["name"], port["type"], "drives" if port["drives"] else "optional" if port["optional"] else "held")
        for port in data["inputs"]
    ]
    if ports:
        out.print(table(("", "", ""), ports, title="\ninputs"))
    if data["outputs"]:
        out.print(f"\nsends {', '.join(data['outputs'])}")
    rows = [
        (s["name"], s["unit"], "required" if s["required"] else str(s["default"]), s["type"], s["limits"])
        for s in data["settings"]
    ]
    if rows:
        out.print(table(("name", "unit", "default", "type", "limits"), rows, title="\nsettings"))
    if data["effects"]:
        effects = [(e["effect"], switched_by(e), ", ".join(e["fields"]), e["about"]) for e in data["effects"]]
        out.print(table(("effect", "switched by", "fields", ""), effects, title="\neffects"))


def switched_by(effect: dict[str, Any]) -> str:
    """What a class leaves out without an effect: the node, a part of it, or what a setting describes."""
    if effect["setting"]:
        return f"{effect['setting']}, off at {effect['off']:g}"
    needed = f" (also for {', '.join(effect['needed_by'])})" if effect["needed_by"] else ""
    return effect["how"] + needed
