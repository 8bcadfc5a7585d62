"""Links kernels and all functions that they call to one WebAssembly module.

The IR of kernels is that of which code for x86-64 and ARM is made, with another layout of data (`target.processors`).
Numbers are the same bit for bit: what WebAssembly lacks is exact (`runtime`). Words that hold addresses have 64 bits in
the memory of kernels, and are cut to 32 bits where they are used.
"""

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import llvmlite
import llvmlite.binding as llvm
from numba import types

from palpate.compiler.entry_point import compiled
from palpate.compiler.target.code_library import COUNTING, Part
from palpate.compiler.target.processors import WASM
from palpate.compiler.wasm import runtime
from palpate.compiler.wasm.object_file import Linked, finish
from palpate.compiler.wasm.store import stored

INSTRUCTIONS = {"sqrt": "llvm.sqrt.f64", "floor": "llvm.floor.f64", "ceil": "llvm.ceil.f64", "rint": "llvm.rint.f64",
                "trunc": "llvm.trunc.f64", "llvm.fma.f64": "fma", "fabs": "llvm.fabs.f64"}  # fmt: skip
"""Functions of C that are instructions of WebAssembly, and the instruction that is not, by their replacement."""
RAISES = "ol_raise_with_shape_context"
"""Part of the name of numba's function that raises after it has made a text of numbers, which needs Python: here it
only returns the status of an exception."""
NUMBERS, WORDS = types.float64, types.int64
PROVIDED = {
    "fma": (runtime.fma, (NUMBERS,) * 3),
    "fmod": (runtime.fmod, (NUMBERS,) * 2),
    "allocate": (runtime.allocate, (WORDS,) * 3),
    "release": (runtime.release, (WORDS,) * 2),
    "reshape": (runtime.reshape, (WORDS,) * 7),
    "multiply": (runtime.multiply, (WORDS,) * 5),
}
"""Kernels of the runtime and the types of their arguments."""
RUNTIME = f"""
@palpate.heap = internal global [{runtime.CONTROL} x i64] zeroinitializer, align 16
define double @fma(double %a, double %b, double %c) {{
  %r = alloca double
  %e = alloca ptr
  %s = call i32 @"{{fma}}"(ptr %r, ptr %e, double %a, double %b, double %c)
  %v = load double, ptr %r
  ret double %v
}}
define double @fmod(double %a, double %b) noinline {{
  %r = alloca double
  %e = alloca ptr
  %s = call i32 @"{{fmod}}"(ptr %r, ptr %e, double %a, double %b)
  %v = load double, ptr %r
  ret double %v
}}
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %alignment) noinline {{
  %r = alloca i64
  %e = alloca ptr
  %a = zext i32 %alignment to i64
  %h = ptrtoint ptr @palpate.heap to i64
  %s = call i32 @"{{allocate}}"(ptr %r, ptr %e, i64 %h, i64 %size, i64 %a)
  %v = load i64, ptr %r
  %p = inttoptr i64 %v to ptr
  ret ptr %p
}}
define ptr @NRT_MemInfo_new_varsize_dtor(i64 %size, ptr %destructor) noinline {{
  %p = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 16)
  ret ptr %p
}}
define void @__multi3(ptr %to, i64 %a, i64 %b, i64 %c, i64 %d) noinline {{
  %r = alloca i64
  %e = alloca ptr
  %t = ptrtoint ptr %to to i64
  %s = call i32 @"{{multiply}}"(ptr %r, ptr %e, i64 %t, i64 %a, i64 %b, i64 %c, i64 %d)
  ret void
}}
define ptr @NRT_Allocate(i64 %size) noinline {{
  %p = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 16)
  %d = getelementptr i8, ptr %p, i32 {runtime.HEAD}
  ret ptr %d
}}
define void @NRT_Free(ptr %memory) noinline {{
  %b = getelementptr i8, ptr %memory, i32 -{runtime.HEAD}
  call void @NRT_MemInfo_call_dtor(ptr %b)
  ret void
}}
define i32 @numba_attempt_nocopy_reshape(i64 %n, ptr %l, ptr %s, i64 %m, ptr %k, ptr %t, i64 %size, i32 %f) noinline {{
  %r = alloca i64
  %e = alloca ptr
  %l_ = ptrtoint ptr %l to i64
  %s_ = ptrtoint ptr %s to i64
  %k_ = ptrtoint ptr %k to i64
  %t_ = ptrtoint ptr %t to i64
  %x = call i32 @"{{reshape}}"(ptr %r, ptr %e, i64 %n, i64 %l_, i64 %s_, i64 %m, i64 %k_, i64 %t_, i64 %size)
  %v = load i64, ptr %r
  %d = trunc i64 %v to i32
  ret i32 %d
}}
define void @NRT_MemInfo_call_dtor(ptr %block) noinline {{
  %r = alloca i64
  %e = alloca ptr
  %b = ptrtoint ptr %block to i64
  %h = ptrtoint ptr @palpate.heap to i64
  %s = call i32 @"{{release}}"(ptr %r, ptr %e, i64 %h, i64 %b)
  ret void
}}
define void @place_heap(i32 %begin, i32 %end) {{
  call void @llvm.memset.p0.i32(ptr align 16 @palpate.heap, i8 0, i32 {8 * runtime.CONTROL}, i1 false)
  %b = zext i32 %begin to i64
  %e = zext i32 %end to i64
  store i64 %b, ptr getelementptr (i64, ptr @palpate.heap, i32 {runtime.BEGIN})
  store i64 %e, ptr getelementptr (i64, ptr @palpate.heap, i32 {runtime.END})
  ret void
}}
define i32 @heap_top() {{
  %b = load i64, ptr getelementptr (i64, ptr @palpate.heap, i32 {runtime.BEGIN})
  %t = trunc i64 %b to i32
  ret i32 %t
}}
"""
"""IR of the functions of C that call the kernels of the runtime, and of those for the host: `place_heap` gives the heap
its memory, `heap_top` is the end of what was ever used of it. A list of numbers needs no destructor. `__multi3` is the
name by which LLVM calls the product of two integers of 128 bits."""
DEFINED = re.findall(r"^define \S+ @(\w+)\(", RUNTIME, re.MULTILINE)
CALLED_BY_LLVM = ("fma", "fmod", "__multi3")


