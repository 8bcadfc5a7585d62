"""First starts: what a new user waits for, with kernels from a wheel, made by ./setup.sh, or not compiled yet.

    python benchmarks/first_starts.py [--bodies MassSpring BeamBundle ReducedFE]
    python benchmarks/first_starts.py --against OTHER [--set-up] [--repeat 5]

Installs a clone of this repository and a wheel of it in separate environments (network, 3 GB, some minutes), each with
an empty cache of kernels, and runs the kidney for 10 ms with each body. Prints wall time, processor time of all
processes, and the number of kernels that each command compiled.

With --against, it compares this copy with another one, by the processor time of all processes of each command, in turns
and in the environment that runs it; with --set-up also that of ./setup.sh in a clone of each (network).
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN = ["run", "kidney", "--duration", "0.01", "--no-pictures", "-q", "--record"]


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
            (self.folder / "first.mcap").unlink(missing_ok=True)
            self.call(f"first run, {body}", palpate, *RUN, self.folder / "first.mcap", *tissue, cwd=self.folder)

    def _compiled(self) -> int:
        return sum(1 for _ in self.cache.rglob("*.nbc"))


GOALS = {"set-up": 0.7, "first tick": 0.6, "run kidney": 0.35, "check kidney": 0.5, "--help": 0.5}
"""Largest ratio of the processor time of a command to that before, as set for the first minute."""


class Copies:
    """Two copies of the repository, whose commands are timed in turns.

    folder  for caches of kernels and recordings
    """

    def __init__(self, folder: Path, here: Path, there: Path) -> None:
        self.folder, self.copies, self.record = folder, {"here": here, "against": there}, folder / "run.mcap"

    def call(self, copy: str, command: Sequence[str], cache: Path, cwd: Path | None = None) -> float:
        """Processor time [s] of all processes of a command of a copy, with this cache of kernels."""
        source = self.copies[copy] / "src"
        environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(source)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # containers set it; then each command would parse its sources
        if "run" in command:
            self.record.unlink(missing_ok=True)  # an older copy has no `--force`
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, cwd=cwd or self.folder, env=environment, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{copy}: {' '.join(command)}: exit code {done.returncode}\n{done.stderr[-2000:]}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def palpate(self, *words: str) -> list[str]:
        return [sys.executable, "-m", "palpate.cli", *words]

    def compare(self, name: str, repeat: int, command: Sequence[str]) -> None:
        """Print the least of several times of a command in both copies; each has its cache of kernels."""
        times: dict[str, list[float]] = {copy: [] for copy in self.copies}
        for _ in range(repeat):
            for copy in self.copies:
                times[copy].append(self.call(copy, command, self.folder / copy))
        self.report(name, *(min(each) for each in times.values()))

    def report(self, name: str, here: float, there: float) -> None:
        goal = f"{GOALS[name]:>8.2f}" if name in GOALS else ""
        print(f"{name:<28}{here:>10.2f} s{there:>10.2f} s{here / there:>8.2f}{goal}", flush=True)

    def set_up(self) -> None:
        """Clone each copy, and time its ./setup.sh with an empty cache of kernels."""
        times = []
        for copy, place in self.copies.items():
            clone = self.folder / f"clone {copy}"
            subprocess.run(["git", "clone", "-q", str(place), str(clone)], check=True)
            times.append(self.call(copy, ["./setup.sh"], self.folder / f"set-up {copy}", clone))
        self.report("set-up", *times)


def compare(folder: Path, there: Path, repeat: int, set_up: bool) -> None:
    """Print the processor times of both copies, their ratios, and the goals."""
    copies = Copies(folder, ROOT, there)
    record = str(copies.record)
    print(f"{'command':<28}{'here':>12}{'against':>12}{'ratio':>8}{'goal':>8}")
    if set_up:
        copies.set_up()
    copies.compare("first tick", 1, copies.palpate(*RUN, record))  # with empty caches of kernels
    run = ("run", "kidney", "-q", "--record", record)
    for copy in copies.copies:  # compiles the kernels of several processes, and writes bytecode
        copies.call(copy, copies.palpate(*run), folder / copy)
    for name, words in {
        "run kidney": run,
        "run kidney --no-pictures": (*run, "--no-pictures"),
        "the same, --fused": (*run, "--no-pictures", "--fused"),
        "picture": ("picture", record, "-o", str(folder)),
        "check kidney": ("check", "kidney"),
        "--help": ("--help",),
    }.items():
        copies.compare(name, repeat, copies.palpate(*words))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bodies", nargs="+", default=["MassSpring", "BeamBundle", "ReducedFE"])
    parser.add_argument("--against", type=Path, metavar="OTHER", help="another copy of the repository")
    parser.add_argument("--set-up", action="store_true", help="with --against: also ./setup.sh")
    parser.add_argument("--repeat", type=int, default=5, help="with --against: times of each command")
    given = parser.parse_args()
    # without its sources Python would import this copy for both
    if given.against is not None and not (given.against / "src" / "palpate").is_dir():
        parser.error(f"--against: found {given.against}, expected the folder of another copy, with src/palpate")
    print(f"{len(os.sched_getaffinity(0))} cores, load average {os.getloadavg()[0]:.1f}")
    if given.against is not None:
        with tempfile.TemporaryDirectory() as name:
            compare(Path(name), given.against.resolve(), given.repeat, given.set_up)
        return
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
