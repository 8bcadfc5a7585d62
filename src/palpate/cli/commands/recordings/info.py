"""`palpate info`: contents and origin of a recording."""

from typing import Any

from palpate.cli.terminal.options import File, Json
from palpate.cli.terminal.output import console, print_json, say, table

EXAMPLE = "palpate info runs/kidney.mcap"


def info(file: File, as_json: Json = False) -> None:
    """Show the contents and the origin of a recording.

    Prints streams, counts, rates, losses, duration, origin, notes of the run, and whether it is truncated.
    """
    from palpate.records.contents import contents
    from palpate.records.stored import Stored

    data = contents(Stored(file))
    if as_json:
        print_json(data)
    else:
        _print(data)


def _print(data: dict[str, Any]) -> None:
    from rich.text import Text

    speed = f", {data['size'] / data['duration'] / 1e3:.0f} kB/s" if data["duration"] else ""
    size = f"{data['size'] / 1e6:.2f} MB{speed}"
    head = Text.assemble((data["file"], "bold"), f"  {data['duration']:.3f} s, {size}, {data['clock']} clock")
    console().print(head)
    machine, versions = data["machine"] or {}, data["versions"] or {}
    made = [data["date"], f"palpate {versions.get('palpate')}", f"commit {(data['commit'] or 'none')[:12]}"]
    say(f"made {', '.join(map(str, made))}, on {machine.get('system')}", "dim", wrap=True)
    if data["arithmetic"]:
        how = dict(data["arithmetic"])
        instructions = how.pop("instructions")
        settings = ", ".join(f"{name} {value}" for name, value in how.items())
        say(f"arithmetic {instructions}: {settings}", "dim", wrap=True)
    say(f"graph {data['graph']}, {data['rate']:g} Hz" if data["rate"] else "graph unknown", "dim", wrap=True)
    rows = []
    for s in data["streams"]:
        lost = Text("?" if s["lost"] is None else str(s["lost"]), style="yellow" if s["lost"] else "dim")
        rate = f"{s['rate']:.1f}" if s["rate"] else ""
        thin = f"1 of {s['thin']}" if s["thin"] > 1 else ""
        rows.append((s["name"], s["type"], str(s["count"]), rate, lost, f"{s['bytes'] / 1e3:.0f}", thin))
    heads = ("stream", "type", ">messages", ">rate [Hz]", ">lost", ">size [kB]", ">thinned")
    console().print(table(heads, rows))
    if data["left_out"]:
        say(f"left out of the recording: {', '.join(data['left_out'])}", "dim", wrap=True)
    for file in data["files"]:
        copy = "the copy in the recording takes its place" if file["copy"] else "the recording has no copy of it"
        say(f"file {file['name']}" + (f" {file['differs']}: {copy}" if file["differs"] else ""),
            "yellow" if file["differs"] else "dim", wrap=True)  # fmt: skip
    for node, ticks in data["restarted"].items():
        say(f"{node} was started again at tick {', '.join(map(str, ticks))}", "yellow", wrap=True)
    for note in data["notes"]:
        say(": ".join(filter(None, (note["node"], note["text"]))), "yellow", wrap=True)
    if not data["complete"]:
        say(data["ending"], "yellow")
