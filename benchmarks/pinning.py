"""What it costs to compute with the instructions of x86-64-v3 alone: user time pinned over user time unpinned.

    python benchmarks/pinning.py [--rounds 3]

The whole kidney loop in one process, and the layered organ's stiffness factored and solved once; each in processes of
its own, pinned and with PALPATE_NATIVE=1, by turns. The least user time of each counts, as neighbours on the machine
only ever add; kernels are compiled beforehand.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys

from tables import show

LOOP = """
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
import dataclasses
def work():
    assert execute(dataclasses.replace(find("kidney").but(place="fused", duration=20.0), record=None)).result.ok
"""
FACTOR = """
import palpate.models.fe as fe  # before numpy
import numpy as np
from palpate.models.fe.element.mesh import box
mesh = box((0.05, 0.05, 0.05), (10, 10, 10))
held = np.zeros((len(mesh.points), 3), dtype=bool)
held[mesh.points[:, 2] < 1e-9] = True
def work():
    from palpate.models.fe.solve.body import ElasticBody
    body = ElasticBody(mesh, {0: fe.neo_hooke(5e3, 0.45)}, [])
    tangent = body.rest(held)
    tangent.solve(np.ones((mesh.points.size, 1)))
"""
MEASURE = """
import json, resource
work()
begun = resource.getrusage(resource.RUSAGE_SELF).ru_utime
work()
from palpate.physics.arithmetic import in_force
print(json.dumps([resource.getrusage(resource.RUSAGE_SELF).ru_utime - begun, in_force()["instructions"]]))
"""
PINNED = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "PALPATE_NATIVE")


def measure(code: str, native: bool) -> tuple[float, str]:
    """[s] user time of the second call, and what it was computed with."""
    environment = {name: value for name, value in os.environ.items() if name not in PINNED}
    environment |= {"PALPATE_NATIVE": "1"} if native else {}
    run = subprocess.run([sys.executable, "-c", code + MEASURE], env=environment, stdout=subprocess.PIPE, check=True)
    seconds, instructions = json.loads(run.stdout)
    return seconds, instructions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    rows: list[dict[str, object]] = []
    for what, code in (("kidney loop, fused, 20 000 ticks", LOOP), ("stiffness, factored and solved", FACTOR)):
        times_of = {native: [measure(code, native) for _ in range(rounds)] for native in (False, True)}
        least = {native: min(seconds for seconds, _ in times) for native, times in times_of.items()}
        rows.append({"what": what, "pinned s": least[False], "this processor s": least[True],
                     "ratio": least[False] / least[True]})  # fmt: skip
    show(f"this processor: {times_of[True][0][1]}; load {os.getloadavg()[0]:.1f}", rows)


if __name__ == "__main__":
    main()
