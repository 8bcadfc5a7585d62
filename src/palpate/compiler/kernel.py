"""Kernels: functions that numba compiles at their first call and caches on disk (`kernel_cache`).

Kernels are compiled for x86-64-v3 in any process (`arithmetic.pinnable`), independent of the processor for which numba
compiles the user's functions. numba takes the processor from its target, so kernels have a separate target
(https://numba.readthedocs.io/en/stable/extending/target_extension.html); the environment and `numba.config` do not
change. Functions of `numba.njit` may call kernels, but not the reverse.
"""

import contextlib
import gc
import hashlib
import importlib
import inspect
import os
import pickle
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, ModuleType
from typing import Any

import llvmlite.binding as llvm
import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import event
from numba.core.compiler import CompileResult, Flags
from numba.core.cpu import CPUContext
from numba.core.externals import c_math_functions
from numba.core.registry import CPUDispatcher, CPUTarget, cpu_target
from numba.core.serialize import dumps
from numba.core.target_extension import (
    CPU,
    current_target,
    dispatcher_registry,
    jit_registry,
    target_override,
    target_registry,
)
from numba.core.typing import Context
from numba.core.utils import threadsafe_cached_property

from palpate.compiler import interpreted, kernel_cache, kernel_files, trust
from palpate.compiler.arithmetic import LEVEL, pinnable
from palpate.compiler.code_library import Codegen

TARGET = "palpate"  # Name of the target of kernels
COMPILING = "palpate:compile"  # Name of numba's event while a kernel is compiled, or awaited from another process
PACKAGE = __name__.partition(".")[0]
REPLACED = {
    **dict.fromkeys(("exp", "llvm.exp.f64"), ("exponentials", "exp")),
    **dict.fromkeys(("log", "llvm.log.f64"), ("exponentials", "log")),
    **dict.fromkeys(("pow", "llvm.pow.f64"), ("exponentials", "power")),
    **dict.fromkeys(("log2", "llvm.log2.f64"), ("exponentials", "log2")),
    "expm1": ("exponentials", "expm1"),
    "log1p": ("exponentials", "log1p"),
    **dict.fromkeys(("sin", "llvm.sin.f64"), ("angles", "sin")),
    **dict.fromkeys(("cos", "llvm.cos.f64"), ("angles", "cos")),
    "acos": ("angles", "acos"),
    "asin": ("angles", "asin"),
    "atan2": ("angles", "atan2"),
    **dict.fromkeys(("hypot", "_hypot"), ("angles", "hypot")),
}
"""Module and name of the kernel that replaces a function of the C library in all kernels, by the name in their code."""


class _Processor(CPU):
    """A CPU, so that numba's implementations for CPUs apply."""


class _PinnedCodegen(Codegen):
    """Code generator for x86-64-v3 instead of the host processor."""

    def _get_host_cpu_name(self) -> str:
        return LEVEL if pinnable() else super()._get_host_cpu_name()

    def _get_host_cpu_features(self) -> str:
        return "" if pinnable() else super()._get_host_cpu_features()

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
        library = self.create_library(f"{TARGET}.{name}")
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


class _Context(CPUContext):
    def init(self) -> None:
        self.is32bit = False
        self._internal_codegen = _PinnedCodegen("palpate.exec")
        c_math_functions.install(self)

    def load_additional_registries(self) -> None:
        """Load numba's implementations. One of their modules imports scipy.linalg, which takes 0.3 s, only to find out
        whether it is installed; palpate requires it, and numba checks again where it compiles a call of BLAS."""
        from numba.np import linalg

        check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
        try:
            super().load_additional_registries()
        finally:
            linalg.ensure_blas = check


