"""Figures of the code base: files, lines, the largest folder, the longest signature, import cycles.

    python docs/studies/house.py [COMMIT...]

Without a commit it counts the working tree. Imports inside functions and imports for types do not count as cycles.
"""

from __future__ import annotations

import ast
import io
import statistics
import subprocess
import sys
import tarfile
from collections import Counter
from pathlib import Path, PurePosixPath

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[2]
SHIPPED = (
    "src", "messages", "nodes", "physics", "models", "drivers", "graphs", "engine", "launch", "records", "views",
    "studies", "gym", "cli", "registry", "public",
    "fe", "fit", "scan", "bench",  # of commits before decision 14
)  # fmt: skip
MANY = 12
"""Number of parameters above which a function is listed."""


def sources(commit: str | None) -> dict[PurePosixPath, str]:
    """Path from the root -> text of the Python files of a commit, or of the tracked files of the working tree."""
    if commit is None:
        tracked = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
        paths = [path for path in tracked.stdout.split() if (ROOT / path).is_file()]
        return {PurePosixPath(path): (ROOT / path).read_text(encoding="utf-8") for path in paths}
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        return {
            PurePosixPath(member.name): archive.extractfile(member).read().decode()  # type: ignore[union-attr]
            for member in archive
            if member.isfile() and member.name.endswith(".py")
        }


def parameters(tree: ast.AST) -> list[int]:
    """Number of parameters of each function."""
    return [
        len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]


def imported(tree: ast.Module, modules: dict[str, PurePosixPath]) -> set[PurePosixPath]:
    """Files that a file imports when it is loaded."""
    names: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
            names.add(node.module)
    return {modules[name] for name in names if name in modules}


def cycles(needs: dict[PurePosixPath, set[PurePosixPath]]) -> int:
    """Number of groups of files that import each other (strongly connected components, R. Tarjan 1972)."""
    index: dict[PurePosixPath, int] = {}
    low: dict[PurePosixPath, int] = {}
    stack: list[PurePosixPath] = []
    groups = 0

    def visit(file: PurePosixPath) -> None:
        nonlocal groups
        index[file] = low[file] = len(index)
        stack.append(file)
        for other in needs[file]:
            if other not in index:
                visit(other)
                low[file] = min(low[file], low[other])
            elif other in stack:
                low[file] = min(low[file], index[other])
        if low[file] == index[file]:
            group = []
            while not group or group[-1] != file:
                group.append(stack.pop())
            groups += len(group) > 1

    for file in needs:
        if file not in index:
            visit(file)
    return groups


def figures(commit: str | None) -> dict[str, object]:
    """Figure -> value of a commit, or of the working tree."""
    files = sources(commit)
    shipped = {path: text for path, text in files.items() if path.parts[0] in SHIPPED}
    trees = {path: ast.parse(text) for path, text in shipped.items()}
    modules = {
        ".".join(("palpate", *path.with_suffix("").parts)).removesuffix(".__init__"): path
        for path in shipped
    }  # fmt: skip
    # Without __init__ files: they collect names of their folder, so importing a sibling would appear as a cycle.
    needs = {
        path: {other for other in imported(tree, modules) if other.name != "__init__.py"}
        for path, tree in trees.items()
        if path.name != "__init__.py"
    }
    lengths = [text.count("\n") for text in shipped.values()]
    signatures = [count for tree in trees.values() for count in parameters(tree)]
    folders = Counter(path.parent for path in shipped if path.name != "__init__.py")
    tests = Counter(path.parent for path in files if path.parts[0] == "tests")
    fullest, most = folders.most_common(1)[0]
    fullest_tests, most_tests = tests.most_common(1)[0]
    return {
        "shipped files": len(shipped),
        "shipped lines": sum(lengths),
        "all lines": sum(text.count("\n") for text in files.values()),
        "median, longest file": f"{statistics.median(lengths):g}, {max(lengths)}",
        "folders": len(folders),
        "fullest folder": f"{most} ({fullest})",
        "fullest folder of tests": f"{most_tests} ({fullest_tests})",
        "most parameters": max(signatures),
        f"functions with more than {MANY}": sum(count > MANY for count in signatures),
        "import cycles": cycles(needs),
        "direct subclasses of built-in exceptions": sum(
            isinstance(node, ast.ClassDef)
            and node.name.endswith("Error")
            and any(isinstance(base, ast.Name) and base.id in vars(__builtins__) for base in node.bases)
            for tree in trees.values()
            for node in ast.walk(tree)
        ),
        "the name 'found'": sum(
            isinstance(node, ast.Name) and node.id == "found" for tree in trees.values() for node in ast.walk(tree)
        ),
        "# fmt: skip": sum(text.count("# fmt: skip") for text in shipped.values()),
    }


def main() -> None:
    columns = {commit or "working tree": figures(commit) for commit in (sys.argv[1:] or [None])}
    table = Table(box=None, header_style="bold")
    for title in ("", *columns):
        table.add_column(title)
    for name in next(iter(columns.values())):
        table.add_row(name, *(str(column[name]) for column in columns.values()))
    Console().print(table)


if __name__ == "__main__":
    main()
