"""Plants small faults in the code, one at a time, and lists those that no test detects.

    python tests/mutation.py                                the fixed list of 300 faults over all rooms: a night
    python tests/mutation.py --room physics --count 20      the first 20 of a room
    python tests/mutation.py --list                         prints the list and the tests of each fault
    python tests/mutation.py [--count 20] [--tests TEST_FILE]... FILE...

    python tests/mutation.py src/palpate/engine/slot.py launch/run/work/real.py
    python tests/mutation.py src/palpate/drivers/guard.py --tests tests/drivers/test_guard.py

The faults of a room or of files are in the order of a hash of file, line of code and change, so that the list is the
same on each machine, and an edit changes the faults of the edited code only. Each is planted in a copy of the tree. The
tests that import its module run against it, else those of the modules that import it, or those that `--tests` names,
until the first fails. A test file that fails without a fault is printed and left out. Survivors are printed with file,
line and change: either a test is missing, or nothing depends on that line. Kernels are compiled again for each fault in
one; some tests are faster as plain Python, with NUMBA_DISABLE_JIT=1.
"""

import argparse
import ast
import contextlib
import copy
import hashlib
import importlib
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from palpate.compiler.arithmetic import pin

sys.path.append(str(Path(__file__).parent / "support"))
from covering import ROOT, TOPS, sources, tests_of

pin()  # as the tests do, before numpy is imported
for module in [name for name in sys.modules if name.partition(".")[0] == "palpate"]:
    del sys.modules[module]  # a fault's tests import those of its copy
for library in (
    "numpy",
    "numba",
    "scipy.sparse.linalg",
    "scipy.spatial",
    "hypothesis",
    "zmq",
    "msgspec",
    "typer",
    "rich",
):
    importlib.import_module(library)  # once; each fault's tests run in a fork

ROOMS = {
    "contact": (40, ("nodes/contact", "src/palpate/physics/contact", "src/palpate/drivers/guard.py",
                     "src/palpate/drivers/limits.py")),
    "wire": (40, ("messages", "launch/run/wire", "launch/run/hop", "src/palpate/engine/encode.py")),
    "units": (40, ("src/palpate/units", "launch/load/values", "nodes/base/mesh_formats", "nodes/base/mesh_file.py",
                   "nodes/base/texture_file.py", "src/palpate/physics/table_text.py",
                   "src/palpate/physics/table_books.py", "src/palpate/models/fit/press.py",
                   "src/palpate/models/scan/read.py")),
    "records": (30, ("src/palpate/records",)),
    "physics": (120, ("src/palpate/physics",)),
    "rest": (30, TOPS),
}  # fmt: skip
"""Number of faults of each room, and its files and folders; a file belongs to the first room that names it."""
PATIENCE = 600  # [s] for the tests of one fault on a quiet machine; a longer one counts as hanging
SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.GtE, ast.GtE: ast.Lt,
    ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.And: ast.Or, ast.Or: ast.And, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


class Fault(NamedTuple):
    """A change of one node of a file's syntax tree, the one with this number in the order of `ast.walk`."""

    rank: bytes
    file: str
    line: int
    change: str
    number: int

    def source(self) -> str:
        """The file with the fault."""
        tree = ast.parse((ROOT / self.file).read_text(encoding="utf-8"))
        node = next(node for number, node in enumerate(ast.walk(tree)) if number == self.number)
        _plant(node)
        return ast.unparse(tree)


def faults(files: Iterable[Path]) -> list[Fault]:
    """All faults of files, in the order of their ranks."""
    return sorted(fault for file in files for fault in _faults(file))


def _faults(file: Path) -> Iterator[Fault]:
    name, seen = str(file), Counter[str]()
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    for number, node in enumerate(ast.walk(tree)):
        if not _plantable(node):
            continue
        changed = copy.deepcopy(node)
        _plant(changed)
        change = f"{_line(node)}  ->  {_line(changed)}"
        seen[change] += 1
        rank = hashlib.blake2b(f"{name}: {change} {seen[change]}".encode(), digest_size=8).digest()
        yield Fault(rank, name, getattr(node, "lineno", 0), change, number)


def _line(node: ast.AST) -> str:
    return ast.unparse(node).partition("\n")[0]


def _plantable(node: ast.AST) -> bool:
    match node:
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign():
            return type(node.op) in SWAPS
        case ast.Compare():
            return type(node.ops[0]) in SWAPS
        case ast.If() | ast.IfExp() | ast.While():
            return True
        case ast.Constant():
            return type(node.value) in (int, float)
    return False


