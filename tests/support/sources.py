"""The sources as trees, each parsed once per process for all checks that read them."""

import ast
import gc
from functools import cache
from pathlib import Path


def tree_of(path: Path) -> ast.Module:
    """The tree of a file, which tests must not change."""
    return _tree(path.resolve())


def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file, those farther out first."""
    return _nodes(path.resolve())


@cache
def _tree(path: Path) -> ast.Module:
    """Garbage collection, which would visit all trees again and again, ignores them."""
    collects = gc.isenabled()
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"))
    finally:
        gc.freeze()
        if collects:
            gc.enable()


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(_tree(path)))
