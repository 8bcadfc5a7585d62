"""The functions of the C library that kernels call, on whose last bits recordings depend (docs/recording.md)."""

import ast
import hashlib
import math
import platform
import random
import re
import struct
from pathlib import Path

import pytest

from palpate.compiler.arithmetic import pinnable

ROOT = Path(__file__).parents[2]
PAGE = " ".join((ROOT / "docs" / "recording.md").read_text(encoding="utf-8").split())
EXACT = {
    "abs", "ceil", "copysign", "floor", "fabs", "fmod", "inf", "isfinite", "isinf", "isnan", "nan", "pi", "radians",
    "sqrt", "trunc", "e",
}  # fmt: skip
"""Of the module math: constants, and functions of which IEEE 754 fixes all bits."""
NUMPY = {
    "exp", "expm1", "log", "log1p", "log2", "log10", "sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2",
    "sinh", "cosh", "tanh", "power", "hypot", "cbrt",
}  # fmt: skip
AS_MATH = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "arctan2": "atan2", "power": "pow"}
DIGESTS = {
    "exp": (1, 50.0), "expm1": (1, 30.0), "log": (1, 0.0), "log1p": (1, 0.0), "sin": (1, 100.0), "cos": (1, 100.0),
    "acos": (1, 1.0), "atan2": (2, 5.0), "cbrt": (1, 9.0),
}  # fmt: skip
"""Number of arguments, and half of their range; 0: positive ones from 1e-6 to 1e6."""
BITS = "e63a2501fa01f1c5d0d3667effcc013ee0d928b091536abb5ff0aeae82ea8f0e"
"""Of the results of glibc 2.36 on x86-64 with FMA."""


def is_kernel(decorator):
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return isinstance(called, ast.Name) and called.id == "kernel"


def called_by_kernels():
    """Function -> a kernel that calls it."""
    found = {}
    for folder in ("src/palpate/compiler", "src/palpate/physics", "src/palpate/models", "nodes"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(function, ast.FunctionDef) or not any(map(is_kernel, function.decorator_list)):
                    continue
                for node in ast.walk(function):
                    if not (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
                        continue
                    of_math = node.value.id == "math" and node.attr not in EXACT
                    if of_math or (node.value.id in ("np", "numpy") and node.attr in NUMPY):
                        found[AS_MATH.get(node.attr, node.attr)] = f"{path.relative_to(ROOT)}: {function.name}"
    return found


def test_the_page_lists_the_functions_that_kernels_call():
    listed = re.search(r"Kernels call these functions of it: ([^.]+)\.", PAGE)
    assert listed is not None
    assert set(re.findall(r"`(\w+)`", listed[1])) == called_by_kernels().keys(), called_by_kernels()


def bits():
    rng, content = random.Random(68), hashlib.sha256()
    for name, (count, half) in DIGESTS.items():
        for _ in range(3000):
            given = [rng.uniform(-half, half) if half else 10.0 ** rng.uniform(-6.0, 6.0) for _ in range(count)]
            content.update(struct.pack("<d", getattr(math, name)(*given)))
    return content.hexdigest()


@pytest.mark.skipif(
    not pinnable() or platform.libc_ver()[0] != "glibc", reason="another C library or processor: other last bits"
)
def test_the_bits_of_this_c_library_are_those_of_the_goldens():
    assert tuple(map(int, platform.libc_ver()[1].split("."))) >= (2, 28)
    assert bits() == BITS