def _plant(node: Any) -> None:
    match node:
        case ast.BinOp() | ast.BoolOp() | ast.AugAssign():
            node.op = SWAPS[type(node.op)]()
        case ast.Compare():
            node.ops[0] = SWAPS[type(node.ops[0])]()
        case ast.If() | ast.IfExp() | ast.While():
            node.test = ast.Constant(False)
        case ast.Constant():
            node.value = 0 if node.value else 1


def room_of(file: Path) -> str:
    return next(
        room for room, (_, places) in ROOMS.items() for place in map(Path, places) if place in (file, *file.parents)
    )


def listed(room: str, count: int | None = None) -> list[Fault]:
    """The fixed faults of a room, or its first `count`."""
    return faults(file for file in sources() if room_of(file) == room)[: count or ROOMS[room][0]]


def outcome(tree: Path, tests: list[str]) -> str:
    """`survived`: all tests pass in this tree; `found`: one fails; `hangs`: they took longer than `PATIENCE`, or on a
    busy machine a multiple of it. They run in a fork, which has the libraries but no module of this tree."""
    child = os.fork()
    if child == 0:
        os.setsid()
        os.chdir(tree)
        os.environ.update(PYTHONPATH=str(tree / "src"), PYTHONDONTWRITEBYTECODE="1")
        sys.dont_write_bytecode = True
        sys.path[0] = str(tree / "src")
        silence = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silence, 1)
        os.dup2(silence, 2)
        early = "ignore::pytest.PytestAssertRewriteWarning"  # hypothesis is imported already
        code = pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-W", early, *tests])
        os._exit(code not in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED))  # all may be long
    begun = time.monotonic()
    while time.monotonic() < begun + PATIENCE * max(1.0, os.getloadavg()[0] / len(os.sched_getaffinity(0))):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):  # with what it started
        os.killpg(child, signal.SIGKILL)
    if not done:
        os.waitpid(child, 0)
        return "hangs"
    return "found" if status else "survived"


def copied(folder: Path) -> Path:
    """A copy of the tree, and of the compiled kernels: those of faults must not evict the user's."""
    tree = folder / "tree"
    left_out = shutil.ignore_patterns(".*", "__pycache__", "runs", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=left_out)
    kernels = os.environ.get("NUMBA_CACHE_DIR") or os.path.expanduser("~/.cache/palpate")
    os.environ["NUMBA_CACHE_DIR"] = str(folder / "kernels")
    for path in Path(kernels).glob("kernels-*"):
        shutil.copytree(path, folder / "kernels" / path.name, ignore=shutil.ignore_patterns("*.lock"))
    return tree


def run(wanted: list[Fault], tests: list[str] | None, end: float) -> int:
    """Plant each fault and print what becomes of it. Returns the exit code: 2 if some tests fail without a fault; they
    are printed, and the others run."""
    tried, left, sound, bad = 0, Counter[str](), dict[str, bool](), 0
    with tempfile.TemporaryDirectory() as folder:
        tree = copied(Path(folder))
        for fault in wanted:
            if time.monotonic() > end:
                break
            chosen = []
            for test in tests or tests_of(Path(fault.file)):
                if test not in sound:
                    sound[test] = outcome(tree, [test]) == "survived"
                    if not sound[test]:
                        print(f"left out  {test}: it fails without a fault", flush=True)
                        bad = 2
                if sound[test]:
                    chosen.append(test)
            if not chosen:
                print(f"not tried {fault.file}:{fault.line}: no test of it passes", flush=True)
                bad = 2
                continue
            place = tree / fault.file
            original = place.read_text(encoding="utf-8")
            place.write_text(fault.source(), encoding="utf-8")
            tried += 1
            became = outcome(tree, chosen)
            left[room_of(Path(fault.file))] += became == "survived"
            print(f"{became:<8}  {fault.file}:{fault.line}: {fault.change}", flush=True)
            place.write_text(original, encoding="utf-8")
    by_room = ", ".join(f"{room} {count}" for room, count in left.items() if count)
    print(f"{left.total()} of {tried} faults survived{f': {by_room}' if by_room else ''}")
    return bad


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--room", choices=ROOMS)
    parser.add_argument("--count", type=int)
    parser.add_argument("--minutes", type=float, default=24 * 60.0)
    parser.add_argument("--list", action="store_true")
    parser.add_argument("--tests", action="append")
    given = parser.parse_args()
    if given.files:
        wanted = faults(given.files)[: given.count]
    else:
        wanted = [fault for room in ([given.room] if given.room else ROOMS) for fault in listed(room, given.count)]
    if given.list:
        for fault in wanted:
            tests = given.tests or tests_of(Path(fault.file))
            print(f"{room_of(Path(fault.file))}  {fault.file}:{fault.line}: {fault.change}  [{len(tests)} test files]")
        return 0
    return run(wanted, given.tests, time.monotonic() + 60 * given.minutes)


if __name__ == "__main__":
    raise SystemExit(main())
