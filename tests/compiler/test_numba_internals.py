"""The names of numba that it does not promise to keep: each is listed with its reason, exists, and is used."""

import ast
import importlib
import inspect
from pathlib import Path

import pytest

from palpate.compiler import code_cache
from palpate.compiler.content import closure, extensions
from palpate.compiler.numba_internals import MEMBERS, OTHERS, OVERRIDDEN, PREFIX, USED
from palpate.compiler.target import code_library, dispatcher, elsewhere, passes, target, translation

ROOT = Path(__file__).parents[2]
ROOMS = ["src/palpate", "messages", "nodes", "launch"]
FILES = (
    "compiler/target/dispatcher.py", "compiler/target/target.py", "compiler/target/code_library.py",
    "compiler/code_cache.py", "compiler/target/passes.py",
    "compiler/target/elsewhere.py", "compiler/target/translation.py",
    "compiler/content/closure.py", "compiler/content/extensions.py", "compiler/generators/memory.py",
    "compiler/generators/records.py", "compiler/generators/in_record.py", "compiler/generators/dot.py",
)  # fmt: skip
"""Files that use private members."""
PUBLIC = ("numba.extending", "numba.core.event", "numba.types")
OURS = (
    target._PinnedCodegen, target._Context, target._CallConv, target._Typing, target._Function, target._Target,
    target._Processor, target.Pinned, target._Flags, dispatcher.CachedFunction, dispatcher.KernelDispatcher,
    code_library.Library, code_library.Codegen, elsewhere.Elsewhere, elsewhere.ElsewhereLibrary,
    translation.Translation, passes.KernelCompiler, passes.Passes, passes.Canonical, passes.Closures,
    passes.EarlyRewrites, passes.Assignments, passes.Merges, passes.LateRewrites,
)  # fmt: skip
"""Classes with a base in numba."""
CONTENT = (
    code_cache.CodeCache, code_cache.Names, translation._Folder, closure._Reader, closure.Description,
    extensions.Extensions,
)  # fmt: skip
"""Other classes of these files, with private members."""


def trees():
    for room in ROOMS:
        for file in (ROOT / room).rglob("*.py"):
            if "numba" in (text := file.read_text(encoding="utf-8")) and file.name != "numba_internals.py":
                yield ast.parse(text)


def found(name):
    """The object of a dotted name."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value = importlib.import_module(".".join(parts[:length]))
        except ImportError:
            continue
        for part in parts[length:]:
            value = getattr(value, part)
        return value
    raise ImportError(name)


def imported():
    """Names that the sources import from below numba, or reach from it with dots."""
    names = set()
    for tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("numba"):
                names |= {f"{node.module}.{one.name}" for one in node.names}
            elif isinstance(node, ast.Attribute) and ast.unparse(node).startswith(f"{PREFIX}"):
                names.add(ast.unparse(node))
    return {name for name in names if name.count(".") > 1 and not name.startswith(PUBLIC) and name not in PUBLIC}


def test_every_import_from_numba_is_listed_and_every_listed_name_is_imported():
    assert imported() == {PREFIX + name for name in USED} | set(OTHERS)


@pytest.mark.parametrize("name", [*(PREFIX + name for name in (*USED, *OVERRIDDEN)), *OTHERS])
def test_the_installed_numba_has_the_name(name):
    found(name)


def body(cls):
    """The syntax tree of a class."""
    return ast.parse(inspect.getsource(cls)).body[0]


def declared(cls):
    """Names that a class declares in its source."""
    for node in body(cls).body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        for each in [*getattr(node, "targets", ()), getattr(node, "target", None)]:
            if isinstance(each, ast.Name):
                yield each.id


def overridden():
    """Members of numba's classes that the classes of palpate replace, with the class of numba that they derive from."""
    for ours in OURS:
        base = next(cls for cls in ours.__mro__ if cls.__module__.startswith("numba"))
        yield from ((base, name) for name in declared(ours) if hasattr(base, name) and name != "__init__")


def test_every_replaced_member_is_listed():
    listed = {(found(PREFIX + name.rpartition(".")[0]), name.rpartition(".")[2]) for name in OVERRIDDEN}
    assert set(overridden()) == listed


def test_every_private_member_is_listed_and_used():
    used = set()
    for file in FILES:
        tree = ast.parse((ROOT / "src" / "palpate" / file).read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr.startswith("_") and not node.attr.startswith("__"):
                used.add(node.attr)
    declared_here = {name for cls in OURS for name in declared(cls)}
    set_here = {
        node.attr for cls in (*OURS, *CONTENT) for node in ast.walk(body(cls))
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store)
    }  # fmt: skip
    functions = {name for cls in (*CONTENT, dispatcher.KernelDispatcher, code_library.Library) for name in vars(cls)}
    assert used - (declared_here | set_here | functions) <= set(MEMBERS)
    assert set(MEMBERS) <= used