class _Typing(Context):
    """Types of expressions, cached: numba tries about ten templates for each operator in each pass over a function. A
    result without separate code depends only on the types."""

    def init(self) -> None:
        self._known: dict[Any, Any] = {}

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        if kws or not isinstance(func, types.Function):
            return super().resolve_function_type(func, args, kws)
        known = self._known.get((func, args))
        if known is not None and known[0] is func:
            return known[1]
        signature = super().resolve_function_type(func, args, kws)
        if signature is not None and func._impl_keys.get(signature.args) is func.typing_key:  # type: ignore[attr-defined]
            self._known[func, args] = func, signature
        return signature


class _Target(CPUTarget):
    @threadsafe_cached_property
    def _toplevel_typing_context(self) -> Context:
        return _Typing()

    @threadsafe_cached_property
    def _toplevel_target_context(self) -> CPUContext:
        return _Context(self.typing_context, TARGET)


target_registry[TARGET] = _Processor
PINNED = _Target(TARGET)


class Pinned(CPUDispatcher):
    """numba's compiled function, for the pinned target."""

    targetdescr = PINNED


dispatcher_registry[_Processor] = Pinned
jit_registry[_Processor] = partial(numba.jit, _target=TARGET)  # for functions of numpy that numba implements in Python


class _Flags(Flags):
    """numba's flags. numba compares all flags each time that it looks up a function for some types; reading them one by
    one takes 6 % of the time of a compilation."""

    _DEFAULTS = {name: option.default for name, option in Flags.options.items()}
    _HASH = hash(Flags())

    def __hash__(self) -> int:
        return self._HASH

    def values(self) -> dict[str, Any]:
        return self._DEFAULTS | self._values


@contextlib.contextmanager
def collection_suspended() -> Iterator[None]:
    """Suspend garbage collection, which would take 10 % of the time of compilations: the compiler keeps millions of
    objects."""
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class CachedFunction(Pinned):
    """A pinned function that is cached on disk. If another process is compiling it, wait and load the result."""

    def __init__(self, py_func: Any, targetoptions: Any = None, *, machine_code: bool = False, **more: Any) -> None:
        super().__init__(py_func, targetoptions=targetoptions, **more)
        self._cache = _Cache(py_func, self.targetoptions, machine_code)
        self._compiler._customize_flags = _Flags  # type: ignore[attr-defined]

    def file(self, sig: Any) -> Path | None:
        """The cache file for these types; None: not cached."""
        return self._cache.file(sig)

    def compile(self, sig: Any) -> Any:
        """The code for these types, compiled or loaded."""
        with target_override(TARGET), collection_suspended():
            if self._cache.file(sig) is not None:
                return super().compile(sig)
            with event.trigger_event(COMPILING), self._cache.lock_compilation():
                return super().compile(sig)


