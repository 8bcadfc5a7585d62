"""A kernel of a user is compiled again after each change of what it depends on, and not after others.

Each case is a module with a kernel `run`; one text of it is replaced by another. The kernel's value must be that of the
new text, and that of the old text comes from the cache.
"""

import ast
import ctypes
import importlib
import random
import subprocess
import sys
import warnings

import kernel_changes as shipped
import numba
import numpy as np
import pytest
from compiler_copy import copy_compiler

from palpate.compiler.kernel import CompiledKernel, kernel

HEAD = """
import enum, functools, math
from typing import Annotated, NamedTuple
import numba, numpy as np
from numba import types
from numba.extending import intrinsic, overload, overload_method, register_jitable
from palpate.compiler.kernel import ieee_kernel, kernel
"""

INTRINSIC = """
def scale(builder, x):
    factor = 2.0
    return builder.fmul(x, x.type(factor))

@intrinsic
def scaled(typing, x):
    def generate(context, builder, signature, arguments):
        return scale(builder, builder.fadd(arguments[0], arguments[0].type(1.0)))
    return types.float64(types.float64), generate

@kernel
def run(x):
    return scaled(x)
"""

CASES = {
    "a number": ("K = 2.0", "K = 3.0", "@kernel\ndef run(x):\n    return K * x\n"),
    "the type of a number": ("K = 1", "K = 1.0", "@kernel\ndef run(x):\n    return math.copysign(x, -K * 0)\n"),
    "an array": ("A = np.array([2.0])", "A = np.array([5.0])", "@kernel\ndef run(x):\n    return A[0] * x\n"),
    "the code": ("    return x + 1.0", "    return x + 2.0", "@kernel\ndef run(x):\n    return x + 1.0\n"),
    "a callee": ("2.0 * x", "3.0 * x", """
@kernel
def inner(x):
    return 2.0 * x
@kernel
def run(x):
    return inner(x)
"""),
    "a constant of the callee of a callee": ("K = 2.0", "K = 3.0", """
@kernel
def deep(x):
    return K * x
@kernel
def inner(x):
    return deep(x)
@kernel
def run(x):
    return inner(x)
"""),
    "an option of a callee": ("@kernel\ndef inner", "@ieee_kernel\ndef inner", """
@kernel
def inner(x):
    return 1.0 / x
@kernel
def run(x):
    return inner(x - 3.0)
"""),
    "a member of an enumeration": ("B = 2", "B = 3", """
class Kind(enum.IntEnum):
    A = 1
    B = 2
@kernel
def run(x):
    return x + (1.0 if int(x) == Kind.B else 0.0)
"""),
    "an attribute of a class": ("K = 2.0", "K = 3.0", """
class Law:
    K = 2.0
def made(law):
    k = law.K
    @kernel
    def run(x):
        return k * x
    return run
run = made(Law)
"""),
    "fields of a NamedTuple": ("b: float\n    a: float", "a: float\n    b: float", """
class Pair(NamedTuple):
    b: float
    a: float
@kernel
def run(x):
    return Pair(x, 2.0 * x).a
"""),
    "a kernel around it": ("made(one)", "made(two)", """
@kernel
def one(x):
    return x
@kernel
def two(x):
    return x + x
def made(f):
    @kernel
    def run(x):
        return f(x)
    return run
run = made(one)
"""),
    "a default": ("k=2.0", "k=3.0", """
@kernel
def inner(x, k=2.0):
    return k * x
@kernel
def run(x):
    return inner(x)
"""),
    "an intrinsic": ("type(1.0)", "type(2.0)", INTRINSIC),
    "a helper of an intrinsic": ("factor = 2.0", "factor = 3.0", INTRINSIC),
    "an implementation of a function": ("K = 2.0", "K = 3.0", """
def twice(x):
    pass
@overload(twice)
def _twice(x):
    def code(x):
        return K * x
    return code
@kernel
def run(x):
    return twice(x)
"""),
    "an implementation of a method": ("2.0 * a[0]", "3.0 * a[0]", """
@overload_method(types.Array, "NAME")
def _of(a):
    return lambda a: 2.0 * a[0]
@kernel
def run(x):
    return np.full(1, x).NAME()
"""),
    "a function that numba compiles with its caller": ("2.0 * x", "3.0 * x", """
@register_jitable
def twice(x):
    return 2.0 * x
@kernel
def run(x):
    return twice(x)
"""),
    "a layout": ("('a', '<f8'), ('b', '<f8')", "('b', '<f8'), ('a', '<f8')", """
KIND = np.dtype([('a', '<f8'), ('b', '<f8')])
@kernel
def inner(r):
    return r.a
def run(x):
    return inner(np.array([(x, 7.0)], KIND)[0])
"""),
}  # fmt: skip
"""For each case the text that changes, its replacement, and the module."""


