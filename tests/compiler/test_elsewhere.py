"""Kernels for another machine: the file has the name that a process there looks for, and the code of its processor."""

import pickle
import platform
import re
import struct
import subprocess
import sys

import llvmlite.binding as llvm
import numpy as np
import pytest
from numba import types

from palpate.compiler import kernel_cache, kernel_files
from palpate.compiler.arithmetic import kernel_processor, pinnable
from palpate.compiler.code_cache import Names
from palpate.compiler.doubles import fused
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.target import target
from palpate.compiler.target.elsewhere import Elsewhere
from palpate.compiler.target.processors import MACHINES, ProcessorError, named
from palpate.compiler.target.translation import Translation

ARRAYS = (types.Array(types.float64, 1, "C"),) * 2
NUMBERS = (types.float64,) * 3
ARM64, X86_64 = 183, 62  # machines of ELF
FUSED = re.compile(r"\bfn?m(add|sub|la|ls)\b")
"""Instructions of ARM that multiply and add with one rounding."""
KNOWN = re.compile(r"_ZN08NumbaEnv\S*|NRT_\w+|Py\w+|_Py\w+|numba_\w+|memset|memcpy|bzero|")
"""Names that kernels import: numba's environments and functions, Python's, and those by which LLVM copies."""


@ieee_kernel
def line(a, x, y):
    return a * x + y


@ieee_kernel
def line_at_once(a, x, y):
    return fused(a, x, y)


@kernel
def inner_product(a, b):
    total = 0.0
    for i in range(len(a)):
        total = line(a[i], b[i], total)
    return total


@kernel
def distance(a, b):
    total = np.zeros(3)
    for i in range(3):
        total[i] = (a[i] - b[i]) ** 2
    return np.exp(-np.sqrt(total.sum()))


class Object:
    """An ELF object of 64 bits: its machine, and the content of each section by its name.

    defined, wanted  names of its functions and data, and of those that it imports
    """

    def __init__(self, data):
        assert data[:6] == b"\x7fELF\x02\x01"
        self.machine = struct.unpack_from("<H", data, 18)[0]
        (at,), (size, count, texts) = struct.unpack_from("<Q", data, 40), struct.unpack_from("<3H", data, 58)
        heads = [struct.unpack_from("<2I4Q2I2Q", data, at + size * i) for i in range(count)]
        bodies = [b"" if head[1] == 8 else data[head[4] : head[4] + head[5]] for head in heads]
        self.sections = {text(bodies[texts], head[0]): body for head, body in zip(heads, bodies, strict=True)}
        table = self.sections[".symtab"]
        symbols = [struct.unpack_from("<IBBHQQ", table, at) for at in range(0, len(table), 24)]
        names = [(text(self.sections[".strtab"], one[0]), one[3]) for one in symbols]
        self.defined = {name for name, section in names if section}
        self.wanted = {name for name, section in names if not section}


def text(data, at):
    return data[at : data.index(b"\0", at)].decode()


def translated(function, given, machine, folder):
    """Name, kind and code of the file of a kernel for a machine."""
    folder.mkdir()
    Translation(function, Elsewhere(named(machine)), folder).write(given)
    [file] = folder.iterdir()
    found, ((_, kind, (content, more)), *_) = pickle.loads(kernel_files.read(folder, file.name))
    assert found == (given, None)
    return file.name, kind, content, more


@pytest.mark.skipif(
    platform.machine() not in MACHINES or not kernel_processor(), reason="another machine, or PALPATE_NATIVE"
)
def test_the_code_for_this_machine_is_the_code_that_this_process_compiles(tmp_path):
    inner_product.entry.compile(ARRAYS)
    name, kind, content, _ = translated(inner_product.entry, ARRAYS, platform.machine(), tmp_path / "here")
    _, ((_, _, (native, _)), *_) = pickle.loads(kernel_files.read(kernel_cache.folder(), name))
    assert kind == "object" and Object(native).sections[".text"] == Object(content).sections[".text"]


