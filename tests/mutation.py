"""Puts small faults into the code, one at a time, and lists those that no test detects.

    python tests/mutation.py [--minutes 20] [--seed 0] [--tests TEST_FILE]... FILE...

    python tests/mutation.py src/palpate/engine/slot.py launch/run/work/real.py
    python tests/mutation.py src/palpate/drivers/guard.py --tests tests/drivers/test_guard.py

Works on a copy of the tree. Each mutant is run against the tests that import its module (for `engine` and `launch/run`:
those of runs and replays) or those that `--tests` names, and ends at the first that fails. Survivors are printed with
file, line and change: either a test is missing, or nothing depends on that line. An hour for a folder. Kernels are
compiled again for each mutant; their tests are mostly faster as plain Python, with NUMBA_DISABLE_JIT=1.
"""

import argparse
import ast
import contextlib
import copy
import importlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

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
    importlib.import_module(library)  # once; each mutant's tests run in a fork

ROOT = Path(__file__).parent.parent
RUNS = ("test_real_clock", "test_run", "test_bad_runs", "test_start_barrier", "test_wire", "test_zmtp", "test_replay")
PATIENCE = 600  # [s] for the tests of one mutant; one that hangs is noticed
SWAPS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Lt: ast.GtE, ast.GtE: ast.Lt,
    ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
    ast.And: ast.Or, ast.Or: ast.And, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip


def mutants(source: str) -> Iterator[tuple[int, str, str]]:
    """Line, change and new source of each mutant of a module."""
    tree = ast.parse(source)
    for index, node in enumerate(ast.walk(tree)):
        for change in _changes(node):
            new = copy.deepcopy(tree)
            place = next(other for i, other in enumerate(ast.walk(new)) if i == index)
            before = ast.unparse(place)
            change(place)
            yield getattr(node, "lineno", 0), f"{before}  ->  {ast.unparse(place)}", ast.unparse(new)


def _changes(node: ast.AST) -> list:
    if isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign) and type(node.op) in SWAPS:
        return [lambda it: setattr(it, "op", SWAPS[type(it.op)]())]
    if isinstance(node, ast.Compare) and type(node.ops[0]) in SWAPS:
        return [lambda it: it.ops.__setitem__(0, SWAPS[type(it.ops[0])]())]
    if isinstance(node, ast.If | ast.IfExp | ast.While):
        return [lambda it: setattr(it, "test", ast.Constant(False))]
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return [lambda it: setattr(it, "value", 0 if it.value else 1)]
    return []


def tests_of(file: Path) -> list[str]:
    """The test files of a module."""
    if {"engine", "run"} & set(file.parts):
        return [str(path.relative_to(ROOT)) for name in RUNS for path in ROOT.glob(f"tests/**/{name}.py")]
    module = f"palpate.{'.'.join(file.with_suffix('').parts).removeprefix('src.palpate.')}"
    return [str(path.relative_to(ROOT)) for path in sorted(ROOT.glob("tests/**/test_*.py"))
            if f"{module} import" in path.read_text(encoding="utf-8")]  # fmt: skip


def survives(tree: Path, tests: list[str]) -> bool:
    """Whether all tests pass in this tree. They run in a fork, which has the libraries but no module of this tree."""
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
        os._exit(bool(pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests])))
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):  # with what it started
        os.killpg(child, signal.SIGKILL)
    if not done:
        os.waitpid(child, 0)
    return bool(done) and status == 0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tests", action="append")
    given = parser.parse_args()
    wanted = [(file, *mutant) for file in given.files for mutant in mutants((ROOT / file).read_text(encoding="utf-8"))]
    random.Random(given.seed).shuffle(wanted)
    end, tried, left = time.monotonic() + 60 * given.minutes, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        left_out = shutil.ignore_patterns(".*", "__pycache__", "runs", "*.egg-info")
        shutil.copytree(ROOT, tree, symlinks=True, ignore=left_out)
        os.environ["NUMBA_CACHE_DIR"] = str(Path(folder) / "kernels")  # mutants must not evict the kernels of the user
        for file in given.files:
            if not (given.tests or tests_of(file)) or not survives(tree, given.tests or tests_of(file)):
                print(f"{file}: no tests, or they fail without a mutant", file=sys.stderr)
                return 2
        for file, line, change, source in wanted:
            if time.monotonic() > end:
                break
            original = (tree / file).read_text(encoding="utf-8")
            (tree / file).write_text(source, encoding="utf-8")
            tried += 1
            if survives(tree, given.tests or tests_of(file)):
                left += 1
                print(f"survived  {file}:{line}: {change}", flush=True)
            (tree / file).write_text(original, encoding="utf-8")
    print(f"{left} of {tried} mutants survived; {len(wanted)} are possible")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