class LinkError(Exception):
    """Kernels that cannot run in WebAssembly."""


class Kernel(NamedTuple):
    """A kernel and the types of its arguments, and of its result if its callers expect one (`entry_point.caller`)."""

    function: Any  # a CompiledKernel, which a type checker would take for a method
    given: tuple[Any, ...]
    result: Any = None

    def code(self) -> Any:
        """Its compiled form, of which `library` has the IR. LinkError: it has another result."""
        bare = self.function.bare
        if self.result is not None:
            try:
                return compiled(bare, self.result(*self.given))
            except TypeError as error:
                raise LinkError(str(error)) from None
        if self.given not in bare.overloads:
            bare.compile(self.given)
        return bare.overloads[self.given]


def link(entries: Sequence[Kernel], exports: Mapping[str, Kernel]) -> tuple[Linked, list[int]]:
    """One module, and the index in its function table of each entry. It is stored in the cache of kernels, since LLVM
    takes 10 s for that of a graph.

    exports  kernels of integers to export by these names; each argument and the result are i32 outside

    The module imports its memory, its function table and the pointer of its stack, which grows down.

    LinkError: the kernels call a function that is missing.
    """
    called = {name: Kernel(*given) for name, given in PROVIDED.items()}
    kernels = [*entries, *exports.values(), *called.values()]
    parts: dict[str, Part] = {}
    for kernel in kernels:
        parts |= kernel.code().library.parts()
    symbols = {kernel: kernel.code().fndesc.llvm_func_name for kernel in kernels}
    text = re.sub(r"\{(\w+)\}", lambda found: symbols[called[found[1]]], RUNTIME)
    text += "".join(_export(name, symbols[kernel], kernel) for name, kernel in exports.items())
    places = list(dict.fromkeys(symbols[entry] for entry in entries))
    joined = ", ".join(f'ptr @"{name}"' for name in places)
    text += f"@palpate.entries = global [{len(places)} x ptr] [{joined}]\n"
    given = "\n".join([*sorted(parts), text, WASM.features, RAISES, *INSTRUCTIONS, llvmlite.__version__])
    name = f"palpate.wasm-{hashlib.sha256(given.encode()).hexdigest()[:32]}.bin"
    linked = stored(name, lambda: _compiled(parts, text, list(exports)))
    if linked.imported:
        raise LinkError(f"kernels call {', '.join(linked.imported)}, which WebAssembly lacks")
    return linked, [linked.table[symbols[entry]] for entry in entries]


