"""Time of a step of the textures with 10 samples per tick (10 kHz in a loop of 1 kHz), compared with LuGre friction.

    python benchmarks/texture.py

Each step calls the compiled kernel from Python. Printed: p50 and p99 [us], and the ratio of the medians.
"""

import json
import tempfile
import time
from pathlib import Path

import numpy as np

from palpate.messages import Contact, Friction, Proximity
from palpate.nodes import friction
from palpate.nodes.texture import Autoregressive, Spectral

STEPS = 20_000
PRESS = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=1.0, compression=1e-3, indentation=1e-3,
                compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
NEAR = Proximity(
    foot=(0, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0.0, approach=1e-3, slip=(0.1, 0, 0)
)
RUB = Friction(force=(0.5, 0, 0), bristle=(1e-3, 0, 0), stick=False)


def timed(node, messages) -> np.ndarray:
    """Time of each step [us] without the first 1000."""
    node.start()
    records = node.records(messages)
    took = np.empty(STEPS)
    for i in range(STEPS):
        begin = time.perf_counter_ns()
        records.compute(messages, 1e-3)
        took[i] = time.perf_counter_ns() - begin
    return took[1000:] / 1e3


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ar.json"
        models = [{"speed": v, "force": f, "rms": 0.05, "lsf": list(np.linspace(0.1, 3.0, 20))}
                  for v in (0.05, 0.2) for f in (0.5, 2.0)]  # fmt: skip
        path.write_text(json.dumps({"sampling": 10e3, "quantity": "force", "models": models}))
        law = timed(friction.LuGre(), [PRESS, NEAR])
        print(f"{'LuGre':24} p50 {np.median(law):5.1f} us  p99 {np.quantile(law, 0.99):5.1f} us")
        for name, node in (("Spectral", Spectral()), ("Autoregressive, order 20", Autoregressive(model=str(path)))):
            took = timed(node, [RUB, PRESS, NEAR])
            ratio = np.median(took) / np.median(law)
            print(
                f"{name:24} p50 {np.median(took):5.1f} us  p99 {np.quantile(took, 0.99):5.1f} us  {ratio:.2f} x LuGre"
            )


if __name__ == "__main__":
    main()
