"""First starts: what a new user waits for, with kernels from a wheel, made by ./setup.sh, or not compiled yet.

    python benchmarks/first_starts.py [--bodies MassSpring BeamBundle ReducedFE]

Installs a clone of this repository and a wheel of it in separate environments (network, 3 GB, some minutes), each with
an empty cache of kernels, and runs the kidney for 10 ms with each body. Prints wall time, processor time of all
processes, and the number of kernels that each command compiled.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = ["run", "kidney", "--duration", "0.01", "--no-pictures", "-q", "--force", "--record"]


class Installation:
    """An environment and its cache of kernels."""

    def __init__(self, name: str, folder: Path) -> None:
        self.name, self.folder, self.cache = name, folder, folder / f"cache {name}"

    def call(self, what: str, *command: str | Path, cwd: Path) -> None:
        """Run a command, and print what it took."""
        used, begun, before = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter(), self._compiled()
        environment = os.environ | {"NUMBA_CACHE_DIR": str(self.cache)}
        done = subprocess.run(list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{what}: exit code {done.returncode}\n{done.stderr[-2000:]}")
        now, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begun
        busy = now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime
        count = self._compiled() - before
        print(f"{self.name:<28}{what:<28}{wall:>8.1f} s{busy:>10.1f} s{count:>9}", flush=True)

    def first_runs(self, palpate: Path, bodies: list[str]) -> None:
        """Run the kidney with each body, for the first time."""
        for body in bodies:
            tissue = ["--set", f"tissue.use=deformation.{body}"]
            self.call(f"first run, {body}", palpate, *RUN, self.folder / "first.mcap", *tissue, cwd=self.folder)

    def _compiled(self) -> int:
        return sum(1 for _ in self.cache.rglob("*.nbc"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", default=["MassSpring", "BeamBundle", "ReducedFE"])
    given = parser.parse_args()
    print(f"{len(os.sched_getaffinity(0))} cores, load average {os.getloadavg()[0]:.1f}")
    print(f"{'installation':<28}{'command':<28}{'wall':>10}{'processor':>12}{'kernels':>9}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clone, wheels = folder / "clone", folder / "wheels"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        source = Installation("clone", folder)
        source.call("./setup.sh", "./setup.sh", cwd=clone)
        source.first_runs(clone / ".venv" / "bin" / "palpate", given.bodies)
        bare = Installation("clone, kernels not compiled", folder)
        bare.first_runs(clone / ".venv" / "bin" / "palpate", given.bodies[:1])
        maker = Installation("maker of the wheel", folder)
        maker.call("python -m build", sys.executable, "-m", "build", "--wheel", "--outdir", wheels, clone, cwd=folder)
        (wheel,) = wheels.glob("*.whl")
        shipped = Installation("wheel", folder)
        shipped.call("python -m venv", sys.executable, "-m", "venv", folder / "env", cwd=folder)
        shipped.call("pip install", folder / "env" / "bin" / "pip", "install", "-q", f"{wheel}[view]", cwd=folder)
        shipped.first_runs(folder / "env" / "bin" / "palpate", given.bodies)


if __name__ == "__main__":
    main()