@pytest.fixture
def load(tmp_path, monkeypatch):
    """Loads a module of this text, with an empty cache of this test."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def load(text):
        sys.modules.pop("changing", None)
        (tmp_path / "changing.py").write_text(HEAD + text)
        importlib.invalidate_caches()
        return importlib.import_module("changing")

    yield load
    sys.modules.pop("changing", None)


def hits(module):
    kernels = [each for each in vars(module).values() if isinstance(each, CompiledKernel)]
    return sum(sum(each.stats.cache_hits.values()) for each in kernels)


def value(module):
    try:
        return module.run(3.0)
    except ZeroDivisionError:
        return "raised"


@pytest.mark.parametrize("case", CASES)
def test_a_change_is_never_missed(load, case):
    old, new, text = CASES[case]
    text = text.replace("NAME", f"method_{random.randrange(10**9)}")  # implementations remain in numba
    if old not in text:
        text = f"{old}\n{text}"
    assert text.count(old) == 1
    first = value(load(text))
    assert value(load(text.replace(old, new))) != first
    again = load(text.replace("\nclass ", "\n\n\n# a comment\nclass ").replace("\n@", "\n\n# a comment\n@"))
    if "NAME" not in CASES[case][2]:  # this process has several implementations of the method
        assert (value(again), hits(again)) == (first, 1)


def test_a_value_that_changes_in_the_process_counts(load):
    module = load("K = np.array([2.0])\n@kernel\ndef run(x):\n    return K[0] * x\n")
    assert module.run(3.0) == 6.0
    module.K[0] = 5.0
    assert module.run(3) == 15.0  # other types: compiled now, and stored under the name of the present value
    again = load("K = np.array([2.0])\n@kernel\ndef run(x):\n    return K[0] * x\n")
    assert again.run(3) == 6.0 and hits(again) == 0


def test_a_kernel_does_not_depend_on_the_function_for_which_it_is_compiled(load):
    """numba passes `fastmath` and others to what it compiles for a function."""
    text = "@kernel\ndef total(x):\n    s = 0.0\n    for i in range(len(x)):\n        s += x[i]\n    return s\n"
    text += "@kernel\ndef run(x):\n    return total(x)\n@numba.njit(fastmath=True)\ndef fast(x):\n    return total(x)\n"
    x = np.random.default_rng(1).normal(size=1000)
    module = load(text)
    module.fast(x)
    assert module.run(x) == sum(x.tolist())


def test_a_kernel_that_refers_to_an_object_of_the_process_is_not_cached(load):
    pointer = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(lambda x: 2.0 * x)

    def run(x):
        return pointer(x)

    made = kernel(run)
    with pytest.warns(numba.NumbaWarning, match="run is compiled in each process"):
        assert made(3.0) == 6.0
    assert made.file((numba.float64,)) is None


def test_a_kernel_of_a_notebook_without_a_file_is_cached(load):
    namespace = {"kernel": kernel, "__name__": "__main__"}
    for count in (0, 1):
        exec("@kernel\ndef of_a_cell(x):\n    return x + 0.25\n", namespace)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert namespace["of_a_cell"](1.0) == 1.25
        assert sum(namespace["of_a_cell"].stats.cache_hits.values()) == count


SHIPPED = """
import math, sys
import numpy as np
from palpate.compiler import angles, dot, doubles, exact, exponentials
from palpate.compiler.kernel import ieee_kernel

@ieee_kernel
def values(x, out):
    for i in range(len(x)):
        v = x[i]
        out[i, 0], out[i, 1] = doubles.two_product(v, 1.1 + v)
        out[i, 2] = doubles.scaled(0.5 + v, 1005) + dot.dot((v, 1.0, 2.0), (3.0, v, 0.1))
        out[i, 3] = exact.hypot(v, 0.3, 2.0) + exact.row_times(x[:9], x[1:10]) + exact.sum_of_squares(x)
        if MORE:
            out[i, 4], out[i, 5], out[i, 6] = math.exp(v), math.log(v), v**1.3
            out[i, 7], out[i, 8], out[i, 9] = math.sin(40.0 * v), math.cos(v), math.atan2(v, 0.7)
            out[i, 10], out[i, 11], out[i, 12] = math.acos(0.3 * v), math.asin(0.2 * v), math.hypot(v, 2.5)
            out[i, 13], out[i, 14], out[i, 15] = math.expm1(v), math.log1p(v), math.log2(v)

out = np.zeros((300, 16))
values(np.linspace(0.001, 3.0, 300), out)
print(out.tobytes().hex())
"""


def mutated(text, draw):
    """The text with another number in the code of one of its kernels."""
    tree = ast.parse(text)
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.decorator_list]
    numbers = [number for each in functions for number in shipped.constants(each)]
    number = draw.choice(numbers)
    line = text.splitlines()[number.lineno - 1].encode()
    new = repr(shipped.other(number.value)).encode()
    lines = text.splitlines()
    lines[number.lineno - 1] = (line[: number.col_offset] + new + line[number.end_col_offset :]).decode()
    return "\n".join(lines) + "\n"


def bytes_of_changes(folder, files, count, more, seed=86):
    """Compute with shipped kernels after each of `count` changes of their files, with one cache for all states, and
    with an empty one."""
    draw = random.Random(seed)
    compiler = copy_compiler(folder)
    (folder / "values.py").write_text(SHIPPED.replace("MORE", str(more)))

    def run(cache):
        words = [sys.executable, str(folder / "values.py")]
        environment = {
            "PYTHONPATH": str(folder),
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": str(folder / cache),
        }
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=600)
        return done.stdout or done.stderr.strip().splitlines()[-1]

    found = [run("shared")]
    for number in range(count):
        file = compiler / draw.choice(files)
        text = file.read_text()
        file.write_text(mutated(text, draw))
        found.append(run("shared"))
        assert found[-1] == run(f"empty{number}"), file
        file.write_text(text)
    assert run("shared") == found[0]
    return len(set(found)) - 1


def test_changes_of_shipped_kernels_give_the_bytes_of_an_empty_cache(tmp_path):
    assert bytes_of_changes(tmp_path, ["doubles.py", "exact.py"], 2, more=False, seed=5) > 0


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_many_changes_of_shipped_kernels_give_the_bytes_of_an_empty_cache(tmp_path):
    files = ["doubles.py", "exact.py", "dot.py", "exponentials.py", "angles.py"]
    assert bytes_of_changes(tmp_path, files, 10, more=True) > 4