class _Cache:
    """Code of a function on disk, for `Dispatcher`: one file for each set of types (`kernel_files`).

    LLVM requests code in a Python callback, in which the exception of Ctrl-C would be lost and missing code would run.
    Signals are therefore deferred until a function is loaded, a few milliseconds.
    """

    def __init__(self, function: Any, options: Any, machine_code: bool) -> None:
        self._function, self._options, self._machine_code = function, options, machine_code
        self.cache_path = kernel_cache.folder(numba.config.CACHE_DIR)  # type: ignore[attr-defined]
        self._folders = [path for path in (kernel_cache.shipped_folder(), self.cache_path) if path is not None]
        self._source = _source(function)
        self._names: dict[Any, str] = {}

    def flush(self) -> None:
        """Remove the files that this process has looked for (`Dispatcher.recompile`)."""
        for name in self._names.values():
            with contextlib.suppress(OSError):
                (self.cache_path / name).unlink()

    def file(self, sig: Any) -> Path | None:
        """The file for these types; None: not cached."""
        found = [path / self._name(sig) for path in self._folders] if self._source is not None else []
        return next(filter(os.path.lexists, found), None)

    def lock_compilation(self) -> contextlib.AbstractContextManager[None]:
        """Other processes do not compile the function during the block."""
        if self._source is None:
            return contextlib.nullcontext()
        return kernel_files.hold_lock(
            self.cache_path, f"{self._function.__module__}.{self._function.__qualname__}.lock"
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types; None: not cached, or the file cannot be used."""
        target_context.refresh()
        for folder in self._folders if self._source is not None else ():
            source = os.stat(__file__) if folder is not self.cache_path else None
            try:
                content = kernel_files.read(folder, self._name(sig), source)
            except trust.UntrustedError as error:
                trust.warn(f"{folder}: a file {error}; it is compiled again")
                continue
            if content is None:
                continue
            with _deferred_signals(), contextlib.suppress(Exception):  # such as a class of the user that was renamed
                types, parts = pickle.loads(content)
                if types == _types(sig):
                    return CompileResult._rebuild(target_context, *parts)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code for these types, if the folder can be written."""
        if self._machine_code:
            data.library.get_pointer_to_function(data.fndesc.llvm_func_name)
        if self._source is None:
            return
        if data.library.has_dynamic_globals:
            where = self._function.__code__
            text = f"{self._function.__qualname__} is compiled in each process: it refers to an object of the process"
            warnings.warn_explicit(text, numba.NumbaWarning, where.co_filename, where.co_firstlineno)
            return
        content = dumps((_types(sig), data._reduce()))
        with contextlib.suppress(OSError):
            kernel_files.write(self.cache_path, self._name(sig), content)

    def _name(self, sig: Any) -> str:
        """Name of the file. It contains the name of the function, and a hash of the types with the layout of records,
        the values that the function refers to, the options, the processor and, for functions of users, the source."""
        types = _types(sig)
        if types not in self._names:
            processor = PINNED.target_context.codegen().magic_tuple()
            known = repr((types, _meaning(self._function, ()), self._options, processor, self._source))
            digest = hashlib.sha256(known.encode()).hexdigest()[:32]
            qualname = self._function.__qualname__.translate({ord("<"): None, ord(">"): None})
            self._names[types] = f"{self._function.__module__}.{qualname}-{digest}.nbc"
        return self._names[types]


def _types(sig: Any) -> tuple[Any, Any]:
    """Types of the arguments, and of the result if the signature states it."""
    return tuple(getattr(sig, "args", sig)), getattr(sig, "return_type", None)


def _source(function: Any) -> str | None:
    """A hash of the source of a function, its file or its cell in a notebook; empty for functions of `COMPILED`, whose
    sources are in the name of the folder. None: no source, so the function cannot be cached."""
    if function.__module__.startswith(tuple(f"{package}." for package in kernel_cache.COMPILED)):
        return ""
    try:
        file = Path(function.__code__.co_filename)
        content = file.read_bytes() if file.exists() else inspect.getsource(function).encode()
    except OSError:
        return None
    return hashlib.sha256(content).hexdigest()


def _meaning(function: Any, callers: tuple[Any, ...]) -> list[Any]:
    """Name and code of a function and the values that it refers to, for the cache key: free variables, and for user
    functions also globals, which may be defined in files that numba does not monitor (`kernel_cache.folder` monitors
    those of palpate). Other kernels enter with the same content; numba would treat closures as new in each process."""
    code, name = function.__code__, f"{function.__module__}.{function.__qualname__}"
    found = [cell.cell_contents for cell in function.__closure__ or ()]
    if not name.startswith(f"{PACKAGE}."):
        named = {each: function.__globals__.get(each) for each in code.co_names}
        modules = [each for each in named.values() if isinstance(each, ModuleType)]
        found += [*named.values(), *(getattr(module, each, None) for module in modules for each in code.co_names)]
    known: list[Any] = [
        name,
        code.co_firstlineno,
        code.co_names,
        code.co_code,
        *(getattr(each, "co_code", each) for each in code.co_consts),
    ]
    for each in found:
        if isinstance(each, CachedFunction):
            if each.py_func not in callers:
                known += _meaning(each.py_func, (*callers, function))
        elif isinstance(each, np.ndarray):
            known += [each.dtype.str, each.shape, each.tobytes()]
        elif not isinstance(each, ModuleType | type | FunctionType | BuiltinFunctionType | np.ufunc):
            known.append(each)
    return known


def replacement(name: str) -> Any:
    """The kernel that replaces a function of the C library (`REPLACED`); None: it is not replaced."""
    if name not in REPLACED:
        return None
    module, kernel_name = REPLACED[name]
    return getattr(importlib.import_module(f"{__package__}.{module}"), kernel_name)


@contextlib.contextmanager
def _deferred_signals() -> Iterator[None]:
    """Defer Python's handlers of signals that end a program until the end of the block."""
    received: list[int] = []
    here = threading.current_thread() is threading.main_thread()
    ending = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if here and hasattr(signal, name)]
    handlers = {number: signal.getsignal(number) for number in ending}
    handlers = {number: handler for number, handler in handlers.items() if callable(handler)}
    try:
        for number in handlers:
            signal.signal(number, lambda number, _: received.append(number))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number in received:
            signal.raise_signal(number)


