"""Write gallery.md: every launch file that ships, what it shows, its command, its clock and its nodes.

python docs/gallery.py
"""

from __future__ import annotations

from pathlib import Path

from palpate.launch.loading.launchfile import LAUNCHES, find
from palpate.launch.loading.plan import plan

TARGET = Path(__file__).with_name("gallery.md")
HEAD = """# Gallery

Every graph that ships, as `python docs/gallery.py` writes it. A run ends with its [pictures](pictures.md);
`palpate film` makes a [film](python.md) of its recording. `palpate plan GRAPH` lists what runs and why.

"""


def entry(name: str) -> str:
    """One launch file: its first comment, command, length, clock, rate and nodes."""
    launch = find(name)
    graph = launch.load()
    what = next(line for line in (LAUNCHES / f"{name}.yaml").read_text(encoding="utf-8").splitlines() if line)
    hardware = [node for node in plan(graph).order if graph.nodes[node].cls.hardware]
    command = f"palpate run {name}"
    if hardware:
        command += "".join(f" --set {node}.port=emulator" for node in hardware)
    nodes = ", ".join(f"{node} `{graph.nodes[node].use}`" for node in plan(graph).order)
    clock = launch.clock or "simulated"
    return (
        f"## {name}\n\n{what.lstrip('# ')}\n\n```sh\n{command}\n```\n\n"
        f"{launch.duration:g} s on the {clock} clock at {graph.rate:g} Hz. Nodes: {nodes}.\n"
    )


def gallery() -> str:
    """The whole page."""
    return HEAD + "\n".join(entry(file.stem) for file in sorted(LAUNCHES.glob("*.yaml")))


if __name__ == "__main__":
    TARGET.write_text(gallery(), encoding="utf-8")
    print(f"{TARGET}: {len(list(LAUNCHES.glob('*.yaml')))} runs")
