"""Files of kernels for another processor, with the names by which a process there looks for them.

A kernel is compiled again, because of some the cache has only machine code; what it calls is loaded as IR. The IR does
not depend on the processor, so its functions keep the names that they have here.
"""

from pathlib import Path
from typing import Any

from numba.core.serialize import dumps

from palpate.compiler import kernel_files
from palpate.compiler.code_cache import CodeCache, Names, types_of
from palpate.compiler.target.dispatcher import CachedFunction
from palpate.compiler.target.elsewhere import Elsewhere


class Translation(CachedFunction):
    """A kernel whose code for another processor is written to a folder."""

    def __init__(self, kernel: CachedFunction, generator: Elsewhere, folder: Path) -> None:
        super().__init__(kernel.py_func, kernel.targetoptions)
        self._cache = _Folder(self, kernel._cache.machine_code, generator, folder)

    def write(self, sig: Any) -> None:
        """Write the file for these types."""
        self.compile(sig)


class _Folder(CodeCache):
    def __init__(self, kernel: Any, machine_code: bool, generator: Elsewhere, folder: Path) -> None:
        super().__init__(kernel, machine_code)
        self._generator, self._folder = generator, folder

    def file(self, sig: Any) -> None:
        """None: the kernel is always compiled."""

    def load_overload(self, sig: Any, target_context: Any) -> None:
        """None: the kernel is always compiled."""

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code for these types, made for the other processor."""
        library = self._generator.translated(data.library)
        if self.machine_code or data.library._finalized:
            library.finalize()
            state = data._replace(library=library)._reduce()
        else:
            state = library.serialize_using_object_code(), *data._reduce()[1:]
        names = Names(self._kernel, types_of(sig), self._generator)
        kernel_files.write(self._folder, names.of(data.library.replaced), dumps((types_of(sig), state)))