@pytest.fixture
def forgotten():
    """What this process knows about its processor is determined again, within and after the test."""
    pinnable.cache_clear()
    yield
    pinnable.cache_clear()


@pytest.mark.parametrize("function", [inner_product.made, inner_product.entry, inner_product.bare, distance.entry])
def test_the_name_is_that_which_a_process_on_the_other_machine_looks_for(function, tmp_path, monkeypatch, forgotten):
    """As there, the name follows from the machine and LLVM's name of it."""
    name, *_ = translated(function, ARRAYS, "aarch64", tmp_path / "there")
    here = set(Names(function, (ARRAYS, None), target.PINNED.target_context.codegen()))
    same = target.PINNED.target_context.codegen().magic_tuple() == Elsewhere(named("aarch64")).magic_tuple()
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    monkeypatch.setattr(llvm, "get_process_triple", lambda: "aarch64-unknown-linux-gnu")
    pinnable.cache_clear()
    there = set(Names(function, (ARRAYS, None), target._PinnedCodegen("there")))
    assert name in there and (here == there) == same
    monkeypatch.setenv("PALPATE_NATIVE", "1")
    monkeypatch.setattr(llvm, "get_host_cpu_name", lambda: "neoverse-n1")
    assert name not in set(Names(function, (ARRAYS, None), target._PinnedCodegen("native")))


@pytest.mark.parametrize("function", [inner_product.made, inner_product.entry, distance.entry])
@pytest.mark.parametrize(("machine", "number"), [("aarch64", ARM64), ("x86_64", X86_64)])
def test_an_object_defines_the_kernel_and_imports_only_known_names(function, machine, number, tmp_path):
    _, kind, content, (names, environments) = translated(function, ARRAYS, machine, tmp_path / "there")
    found = Object(content)
    assert (kind, found.machine) == ("object", number)
    assert set(names) <= found.defined and len(environments) == len(set(environments)) > 0
    assert any(function.py_func.__name__ in name for name in names)
    assert all(map(KNOWN.fullmatch, found.wanted)), found.wanted


def test_a_kernel_for_kernels_remains_ir_with_the_layout_of_the_other_machine(tmp_path):
    _, kind, names, parts = translated(inner_product.bare, ARRAYS, "aarch64", tmp_path / "there")
    modules = [llvm.parse_bitcode(code) for code in parts.values()]
    layout = str(named("aarch64").machine().target_data)
    assert kind == "parts" and len(names) == 1 and len(modules) > 1
    assert {(module.triple, module.data_layout) for module in modules} == {(named("aarch64").triple, layout)}
    assert any(function.name == names[0] for module in modules for function in module.functions)


@pytest.mark.parametrize(("function", "given", "joins"), [
    (line, NUMBERS, False), (inner_product, ARRAYS, False), (distance, ARRAYS, True), (line_at_once, NUMBERS, True),
])  # fmt: skip
def test_products_and_sums_are_joined_only_where_a_kernel_does_it(function, given, joins):
    """`exp` of palpate does, in `two_product`."""
    function.bare.compile(given)
    generator = Elsewhere(named("aarch64"))
    library = generator.translated(function.bare.overloads[given].library)
    library.finalize()
    assembly = library.get_asm_str()
    assert "fmul" in assembly or joins
    assert bool(FUSED.search(assembly)) == joins


def test_an_unknown_machine_is_one_clear_line(tmp_path):
    with pytest.raises(ProcessorError, match=r"^found processor 'riscv', expected x86_64 or aarch64$"):
        named("riscv")
    command = [sys.executable, "-m", "palpate.cli.machine.kernels", "copy", str(tmp_path / "to"), "riscv"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "found processor 'riscv', expected x86_64 or aarch64\n"
    assert not (tmp_path / "to").exists()
