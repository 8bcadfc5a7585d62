"""Episodes of a data set for robot learning (docs/lerobot.md): processor time and size of each, scaled to 10 000.

    python benchmarks/lerobot.py [EPISODES]      (default 500)

Every episode presses on the kidney for 2 s at another place, to another depth, on tissue of another stiffness, with 30
frames and 150 touch samples per second. All is included: the graph of each motion, the touch, and the files.
"""

import sys
import tempfile
import warnings
from pathlib import Path
from resource import RUSAGE_SELF, getrusage

import numpy as np

import palpate

FULL = 10_000
DURATION = 2.0  # [s] of an episode


def presses(count: int) -> palpate.Ensemble:
    """Presses at random places, seeded."""
    draw = np.random.default_rng(1)
    x, y = draw.uniform(-0.02, 0.02, count), draw.uniform(-0.01, 0.01, count)
    depth = draw.uniform(0.093, 0.098, count)
    paths = [
        [{"to": [a, b, z], "time": 0.6}, {"hold": 0.4}, {"to": [a, b, 0.116], "time": 0.6}]
        for a, b, z in zip(x.tolist(), y.tolist(), depth.tolist(), strict=True)
    ]
    begins = [[a, b, 0.116] for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    over = {"tissue.stiffness": draw.uniform(130.0, 390.0, count), "scene.hand.begin": begins, "scene.hand.path": paths}
    return palpate.Ensemble("kidney", count, over, duration=DURATION)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    presses(2)  # kernels and meshes
    with tempfile.TemporaryDirectory() as folder:
        begun = getrusage(RUSAGE_SELF)
        out = presses(count).run(out=Path(folder, "set"), form="lerobot", quiet=True)
        ended = getrusage(RUSAGE_SELF)
        size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    time = ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime
    print(f"{count} episodes of {DURATION:g} s: {time:.1f} s of processor time, {size / 1e6:.1f} MB")
    print(
        f"an episode: {1e3 * time / count:.1f} ms, {size / count / 1e3:.1f} kB; memory {ended.ru_maxrss / 1e3:.0f} MB"
    )
    print(f"{FULL} at this rate: {time * FULL / count / 60.0:.1f} min of one core, {size * FULL / count / 1e9:.2f} GB")


if __name__ == "__main__":
    main()
