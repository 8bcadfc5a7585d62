"""`palpate list launch`: the shipped launch files, each a run that `palpate run NAME` starts."""

from palpate.cli.terminal.options import Json
from palpate.cli.terminal.output import console, print_json, say, table

EXAMPLE = "palpate list launch"


def launch(as_json: Json = False) -> None:
    """List the shipped launch files: graph, clock, duration and purpose of each run."""
    from palpate.launch.load.launchfile import find, names, purpose

    found = {name: find(name) for name in names()}
    if as_json:
        records = {
            name: {"graph": one.graph.stem, "clock": one.clock, "duration": one.duration, "purpose": purpose(one)}
            for name, one in found.items()
        }
        print_json({"ok": True, "launch": records})
        return
    rows = [(name, one.graph.stem, str(one.clock), f"{one.duration:g} s", purpose(one)) for name, one in found.items()]
    heads = ("launch file", "graph", "clock", ">duration", "purpose")
    console().print(table(heads, rows, fixed=heads[:4]))
    say("palpate run NAME starts one; palpate new launch NAME writes one of yours.", wrap=True)
