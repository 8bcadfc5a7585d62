"""Seeded changes of the shipped kernels, for the names of their files, and who calls whom by the text of the sources.

`callers` does not use the bytecode, from which the names are made: it reads the syntax tree of each function.
"""

import ast
import gc
import importlib
import pkgutil
from collections import defaultdict
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import get_type_hints

import numba
import numpy as np
from numba.core.extending import _Intrinsic
from numba.extending import is_jitted

import palpate.compiler
import palpate.engine
import palpate.launch.run.hop
import palpate.models.fe
import palpate.nodes
import palpate.physics
from palpate.compiler.kernel import CompiledKernel, replacement
from palpate.compiler.target.deferred import made

ROOMS = palpate.compiler, palpate.physics, palpate.models.fe, palpate.nodes, palpate.engine, palpate.launch.run.hop
NUMPY = {"arctan2": "atan2", "arccos": "acos", "arcsin": "asin", "power": "pow"}


@cache
def kernels():
    """All shipped kernels by their full names, which have a number if a factory makes several."""
    for room in ROOMS:
        for info in pkgutil.walk_packages(room.__path__, f"{room.__name__}."):
            importlib.import_module(info.name)
    found = {}
    gc.unfreeze()  # objects that an earlier test has frozen are not listed
    for each in gc.get_objects():
        if type(each) is CompiledKernel and each.__module__.startswith(tuple(room.__name__ for room in ROOMS)):
            name = f"{each.__module__}.{each.__qualname__}"
            found[f"{name} {sum(name == one.partition(' ')[0] for one in found)}"] = each.made
    return found


def function_of(thing):
    """The Python function of a kernel, an intrinsic or a function; None: of something else."""
    thing = made(thing)
    if is_jitted(thing):
        return thing.py_func
    if isinstance(thing, _Intrinsic):
        return thing._defn
    return thing if isinstance(thing, FunctionType) else None


@cache
def tree_of(file):
    return ast.parse(Path(file).read_text(encoding="utf-8"))


@cache
def definitions(file):
    """The syntax trees of all functions of a file, by name and first line."""
    found = {}
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.FunctionDef):
            found[node.name, min([node.lineno, *(each.lineno for each in node.decorator_list)])] = node
    return found


def definition(function):
    """The syntax tree of a function."""
    code = function.__code__
    return definitions(code.co_filename).get((code.co_name, code.co_firstlineno))


def global_names(function):
    """Global names in the body of a function."""
    node, code = definition(function), function.__code__
    names = {each.id for one in (node.body if node else ()) for each in ast.walk(one) if isinstance(each, ast.Name)}
    return names - {*code.co_varnames, *code.co_cellvars, *code.co_freevars}


def used(function):
    """Values that a function names: globals, attributes of modules, and variables of the function around it."""
    node = definition(function)
    local = {*function.__code__.co_varnames, *function.__code__.co_cellvars}
    inside = dict(zip(function.__code__.co_freevars, function.__closure__ or (), strict=True))
    found = []
    for each in ast.walk(ast.Module(node.body, []) if node else ast.Module([], [])):
        if isinstance(each, ast.Attribute):
            path = ast.unparse(each).split(".")
            if path[0] in local:
                continue
            value = function.__globals__.get(path[0])
            for name in path[1:]:
                value = getattr(value, name, None) if isinstance(value, ModuleType) else None
            found.append(value)
        elif isinstance(each, ast.Name) and each.id not in local:
            found.append(inside[each.id].cell_contents if each.id in inside else function.__globals__.get(each.id))
        elif isinstance(each, ast.BinOp | ast.AugAssign) and isinstance(each.op, ast.Pow):
            right = each.right if isinstance(each, ast.BinOp) else each.value
            names = [one for one in ast.walk(each) if isinstance(one, ast.Name | ast.Call | ast.Subscript)]
            if names and not (isinstance(right, ast.Constant) and isinstance(right.value, int)):
                found.append(replacement("pow"))
    for value in [*found]:
        name = getattr(value, "__name__", "")
        if getattr(value, "__module__", None) == "math" or isinstance(value, np.ufunc):
            found.append(replacement(NUMPY.get(name, name)))
    return found


@cache
def callers():
    """For each function, by identity, the names of the kernels that depend on it, itself included."""
    direct, functions = {}, {}
    todo = [function_of(each) for each in kernels().values()]
    while todo:
        function = todo.pop()
        if id(function) in direct:
            continue
        functions[id(function)] = function
        called = [function_of(each) for each in used(function)]
        called = [each for each in called if each is not None and each.__module__.startswith("palpate")]
        direct[id(function)] = {id(each) for each in called}
        todo += called
    above = defaultdict(set)
    for name, kernel in kernels().items():
        reached, todo = set(), [id(kernel.py_func)]
        while todo:
            if (each := todo.pop()) not in reached:
                reached.add(each)
                todo += direct[each]
        for each in reached:
            above[each].add(name)
    return above


