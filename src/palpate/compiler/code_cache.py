"""The code of a kernel on disk: one file for each set of types (`kernel_files`), with the hash of its content as name.

The name depends on the functions that the kernel calls, on all values that they refer to (`content`), on the types of
the arguments with the layout of records, on options and processor, and on the code of the compiler package itself. So a
file is never used for other code, and every copy of the same kernel uses it.
"""

import contextlib
import functools
import hashlib
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from palpate.compiler import kernel_cache, kernel_files, trust
from palpate.compiler.content import bytecode, closure, extensions, origin, values
from palpate.compiler.generators import in_record
from palpate.compiler.target import code_library, passes, replaced, target

_HERE = __name__.rpartition(".")[0]
COMPILER = (
    bytecode, closure, extensions, origin, values, in_record, code_library, passes, replaced, target,
    f"{_HERE}.target.dispatcher",
)  # fmt: skip
"""Modules that determine the code of all kernels, or the names of their files."""
SETTINGS = (
    "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "DEBUGINFO_DEFAULT", "EXTEND_VARIABLE_LIFETIMES",
    "LLVM_REFPRUNE_PASS", "LLVM_REFPRUNE_FLAGS",
)  # fmt: skip
"""Settings of numba that change code."""


class CodeCache:
    """Code of a kernel on disk, for numba's `Dispatcher`.

    LLVM requests code in a Python callback, in which the exception of Ctrl-C would be lost and missing code would run.
    Signals are therefore deferred until a function is loaded, a few milliseconds.
    """

    def __init__(self, kernel: Any, machine_code: bool) -> None:
        self._kernel, self.machine_code = kernel, machine_code
        self._names: dict[Any, Names] = {}

    @cached_property
    def cache_path(self) -> Path:
        """The user's folder; determined when the kernel is loaded, as a check of a graph loads none."""
        return kernel_cache.folder(numba.config.CACHE_DIR)  # type: ignore[attr-defined]

    @cached_property
    def _folders(self) -> list[Path]:
        return [path for path in (kernel_cache.shipped_folder(), self.cache_path) if path is not None]

    def names(self, sig: Any) -> "Names":
        """The names that the file for these types may have; read again when the kernel is compiled."""
        types = types_of(sig)
        if types not in self._names:
            self._names[types] = Names(self._kernel, types, target.PINNED.target_context.codegen())
        return self._names[types]

    def forget(self, sig: Any) -> None:
        """Determine the names for these types again: a value that the kernel refers to may have changed."""
        self._names.pop(types_of(sig), None)

    def flush(self) -> None:
        """Remove the files that this process has looked for (`Dispatcher.recompile`)."""
        for names in self._names.values():
            for name in names:
                with contextlib.suppress(OSError):
                    (self.cache_path / name).unlink()
        self._names.clear()

    def file(self, sig: Any) -> Path | None:
        """The file for these types; None: not cached."""
        found = (path / name for name in self.names(sig) for path in self._folders)
        return next(filter(os.path.lexists, found), None)

    def lock_compilation(self, sig: Any) -> contextlib.AbstractContextManager[None]:
        """Other processes do not compile the function during the block."""
        if self.names(sig).reason:
            return contextlib.nullcontext()
        return kernel_files.hold_lock(self.cache_path, f"{_name(self._kernel)}.lock")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types; None: not cached, or the file cannot be used."""
        target_context.refresh()
        for name in self.names(sig):
            for folder in self._folders:
                source = os.stat(__file__) if folder is not self.cache_path else None
                try:
                    content = kernel_files.read(folder, name, source)
                except trust.UntrustedError as error:
                    trust.warn(f"{folder}: a file {error}; it is compiled again")
                    continue
                if content is None:
                    continue
                with (
                    _deferred_signals(),
                    contextlib.suppress(Exception),
                ):  # such as a class of the user that was renamed
                    types, parts = pickle.loads(content)
                    if types == types_of(sig):
                        return CompileResult._rebuild(target_context, *parts)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code for these types, if the folder can be written."""
        if self.machine_code:
            data.library.get_pointer_to_function(data.fndesc.llvm_func_name)
        names = self.names(sig)
        reason = "it refers to an object of the process" if data.library.has_dynamic_globals else names.reason
        if reason:
            where = self._kernel.py_func.__code__
            text = f"{self._kernel.py_func.__qualname__} is compiled in each process: {reason}"
            warnings.warn_explicit(text, numba.NumbaWarning, where.co_filename, where.co_firstlineno)
            return
        content = dumps((types_of(sig), data._reduce()))
        with contextlib.suppress(OSError):
            kernel_files.write(self.cache_path, names.of(data.library.replaced), content)
            kernel_cache.limit_size(self.cache_path)


class Names:
    """Names of the file of a kernel for some types and a code generator: the usual one, and one for code that calls
    functions of the C library which its source does not name. Iterable.

    tag     a part of the first name, for the names of compiled functions
    reason  why the code cannot be cached; empty: it can
    """

    def __init__(self, kernel: Any, types: Any, generator: Any) -> None:
        self._kernel, self._types, self._processor = kernel, types, generator.magic_tuple()
        self.reason = ""
        try:
            self._name, self._called = self._hashed(everything=False)
        except origin.UnnamedError as error:
            self._name, self._called, self.reason = "", frozenset(), str(error)
        self.tag = self._name.rpartition("-")[2][:16]

    def __iter__(self) -> Iterator[str]:
        if not self.reason:
            yield self._name
            yield self._other

    def of(self, called: frozenset[str]) -> str:
        """The name for code that calls these functions of the C library."""
        return self._name if called <= self._called else self._other

    @functools.cached_property
    def _other(self) -> str:
        return self._hashed(everything=True)[0]

    def _hashed(self, everything: bool) -> tuple[str, frozenset[str]]:
        given = values.Values(compiled=True)
        types = given.data(self._types)
        digest, called = closure.digest(
            [self._kernel, *given.uses], replaced.replacement, [*replaced.REPLACED] if everything else ()
        )
        text = repr((types, digest, self._processor, _settings(), _compiler()))
        return f"{_name(self._kernel)}-{hashlib.sha256(text.encode()).hexdigest()[:32]}.nbc", called


def _name(kernel: Any) -> str:
    function = kernel.py_func
    qualname = function.__qualname__.translate({ord("<"): None, ord(">"): None})
    return f"{function.__module__}.{qualname}"


def _settings() -> list[Any]:
    return [getattr(numba.config, name, None) for name in SETTINGS]


@functools.cache
def _compiler() -> list[str]:
    """Hashes of the modules that determine the code of all kernels, without docstrings and comments."""
    found = []
    for module in COMPILER:
        name = module if isinstance(module, str) else module.__name__
        spec: Any = sys.modules[name].__spec__
        code = spec.loader.get_code(name) if hasattr(spec.loader, "get_code") else None
        found.append(origin.text_of(name) if code is None else bytecode.read_code(code).digest)
    return found


def types_of(sig: Any) -> tuple[Any, Any]:
    """Types of the arguments, and of the result if the signature states it."""
    return tuple(getattr(sig, "args", sig)), getattr(sig, "return_type", None)


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
