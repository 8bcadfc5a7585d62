"""Write gallery.md: the purpose, command, picture, clock and nodes of the launch file of every shipped graph.

python docs/gallery.py             # the page
python docs/pictures/gallery.py    # its pictures
"""

from __future__ import annotations

from pathlib import Path

from palpate.launch.load.launchfile import find, names, purpose
from palpate.launch.load.plan import plan

TARGET = Path(__file__).with_name("gallery.md")
HEAD = """# Gallery

From this page you can run every shipped graph. `python docs/gallery.py` writes the page, and `python
docs/pictures/gallery.py` its pictures: the surface at its deepest instant, or one of the run's pictures, with emulated
devices and sensors. A run ends with its [pictures](pictures.md); `palpate picture FILE --film` makes a
[film](python.md) of its recording. `palpate plan GRAPH` lists the nodes that run, and why. `palpate run nodule
--scene afferents` adds the [spikes of the fingertip's afferents](equations/afferents.md), `palpate run texture --scene
grating` those over a [grating](equations/relief.md).

"""


def entry(name: str) -> str:
    """Section of one graph: purpose, command, picture, duration, clock, rate and nodes."""
    launch = find(name)
    graph = launch.load()
    hardware = [node for node in plan(graph).order if graph.nodes[node].cls.hardware]
    command = f"palpate run {name}"
    if hardware:
        command += "".join(f" --set {node}.port=emulator" for node in hardware)
        command += " --duration '4 s'" * ((launch.duration or 0.0) > 10.0)  # by then an emulated hand is at rest
    nodes = ", ".join(f"{node} `{graph.nodes[node].use}`" for node in plan(graph).order)
    clock = launch.clock or "simulated"
    return (
        f"## {name}\n\n{purpose(launch)}\n\n```sh\n{command}\n```\n\n"
        f"![A run of {name}](pictures/gallery-{name}.png)\n\n"
        f"{launch.duration:g} s on the {clock} clock at {graph.rate:g} Hz. Nodes: {nodes}.\n"
    )


def runs() -> list[str]:
    """The launch files that are named after their graph: one for each graph."""
    return [name for name in names() if find(name).graph.stem == name]


def gallery() -> str:
    """The whole page."""
    return HEAD + "\n".join(entry(name) for name in runs())


if __name__ == "__main__":
    TARGET.write_text(gallery(), encoding="utf-8")
    print(f"{TARGET}: {len(runs())} runs")
