"""Time of a step of the mass-spring body and of the spreading, for meshes of 1e3 to 1e6 vertices.

    python benchmarks/mass_spring.py [--json]

A patch of 8 mm slides over each mesh. Both nodes use a sample of the vertices of a mesh finer than 1 mm, so the loaded
vertices, and the times, depend little on the mesh. A time is the median over 2000 steps. The finest mesh takes several
seconds to build.
"""

from __future__ import annotations

import statistics
import time

from rich.progress import track
from tables import parser, print_tables

from palpate.messages import Contact
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import MassSpring
from palpate.nodes.spread import Kernel

STEPS = 2000
RADIUS = 8e-3  # [m]


def measure(count: int) -> dict[str, float]:
    """Median step [us] of spreading and body on the kidney with about `count` vertices."""
    mesh = surface_mesh("kidney", count)
    begun = time.perf_counter()
    spread = Kernel(surface="kidney", vertices=count, position=(0.0, 0.0, 0.0), radius=RADIUS)
    body = MassSpring(surface="kidney", vertices=count, position=(0.0, 0.0, 0.0))
    spread.start()
    body.start()
    start = time.perf_counter() - begun
    times: dict[str, list[float]] = {"spread": [], "body": []}
    nodes = 0
    # a slide over vertices near the top, along the path of a finger's foot point
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
        "start [s]": start,
        **{f"{name} [us]": statistics.median(values) * 1e6 for name, values in times.items()},
    }


def main() -> None:
    given = parser(__doc__).parse_args()
    measure(1000)  # compile
    rows = [measure(count) for count in track((10**3, 10**4, 10**5, 10**6), "meshes", transient=True)]
    print_tables({"one step with a patch of 8 mm": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
