"""Compiles the kernels of shipped graphs before a run needs them: after an installation, and for a wheel.

python -m palpate.cli.machine.kernels            compile those of the usual graphs
python -m palpate.cli.machine.kernels bodies     compile those of the usual graphs, the kernels of bodies first
python -m palpate.cli.machine.kernels all        compile those of all graphs, bodies and nodes
python -m palpate.cli.machine.kernels check      exit code 3 if one of the usual graphs needs a compilation
python -m palpate.cli.machine.kernels copy TO    copy the compiled kernels that all graphs load to a folder
python -m palpate.cli.machine.kernels copy TO aarch64    compile them for machines of this name
"""

import contextlib
import gc
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from palpate import registry
from palpate.compiler import kernel_cache
from palpate.compiler.cores import usable_cores
from palpate.engine.segment import kernels, table_runner
from palpate.launch.load.launchfile import SCENES, LaunchFile, find, names
from palpate.launch.run.assign import jobs
from palpate.launch.run.descendants import die_with_parent
from palpate.launch.run.execute import execute
from palpate.launch.run.hop.blocks import picker
from palpate.launch.run.hop.hop import load
from palpate.launch.run.work.compiling import compiling
from palpate.launch.run.work.worker import Worker
from palpate.nodes.base import CompiledNode
from palpate.physics.errors import PalpateError
from palpate.physics.scratch import ScratchFolder

BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
USUAL = BODIES[:3]
TOUCHES = ("kidney", "nodule")  # Graphs in which every body fits
OTHER_SCENES = {
    "afferents": "nodule", "breathing": "kidney", "frictionless": "kidney", "grating": "texture", "lift": "pinch",
    "softness-4-newtons": "softness",
}  # fmt: skip
"""Shipped scenes that no graph names, and a graph that they fit."""
MISSING = 3  # Exit code of a check that finds a kernel which is not compiled
TICKS = 3


def usual() -> Iterator[tuple[str, LaunchFile]]:
    """Return the graph of the first run, with each body that deforms."""
    for body in USUAL:
        yield f"kidney with {body}", find("kidney").but(overrides=(f"tissue.use=deformation.{body}",))


def shipped_launches() -> Iterator[tuple[str, LaunchFile]]:
    """Return all graphs, with emulated devices, also with other scenes; graphs of one touch with each body."""
    yield from usual()
    for scene, name in OTHER_SCENES.items():
        yield f"{name} with {scene}", find(name).but(scene=SCENES / f"{scene}.yaml")
    for name in names():
        launch = find(name)
        nodes = launch.load().nodes
        ports = [node for node, spec in nodes.items() if spec.cls.hardware and hasattr(spec.cls, "port")]
        launch = launch.but(overrides=[f"{node}.port=emulator" for node in ports])
        yield name, launch
        for body in BODIES if name in TOUCHES else ():
            yield f"{name} with {body}", launch.but(overrides=(f"tissue.use=deformation.{body}",))


def start(launch: LaunchFile, folder: Path) -> None:
    """Run some ticks in this process; a graph with devices is only started. PalpateError: it does not fit together."""
    planned = launch.plan()
    if not any(planned.graph.nodes[name].cls.hardware for name in planned.order):
        duration = TICKS / planned.graph.rate
        done = execute(launch.but(clock="simulated", place="fused", duration=duration, record=folder / "run.mcap"))
        done.raise_signal()
        return
    [job] = jobs(planned, launch.but(place="fused").placement(planned), clock="real", ticks=TICKS, about={})
    worker = Worker(job, None, lambda _: None)
    try:
        worker.start()
    finally:
        worker.stop()


def compile_all(
    report: Callable[[str, int], None], runs: Iterator[tuple[str, LaunchFile]], folder: Path, nodes: bool = False
) -> int:
    """Compile or load the kernels of these runs, also in processes, and with `nodes` of all compiled nodes and of the
    real clock. Returns the number that was compiled.

    report  called with the name of a run before it, and the number so far before each compilation
    folder  for recordings
    """
    importlib.import_module("palpate.compiler.kernel")  # before that, `compiling` sees nothing
    count, now = 0, ""

    def count_kernel(_: int) -> None:
        nonlocal count
        count += 1
        report(now, count)

    for now, launch in runs:
        report(now, count)
        try:
            with compiling(count_kernel):
                start(launch, folder)
        except PalpateError:  # a body that does not fit, or a package that is not installed
            continue
    with compiling(count_kernel):
        now = "processes of a run"
        load(real=False)
        picker()
        if nodes:
            now = "all nodes"
            load(real=True)
            _compile_nodes()
    return count


