"""Which test files cover a module, found by what they import."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parents[2]
TOPS = ("messages", "nodes", "launch", "src/palpate")
RUNS = ("test_real_clock", "test_run", "test_bad_runs", "test_start_barrier", "test_wire", "test_zmtp", "test_replay")
MOST = 12  # test files of a module


@functools.cache
def sources() -> list[Path]:
    """All modules, from the repository's root, without the links between folders."""
    found = (path.relative_to(ROOT) for top in TOPS for path in sorted((ROOT / top).rglob("*.py")))
    return [path for path in found if not any((ROOT / part).is_symlink() for part in path.parents)]


def module_of(file: Path) -> str:
    parts = file.with_suffix("").parts
    parts = parts[2:] if parts[:2] == ("src", "palpate") else parts
    return ".".join(("palpate", *(part for part in parts if part != "__init__")))


@functools.cache
def imports(file: Path) -> frozenset[str]:
    """Modules and members of palpate that a file imports, also inside functions."""
    found = set()
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("palpate"):
            found |= {node.module or "", *(f"{node.module}.{name.name}" for name in node.names)}
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names if name.name.startswith("palpate")}
    return frozenset(found)


@functools.cache
def tests_of(file: Path) -> list[str]:
    """The test files that import a module, the most special ones first, then those of the modules that import it; else
    those of its folder, which reach it by its name, and of the modules that import it, those that are both first; of
    `engine` and `launch/run` also those of runs and replays."""
    tests = [path.relative_to(ROOT) for path in ROOT.glob("tests/**/test_*.py")]
    near, seen, found = {module_of(file)}, set(), []
    while near and not (found := [test for test in tests if near & imports(test)]):
        seen |= near
        near = {module_of(other) for other in sources() if near & imports(other)} - seen
    neighbours = in_folder_of(file) if seen else []
    both, found = {*neighbours} & {*found}, list({*neighbours, *found})

    def rank(test: Path) -> tuple[object, ...]:
        return file.stem not in test.stem, test not in both, test not in neighbours, len(imports(test)), test

    found.sort(key=rank)
    if not seen:
        near = {module_of(other) for other in sources() if near & imports(other)}
        found += sorted({test for test in tests if near & imports(test)} - {*found}, key=rank)
    runs = [test for test in tests if test.stem in RUNS] if {"engine", "run"} & set(file.parts) else []
    return [str(test) for test in dict.fromkeys([*found[:MOST], *sorted(runs)])]


def in_folder_of(file: Path) -> list[Path]:
    """The test files of the folder of a module that is found by its place."""
    place = Path(*module_of(file).split(".")[1:])
    folder = next(folder for up in place.parents if (folder := ROOT / "tests" / up).is_dir())
    return [path.relative_to(ROOT) for path in folder.glob("test_*.py")]
