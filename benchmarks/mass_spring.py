"""Step time of the mass-spring body and of the spreading against the number of vertices: 1e3 to 1e6.

    python benchmarks/mass_spring.py [--json]

The zone of influence holds about 200 vertices on every mesh, so what is left is the cost that the mesh itself causes.
A time is the median over 2000 steps of a press that slides; the finest mesh takes some seconds to build.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time

from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from palpate.messages import Contact
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import MassSpring
from palpate.nodes.spread import Kernel

STEPS = 2000
ZONE = 200  # vertices under the finger


def measure(count: int) -> dict[str, float]:
    """[us] median step of spreading and body on the kidney with about `count` vertices."""
    mesh = surface_mesh("kidney", count)
    radius = (ZONE * mesh.areas.sum() / len(mesh.vertices) / 3.14159) ** 0.5
    begun = time.perf_counter()
    spread = Kernel(surface="kidney", vertices=count, position=(0.0, 0.0, 0.0), radius=radius)
    body = MassSpring(surface="kidney", vertices=count, position=(0.0, 0.0, 0.0))
    spread.start()
    body.start()
    start = time.perf_counter() - begun
    times: dict[str, list[float]] = {"spread": [], "body": []}
    nodes = 0
    # A slide over vertices near the top, as the foot point of a finger would move.
    top = mesh.vertices[:, 2].argmax()
    foot = mesh.vertices[top]
    for step in range(STEPS):
        here = (foot[0] + 1e-5 * step, foot[1], foot[2])
        contact = Contact(
            foot=here, normal=(0.0, 0.0, 1.0), force=1.0, compression=2e-3, indentation=4e-3,
            compression_rate=0.0, indentation_rate=0.0,
        )  # fmt: skip
        begun = time.perf_counter()
        load = spread.step(contact, None)
        middle = time.perf_counter()
        body.step([load], dt=1e-3)
        ended = time.perf_counter()
        times["spread"].append(middle - begun)
        times["body"].append(ended - middle)
        nodes += len(load.nodes)
    return {
        "vertices": len(mesh.vertices),
        "loaded": nodes / STEPS,
        "start": start,
        **{name: statistics.median(values) * 1e6 for name, values in times.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    measure(1000)  # compile
    rows = [measure(count) for count in track((10**3, 10**4, 10**5, 10**6), "meshes", transient=True)]
    if given.json:
        print(json.dumps(rows))
        return
    table = Table(title="one step with about 200 loaded vertices", box=None)
    for title in ("vertices", "loaded", "spread [us]", "body [us]", "start [s]"):
        table.add_column(Text(title), justify="right")
    for row in rows:
        table.add_row(
            f"{row['vertices']}",
            f"{row['loaded']:.0f}",
            f"{row['spread']:.1f}",
            f"{row['body']:.1f}",
            f"{row['start']:.2f}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
