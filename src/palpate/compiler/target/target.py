"""The target of kernels: numba's CPU target with a fixed processor.

numba takes the processor from its target, so kernels have a separate target
(https://numba.readthedocs.io/en/stable/extending/target_extension.html); the environment and `numba.config` do not
change. Functions of the C library are replaced by kernels (`replaced`).

Names of compiled functions contain a tag: for a kernel the hash of its content, for functions of numba one of the
process. So no two functions with different code have the same name, also if they were compiled in different processes.
"""

import os
import secrets
from functools import partial
from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba import types
from numba.core.callconv import CPUCallConv
from numba.core.compiler import Flags
from numba.core.cpu import CPUContext
from numba.core.externals import c_math_functions
from numba.core.registry import CPUDispatcher, CPUTarget
from numba.core.target_extension import CPU, dispatcher_registry, jit_registry, target_registry
from numba.core.typing import Context
from numba.core.utils import threadsafe_cached_property
from numba.extending import models, register_model

from palpate.compiler.arithmetic import kernel_processor
from palpate.compiler.target.code_library import REPLACEMENT, Codegen
from palpate.compiler.target.passes import KernelCompiler
from palpate.compiler.target.replaced import REPLACED, plain_name, replacement

TARGET = "palpate"  # Name of the target of kernels


class _Processor(CPU):
    """A CPU, so that numba's implementations for CPUs apply."""


class _PinnedCodegen(Codegen):
    """Code generator for x86-64-v3 or ARMv8-A instead of the host processor."""

    def _get_host_cpu_name(self) -> str:
        return kernel_processor() or super()._get_host_cpu_name()

    def _get_host_cpu_features(self) -> str:
        return "" if kernel_processor() else super()._get_host_cpu_features()

    def __init__(self, module_name: str) -> None:
        super().__init__(module_name)
        self._replacements: dict[str, Any] = {}

    def replacement(self, name: str) -> Any:
        """The code that replaces a function of the C library, with its interface; None: it is not replaced."""
        if name in REPLACED and name not in self._replacements:
            self._replacements[name] = self._wrapped(name)
        return self._replacements.get(name)

    def _wrapped(self, name: str) -> Any:
        function, context = replacement(name).bare, PINNED.target_context
        argument_types = (types.float64,) * function.py_func.__code__.co_argcount
        function.compile(argument_types)
        code = function.overloads[argument_types]
        library = self.create_library(f"{REPLACEMENT}{plain_name(name)}")
        module = library.create_ir_module(library.name)
        number = ir.DoubleType()
        wrapper = ir.Function(module, ir.FunctionType(number, [number] * len(argument_types)), library.name)
        wrapper.attributes.add("noinline")
        builder = ir.IRBuilder(wrapper.append_basic_block())
        inner = context.declare_function(module, code.fndesc)
        _, result = context.call_conv.call_function(builder, inner, types.float64, argument_types, wrapper.args)
        builder.ret(result)
        # so that LLVM merges equal calls and leaves out those without use, as it does for functions of the C library
        pure = llvm.parse_assembly(str(module).replace(" noinline", " noinline nounwind willreturn memory(none)", 1))
        library.add_llvm_module(pure)
        library.add_linking_library(code.library)
        return library


class _CallConv(CPUCallConv):
    """numba's convention, with exceptions that name the kernel and no line: cached code outlives the lines of its
    source, and copies of the sources share it. `NUMBA_DISABLE_JIT=1` shows the line."""

    def build_excinfo_struct(self, exc: Any, exc_args: Any, loc: Any, func_name: Any) -> Any:
        return exc, exc_args, (func_name, "<kernel>", 0) if func_name is not None else None


