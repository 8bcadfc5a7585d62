"""On what the bits of kernels rest: IEEE 754 operations in the order of the source, and functions of this package."""

import ast
import pickle
import re
from pathlib import Path

import llvmlite.binding as llvm
import pytest
from expected_notes import UNTAKEN
from sources import nodes

import palpate
from palpate.compiler import kernel_cache, kernel_files
from palpate.compiler.target.replaced import REPLACED
from palpate.physics.errors import PalpateWarning

ROOT = Path(__file__).parents[2]
EXACT = {
    "abs", "ceil", "copysign", "e", "floor", "fabs", "fmod", "inf", "isfinite", "isinf", "isnan", "nan", "pi",
    "radians", "sqrt", "trunc",
}  # fmt: skip
"""Of the module math: constants, and functions of which IEEE 754 fixes all bits."""
NUMPY = {
    "exp", "exp2", "expm1", "log", "log1p", "log2", "log10", "sin", "cos", "tan", "arcsin", "arccos", "arctan",
    "arctan2", "sinh", "cosh", "tanh", "power", "hypot", "cbrt",
}  # fmt: skip
AS_MATH = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "power": "pow"}
C_LIBRARY = {
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "cos", "cosh", "erf", "erfc", "exp", "exp2",
    "expm1", "gamma", "hypot", "_hypot", "lgamma", "log", "log1p", "log2", "pow", "sin", "sincos", "sinh",
    "tan", "tanh", "tgamma",
}  # fmt: skip
"""Without log10, by which numba finds the number of digits for the text of an error."""
FLAGS = ("fast", "reassoc", "contract", "arcp", "afn", "nnan", "ninf", "nsz", "llvm.fmuladd")
"""Flags and functions of LLVM that permit other results."""
REORDERS = re.compile(rf"\b({'|'.join(map(re.escape, FLAGS))})\b")


def is_kernel(decorator):
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(called, ast.Name) and called.id in ("kernel", "ieee_kernel")


def test_kernels_call_only_functions_that_this_package_replaces():
    known = {re.sub(r"llvm\.|\.f64", "", name) for name in REPLACED} | EXACT
    for folder in ("src/palpate/compiler", "src/palpate/physics", "src/palpate/models", "src/palpate/engine", "nodes"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for function in nodes(path):
                if not isinstance(function, ast.FunctionDef) or not any(map(is_kernel, function.decorator_list)):
                    continue
                for node in ast.walk(function):
                    if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
                        continue
                    where = f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}"
                    assert node.value.id != "math" or node.attr in known, where
                    if node.value.id in ("np", "numpy") and node.attr in NUMPY:
                        assert AS_MATH.get(node.attr, node.attr) in known, where


def test_nodes_in_python_call_no_function_of_the_c_library_after_their_start():
    """`x ** y` is one as well, except for whole numbers."""
    for folder in ("sensor", "tactile", "device", "display"):
        for path in sorted((ROOT / "nodes" / folder).glob("*.py")):
            for function in nodes(path):
                emulated = getattr(function, "name", "") == "_press_bone"  # no replay computes it
                if (
                    emulated
                    or not isinstance(function, ast.FunctionDef)
                    or any(map(is_kernel, function.decorator_list))
                ):
                    continue
                for node in ast.walk(function):
                    where = f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"
                    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                        assert node.value.id != "math" or node.attr in EXACT | {"pi", "isfinite"}, where
                        assert node.value.id != "np" or node.attr not in NUMPY - EXACT, where
                    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
                        assert isinstance(node.right, ast.Constant) and isinstance(node.right.value, int), where


@pytest.fixture(scope="module")
def compiled():
    """(name, code of LLVM or None, functions of other libraries that it calls) of the cached kernels, at least of those
    of the kidney with its three bodies."""
    palpate.run("kidney", duration=0.01, record=False)
    for body in ("BeamBundle", "ReducedFE"):
        with pytest.warns(PalpateWarning, match=UNTAKEN):
            palpate.run("kidney", tissue=f"deformation.{body}", duration=0.01, record=False)
    found, seen = [], set()
    for path in sorted(kernel_cache.folder().glob("palpate.*.nbc")):
        try:
            _, ((_, kind, (content, more)), *_) = pickle.loads(kernel_files.read(path.parent, path.name))
        except (ImportError, AttributeError):  # of a class of another test
            continue
        if kind == "object":
            names = C_LIBRARY - {path.name.partition("-")[0].split(".")[-1]}  # that of the kernel itself
            found.append((path.name, None, {name for name in names if b"\0%s\0" % name.encode() in content}))
        for digest, code in more.items() if kind == "parts" else ():
            if digest not in seen:
                seen.add(digest)
                module = llvm.parse_bitcode(code)
                found.append((path.name, str(module), {f.name for f in module.functions if f.is_declaration}))
    assert len(found) > 150
    return found


def test_compiled_kernels_call_no_function_of_the_c_library(compiled):
    others = C_LIBRARY | {f"llvm.{name}.f64" for name in C_LIBRARY}
    for name, _, called in compiled:
        assert not called & others, name
    assert any("palpate.atan2" in called for _, _, called in compiled)  # so functions are recognized


def test_compiled_kernels_permit_no_other_order_of_operations(compiled):
    for name, code, _ in compiled:
        if code is not None and any(flag in code for flag in FLAGS):  # 20 times as fast as the expression
            assert not REORDERS.search(code), (name, REORDERS.search(code))
    assert any(code is not None and "llvm.fma.f64" in code for _, code, _ in compiled)