def _compiled(parts: Mapping[str, Part], text: str, exports: Sequence[str]) -> Linked:
    """The module of parts of IR and of more IR as text."""
    names = {name: name for name in (*exports, "place_heap", "heap_top")}
    module = llvm.parse_assembly(_with_declarations(_for_target(str(_joined(parts.values()))) + text))
    return finish(_generate(module, [*names, *CALLED_BY_LLVM]), names)


def _joined(parts: Iterable[Part]) -> Any:
    """All functions in one module; what counts references is inlined, as in `Library._optimize`."""
    whole = llvm.parse_assembly("")
    for part in parts:
        counts = (COUNTING, False) in part.functions
        text = str(part.module).replace("noinline", "alwaysinline") if counts else ""
        copy = llvm.parse_assembly(text) if counts else part.module.clone()
        for function in copy.functions:
            if not function.is_declaration:
                function.linkage = "weak_odr"  # several parts may contain it; LLVM would leave one without callers out
        whole.link_in(copy)
    return whole


def _for_target(text: str) -> str:
    """The IR for WebAssembly: without the layout of x86-64, and with its instructions."""
    text = re.sub(r"^target (datalayout|triple) = .*$", "", text, flags=re.MULTILINE)
    text = "\n".join(_without_texts(text.split("\n"))).replace("= common ", "= internal ")
    for name, other in INSTRUCTIONS.items():
        text = re.sub(rf'^declare [^\n]*@"?{re.escape(name)}"?\(.*$', "", text, flags=re.MULTILINE)
        text = re.sub(rf'@"?{re.escape(name)}"?\(', f"@{other}(", text)
    return re.sub(rf"^declare [^\n]*@({'|'.join(DEFINED)})\(.*$", "", text, flags=re.MULTILINE)


def _without_texts(lines: Iterable[str]) -> Iterator[str]:
    """The lines of IR, with the body of functions that raise (`RAISES`) cut to their status."""
    inside = False
    for line in lines:
        if not inside or line == "}":
            yield line
            inside = False
        head = line.partition("(")[0]
        if head.startswith("define ") and RAISES in head and " i32 @" in head:
            yield "  ret i32 1"
            inside = True


def _with_declarations(text: str) -> str:
    """The IR with declarations of the instructions that it uses."""
    for name in INSTRUCTIONS.values():
        if f"@{name}(" in text and not re.search(rf"^(declare|define) [^\n]*@{re.escape(name)}\(", text, re.MULTILINE):
            text += f"declare double @{name}(double)\n"
    if "declare void @llvm.memset.p0.i32" not in text:
        text += "declare void @llvm.memset.p0.i32(ptr, i8, i32, i1)\n"
    return text


def _export(name: str, symbol: str, kernel: Kernel) -> str:
    """IR of a function of 32-bit integers that calls a kernel of 64-bit ones. A kernel that raises stops the module."""
    given = range(len(kernel.given))
    wide = "".join(f"  %w{i} = zext i32 %a{i} to i64\n" for i in given)
    return (
        f"define i32 @{name}({', '.join(f'i32 %a{i}' for i in given)}) {{\n  %r = alloca i64\n  %e = alloca ptr\n"
        f"  store i64 0, ptr %r\n{wide}"
        f'  %s = call i32 @"{symbol}"(ptr %r, ptr %e{"".join(f", i64 %w{i}" for i in given)})\n'
        f"  %bad = icmp sgt i32 %s, 0\n  br i1 %bad, label %stop, label %go\n"
        f"stop:\n  call void @llvm.trap()\n  unreachable\n"
        f"go:\n  %v = load i64, ptr %r\n  %t = trunc i64 %v to i32\n  ret i32 %t\n}}\n"
    )


def _generate(module: Any, kept: Sequence[str]) -> bytes:
    """The object of a module, of which only these functions are visible."""
    machine = WASM.machine()
    WASM.adopt(module, machine)
    for function in module.functions:
        if not function.is_declaration:
            function.linkage = "external" if function.name in kept else "internal"
    module.verify()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)