class _Context(CPUContext):
    def init(self) -> None:
        self.is32bit = False
        self._missing: dict[Any, str] = {}
        self._internal_codegen = _PinnedCodegen("palpate.exec")
        c_math_functions.install(self)

    @property
    def call_conv(self) -> CPUCallConv:
        return _CallConv(self)

    def load_additional_registries(self) -> None:
        """Load numba's implementations. One of their modules imports scipy.linalg, which takes 0.3 s, only to find out
        whether it is installed; palpate requires it, and numba checks again where it compiles a call of BLAS."""
        from numba.np import linalg

        check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
        try:
            super().load_additional_registries()
        finally:
            linalg.ensure_blas = check

    def get_function(self, fn: Any, sig: Any, _firstcall: bool = True) -> Any:
        """The generator of the code of an operation. numba asks for some of which it has none, as for each array, and
        then reads all registries again; here only if they have changed since the last time."""
        if not isinstance(fn, str):
            return super().get_function(fn, sig, _firstcall)
        key = fn, sig.args, sum(len(registry.functions) for registry in self._registries)
        if key in self._missing:
            raise NotImplementedError(self._missing[key])
        try:
            return super().get_function(fn, sig, _firstcall)
        except NotImplementedError as error:
            self._missing[key] = str(error)
            raise


class _Function(types.Function):
    """A function of numba that finds its signatures once: numba tries about ten templates for each operator in each
    pass over a function, and again when it generates code. A result without separate code depends only on the types."""

    def augment(self, other: Any) -> Any:
        return super().augment(_Function(other.templates) if type(other) is types.Function else other)

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        if kws or not isinstance(context, _Typing):
            return super().get_call_type(context, args, kws)
        key = self, tuple(args)
        signature = context.known.get(key)
        if signature is None:
            signature = super().get_call_type(context, args, kws)
            if signature is not None and self._impl_keys.get(signature.args) is self.typing_key:  # type: ignore[attr-defined]
                context.known[key] = signature
        return signature


register_model(_Function)(models.OpaqueModel)


class _Typing(Context):
    def init(self) -> None:
        self.known: dict[Any, Any] = {}
        """Signatures, by function and types of the arguments."""

    def _insert_global(self, gv: Any, gty: Any) -> None:
        super()._insert_global(gv, _Function(gty.templates) if type(gty) is types.Function else gty)


class _Target(CPUTarget):
    @threadsafe_cached_property
    def _toplevel_typing_context(self) -> Context:
        return _Typing()

    @threadsafe_cached_property
    def _toplevel_target_context(self) -> CPUContext:
        return _Context(self.typing_context, TARGET)


target_registry[TARGET] = _Processor
PINNED = _Target(TARGET)


_TOKEN = secrets.token_hex(6)


class _Flags(Flags):
    """numba's flags. numba compares all flags each time that it looks up a function for some types; reading them one by
    one takes 6 % of the time of a compilation."""

    _DEFAULTS = {name: option.default for name, option in Flags.options.items()}
    _HASH = hash(Flags())

    def __init__(self, copy_from: Flags | None = None, tag: str = "") -> None:
        super().__init__(copy_from)
        self._tag = tag or getattr(copy_from, "_tag", "")

    def __hash__(self) -> int:
        return self._HASH

    def values(self) -> dict[str, Any]:
        return self._DEFAULTS | self._values

    def get_mangle_string(self) -> str:
        return self._tag


class Pinned(CPUDispatcher):
    """numba's compiled function, for the pinned target."""

    targetdescr = PINNED

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, **{"pipeline_class": KernelCompiler, **named})
        self._compiler._customize_flags = self._tagged  # type: ignore[attr-defined]

    def _tagged(self, flags: Flags) -> Flags:
        return _Flags(flags, self.tag())

    def tag(self) -> str:
        """Part of the names of the functions that are now compiled: no other process uses it."""
        return f"{_TOKEN}{os.getpid():x}"


dispatcher_registry[_Processor] = Pinned
jit_registry[_Processor] = partial(numba.jit, _target=TARGET)  # for functions of numpy that numba implements in Python