def unpacked(thing):
    """The NamedTuples that an intrinsic of `records.unpacking` makes, outer ones first; none: it is another thing."""
    thing = made(thing)
    function = thing._defn if isinstance(thing, _Intrinsic) else None
    if function is None or function.__qualname__ != "unpacking.<locals>.unpack":
        return []
    found = [cell.cell_contents for cell in function.__closure__]
    for kind in found:
        found += [each for each in get_type_hints(kind, include_extras=True).values() if hasattr(each, "_fields")]
    return found


@cache
def intrinsics():
    """All intrinsics of `records.unpacking` that kernels use, by identity."""
    found = {id(each): each for kernel in kernels().values() for each in used(kernel.py_func)}
    return {name: each for name, each in found.items() if unpacked(each)}


def constants(node):
    """Numbers in the body of a function, without its docstring, its annotations and exponents."""
    inner = {
        id(each) for one in ast.walk(node) for field in ("annotation", "returns") if getattr(one, field, None)
        for each in ast.walk(getattr(one, field))
    }  # fmt: skip
    inner |= {id(one.right) for one in ast.walk(node) if isinstance(one, ast.BinOp) and isinstance(one.op, ast.Pow)}
    return [
        each for one in node.body for each in ast.walk(one)
        if isinstance(each, ast.Constant) and type(each.value) in (int, float) and id(each) not in inner
    ]  # fmt: skip


def other(value):
    """Another value of the same kind; None: no such value."""
    if isinstance(value, bool | np.bool_):
        return not value
    if isinstance(value, int | float):
        return value + max(1, abs(value)) if abs(value) < np.inf else 0.5
    if isinstance(value, np.dtype) and value.names:
        fields = [(name, value[name]) for name in value.names]
        return np.dtype((value.type, np.dtype([*fields, ("another", "<f8")], align=True)))
    if isinstance(value, np.ndarray) and value.dtype.kind in "if":
        return value + 1
    if isinstance(value, tuple) and value and type(value) is tuple and other(value[0]) is not None:
        return (other(value[0]), *value[1:])
    if isinstance(value, numba.types.Record):
        fields = [(name, {"type": value.typeof(name), "offset": value.offset(name)}) for name in value.fields]
        return numba.types.Record(fields, value.size + 8, value.aligned)
    return None


def code_of(code, name, line=None):
    """The code object of a function inside the code of a module."""
    for each in code.co_consts:
        if isinstance(each, CodeType):
            if each.co_qualname == name and line in (None, each.co_firstlineno):
                return each
            if (found := code_of(each, name, line)) is not None:
                return found
    return None


@contextmanager
def put(thing, name, value):
    """Set an attribute, an item or the content of a cell for the time of the block."""
    write = thing.__setitem__ if isinstance(thing, dict) else lambda name, value: setattr(thing, name, value)
    before = thing[name] if isinstance(thing, dict) else getattr(thing, name)
    write(name, value)
    try:
        yield
    finally:
        write(name, before)


def changed_constant(function, draw):
    """The code of a function with another number; None: it has none."""
    node = definition(function)
    numbers = constants(node) if node else []
    if not numbers:
        return None
    one = draw.choice(numbers)
    before, one.value = one.value, other(one.value)
    module = compile(tree_of(function.__code__.co_filename), function.__code__.co_filename, "exec")
    one.value = before
    return code_of(module, function.__code__.co_qualname, function.__code__.co_firstlineno)


def changes_of_text(text, draw):
    """A text of a module with other lines, comments and docstrings, and members of its classes that are no kernels."""
    lines = text.splitlines()
    ends = {node.end_lineno for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt)}
    starts = {node.lineno: node.col_offset for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt)}
    made = []
    for number, line in enumerate(lines, 1):
        if number in starts and number - 1 in {0, *ends} and draw.random() < 0.3 and not line.strip().startswith("@"):
            made += ["", f"{' ' * starts[number]}# {draw.random()}"]
        made.append(line)
    tree = ast.parse("\n".join(made))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
            first = node.body[0]
            documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
            if documented and draw.random() < 0.5 and len(node.body) > 1:
                node.body.pop(0)
            elif documented:
                first.value.value += " More."
            elif not isinstance(node, ast.Module):
                node.body.insert(0, ast.Expr(ast.Constant("A docstring.")))
        if isinstance(node, ast.ClassDef) and not any("NamedTuple" in ast.unparse(base) for base in node.bases):
            node.body.append(ast.parse(f"another_member = {draw.random()}").body[0])
    return ast.fix_missing_locations(tree)