def _compile_nodes() -> None:
    """Compile the steps of all shipped nodes, the loops over tables on both clocks, and an ensemble."""
    import palpate

    for real in (False, True):
        table_runner(real)
    for info in pkgutil.walk_packages(palpate.nodes.__path__, "palpate.nodes."):
        for kind in registry.declared_classes(importlib.import_module(info.name), CompiledNode):
            with contextlib.suppress(Exception):  # an abstract base
                kernels(kind, True)
    palpate.Ensemble("kidney", lanes=2, duration=TICKS * 1e-3).run(quiet=True)


def copy_loaded(to: Path, machine: str = "") -> int:
    """Copy the files from which this process has loaded kernels to a folder with the name of the shipped one. Returns
    their number.

    machine  write files for machines of this name instead
    """
    from palpate.compiler.target.dispatcher import CachedFunction
    from palpate.compiler.target.elsewhere import Elsewhere
    from palpate.compiler.target.processors import named
    from palpate.compiler.target.translation import Translation

    generator = Elsewhere(named(machine)) if machine else None
    folder = to / f"{kernel_cache.PREFIX}{kernel_cache.versions(minor=True)}"
    folder.mkdir(parents=True)
    functions = [function for function in gc.get_objects() if isinstance(function, CachedFunction)]
    hits = [(function, types) for function in functions for types in function.stats.cache_hits]
    loaded = {file: hit for hit in hits if (file := hit[0].file(hit[1])) is not None}
    for count, file in enumerate(sorted(loaded)):
        if generator is None:
            shutil.copyfile(file, folder / file.name)
        else:
            _report(machine, count)
            function, types = loaded[file]
            Translation(function, generator, folder).write(types)
    return len(loaded)


def _compile_bodies(folder: Path) -> None:
    """Compile the steps of the bodies of the usual graphs in reverse order, then these graphs."""
    die_with_parent()
    launches = list(usual())[::-1]
    for _, launch in launches:
        planned = launch.plan()
        kernels(planned.graph.nodes["tissue"].cls, True)
    compile_all(lambda name, count: None, iter(launches), folder)


def compile_usual() -> None:
    """Compile the kernels of the usual graphs, with progress on a terminal and one line at the end. On several cores a
    second process begins with those of the bodies; then each loads what the other one has compiled."""
    second = None
    if len(usable_cores()) > 1:
        second = subprocess.Popen([sys.executable, "-m", __spec__.name, "bodies"], stdin=subprocess.DEVNULL,
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip
    try:
        with ScratchFolder("kernels") as folder:
            compile_all(_report, usual(), Path(folder))
    finally:
        if second is not None:
            second.kill()  # all is compiled, or this process failed
            second.wait()
    print(f"{'' if _HIDDEN else chr(13)}kernels are compiled: {kernel_cache.folder()}{'':20}", file=sys.stderr)


_HIDDEN = not sys.stderr.isatty()


def _report(name: str, count: int) -> None:
    if not _HIDDEN:
        print(f"\rcompiling kernels: {count}, {name:40}", end="", file=sys.stderr, flush=True)


def _forget_results(empty: Path) -> None:
    """Compute what earlier runs have stored, such as prepared surfaces: the kernels for that are needed elsewhere. The
    folder of kernels, which may lie in the same place, stays."""
    kernel_cache.folder()
    os.environ["XDG_CACHE_HOME"] = str(empty)


def check_machine(*names: str) -> None:
    """SystemExit: no kernels can be compiled for machines of one of these names."""
    from palpate.compiler.target.processors import ProcessorError, named

    try:
        for name in names:
            named(name)
    except ProcessorError as error:
        raise SystemExit(str(error)) from None


def main(words: Sequence[str]) -> None:
    scratch = ScratchFolder("kernels")
    folder = Path(scratch.name)

    def end_if_missing(name: str, count: int) -> None:
        if count:
            scratch.cleanup()
            os._exit(MISSING)

    with scratch:
        match words:
            case ["check"]:
                compile_all(end_if_missing, usual(), folder)
            case ["bodies"]:
                _compile_bodies(folder)
            case ["all"]:
                _forget_results(folder)
                compile_all(_report, shipped_launches(), folder, nodes=True)
            case ["copy", to, *machine] if len(machine) < 2:
                check_machine(*machine)
                _forget_results(folder)
                if count := compile_all(_report, shipped_launches(), folder, nodes=True):
                    raise SystemExit(f"compiled {count} kernels, expected that all are in {kernel_cache.folder()}")
                copy_loaded(Path(to), *machine)
            case []:
                compile_usual()
            case _:
                raise SystemExit(
                    f"found {' '.join(words)!r}, expected nothing, bodies, all, check, or copy, a folder and perhaps a "
                    "machine"
                )


if __name__ == "__main__":
    main(sys.argv[1:])
