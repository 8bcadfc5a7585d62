"""`palpate info`: what a recording holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import Json, console, tell

if TYPE_CHECKING:
    from palpate.records.stored import Stored

File = Annotated[Path, typer.Argument(help="Recording (.mcap).", metavar="FILE")]


def info(file: File, as_json: Json = False) -> None:
    """Show the contents of a recording: streams, counts, rates, losses, duration, origin, truncation."""
    from palpate.records.stored import Stored

    data = describe(Stored(file))
    if as_json:
        tell(data)
    else:
        _print(data)


def describe(recording: Stored) -> dict[str, Any]:
    """The answer of `palpate info` as plain data."""
    counts = dict.fromkeys(recording.streams, 0)
    sizes = dict.fromkeys(recording.streams, 0)
    first: dict[str, int] = {}
    last: dict[str, int] = {}
    for name, _, time, payload in recording.raw():
        counts[name] += 1
        sizes[name] += len(payload)
        first.setdefault(name, time)
        last[name] = time
    about = recording.about
    begin, end = min(first.values(), default=0), max(last.values(), default=0)
    streams = []
    for name, stream in recording.streams.items():
        span = (last.get(name, 0) - first.get(name, 0)) * 1e-9
        streams.append({
            "name": name, "type": stream.schema["title"], "node": stream.producer, "every": stream.every,
            "thin": stream.thin, "count": counts[name], "lost": recording.counts.get(name, {}).get("lost"),
            "rate": (counts[name] - 1) / span if span > 0 and counts[name] > 1 else None, "bytes": sizes[name],
        })  # fmt: skip
    plan = about.get("plan", {})
    known = {s for node in plan.get("order", ()) for s in plan.get("wanted", {}) if s.partition(".")[0] == node}
    return {
        "file": str(recording.path),
        "size": recording.path.stat().st_size,
        "complete": recording.complete,
        "ending": recording.ending,
        "duration": (end - begin) * 1e-9,
        "clock": about.get("clock"),
        "date": about.get("date"),
        "graph": plan.get("path"),
        "rate": plan.get("rate"),
        "commit": about.get("commit"),
        "versions": about.get("versions"),
        "machine": about.get("machine"),
        "arithmetic": about.get("arithmetic"),
        "restarted": recording.restarted,
        "left_out": sorted(known - set(recording.streams)),
        "streams": streams,
    }


def _print(data: dict[str, Any]) -> None:
    from rich.table import Table
    from rich.text import Text

    out = console()
    size = f"{data['size'] / 1e6:.2f} MB" + (
        f", {data['size'] / data['duration'] / 1e3:.0f} kB/s" if data["duration"] else ""
    )
    out.print(Text.assemble((data["file"], "bold"), f"  {data['duration']:.3f} s, {size}, {data['clock']} clock"))
    machine, versions = data["machine"] or {}, data["versions"] or {}
    made = [data["date"], f"palpate {versions.get('palpate')}", f"commit {(data['commit'] or 'none')[:12]}"]
    out.print(Text(f"made {', '.join(map(str, made))}, on {machine.get('system')}", style="dim"))
    if data["arithmetic"]:
        how = dict(data["arithmetic"])
        instructions = how.pop("instructions")
        settings = ", ".join(f"{name} {value}" for name, value in how.items())
        out.print(Text(f"arithmetic {instructions}: {settings}", style="dim"))
    out.print(Text(f"graph {data['graph']}, {data['rate']:g} Hz" if data["rate"] else "graph unknown", style="dim"))
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("stream", "type"):
        table.add_column(title)
    for title in ("messages", "rate [Hz]", "lost", "size [kB]", "thinned"):
        table.add_column(title, justify="right")
    for s in data["streams"]:
        lost = "?" if s["lost"] is None else str(s["lost"])
        table.add_row(
            s["name"], s["type"], str(s["count"]), f"{s['rate']:.1f}" if s["rate"] else "",
            Text(lost, style="yellow" if s["lost"] else "dim"), f"{s['bytes'] / 1e3:.0f}",
            f"1 of {s['thin']}" if s["thin"] > 1 else "",
        )  # fmt: skip
    out.print(table)
    if data["left_out"]:
        out.print(Text(f"left out of the recording: {', '.join(data['left_out'])}", style="dim"))
    for node, ticks in data["restarted"].items():
        out.print(Text(f"{node} was started again at tick {', '.join(map(str, ticks))}", style="yellow"))
    if not data["complete"]:
        out.print(Text(data["ending"], style="yellow"), soft_wrap=True)