class CompiledKernel(CachedFunction):
    """A compiled function for Python and for other kernels.

    numba inlines each function into a wrapper for Python and one for C, which takes 20 % of the time of a first start.
    A function called by kernels needs neither; the wrapper for Python is made when Python calls it.
    """

    @cached_property
    def bare(self) -> CachedFunction:
        """For other kernels, which include its code."""
        return self._without_wrapper("bare")

    @cached_property
    def entry(self) -> CachedFunction:
        """For callers by address."""
        return self._without_wrapper("entry", machine_code=True)

    def _without_wrapper(self, name: str, machine_code: bool = False) -> CachedFunction:
        function = self.py_func
        bare = FunctionType(
            function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
        )
        bare.__module__, bare.__qualname__ = function.__module__, f"{function.__qualname__}.{name}"
        return CachedFunction(bare, {**self.targetoptions, "no_cpython_wrapper": True}, machine_code=machine_code)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """The types of a call from a kernel, in which constants count as any other number. numba would compile the
        function for each constant argument; LLVM propagates constants anyway when it inlines the function."""
        args, kws = [types.unliteral(one) for one in args], {name: types.unliteral(one) for name, one in kws.items()}
        return self.bare.get_call_template(args, kws)  # type: ignore[attr-defined]

    def get_overload(self, sig: Any) -> Any:
        """The code for a call from a kernel; registered in numba's CPU target for a call from `numba.njit`."""
        entry = self.bare.get_overload(sig)  # type: ignore[attr-defined]
        if current_target() == cpu_target._target_name:
            code = self.bare.overloads[tuple(sig)]  # type: ignore[attr-defined]
            cpu_target.target_context.insert_user_function(entry, code.fndesc, [code.library])
        return entry


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    error_model: str = "python",
    pointer: bool = False,
    nogil: bool = False,
    inline: bool = False,
) -> Any:
    """Decorator of a function to compile.

    error_model  a division by 0 raises ("python"), or returns inf or nan ("numpy")
    pointer      also for use as an argument of kernels (`materials.compile_law`)
    nogil        release the global interpreter lock during calls
    inline       copy it into the kernels that call it, independent of its size
    """
    if function is None:
        return partial(kernel, error_model=error_model, pointer=pointer, nogil=nogil, inline=inline)
    if interpreted.ENABLED:
        plain: Any = interpreted.with_functions(function, replacement)
        plain.py_func = plain  # as in a compiled one
        return plain
    options = {"nopython": True, "boundscheck": None, "no_cfunc_wrapper": not pointer, "error_model": error_model}
    more = {"nogil": True} if nogil else {}
    return CompiledKernel(function, options | more | ({"forceinline": True} if inline else {}))
