"""Machine code for another processor, which this process does not run: the IR of kernels, optimised and generated as
for this one (`code_library`), with LLVM's generator for that one and without an engine that loads it."""

from typing import Any

import numba

from palpate.compiler.target.code_library import Codegen, Library, Part
from palpate.compiler.target.processors import Processor


class ElsewhereLibrary(Library):
    """The code of one function for another processor."""

    _codegen: Any

    def _finalize_final_module(self) -> None:
        self.enable_object_caching()
        self._compiled_object = self._codegen._tm.emit_object(self._final_module)
        self._finalized = True


class Elsewhere(Codegen):
    """numba's code generator for another processor."""

    _library_class = ElsewhereLibrary

    def __init__(self, processor: Processor) -> None:
        self.processor = processor
        self._adopted: dict[str, Part] = {}
        super().__init__("palpate.exec")

    def _get_host_cpu_name(self) -> str:
        return self.processor.cpu

    def _get_host_cpu_features(self) -> str:
        return self.processor.features

    def _init(self, llvm_module: Any) -> None:
        self._tm_features = self.processor.features
        level: Any = numba.config.OPT  # type: ignore[attr-defined]
        self._tm = self.processor.machine(level)
        self._data_layout = str(self._tm.target_data)
        self._loopvect, self._opt_level = level.is_opt_max, 3 if level.is_opt_max else 0  # as `CPUCodegen._init`

    def _create_empty_module(self, name: str) -> Any:
        module = super()._create_empty_module(name)
        module.triple = self.processor.triple
        return module

    def translated(self, library: Library) -> ElsewhereLibrary:
        """The IR of a function and of all that it calls, for this processor."""
        parts = {}
        for digest, part in library.parts().items():
            if digest not in self._adopted:
                module = part.module.clone()
                self.processor.adopt(module, self._tm)
                self._adopted[digest] = Part(module)
            parts[digest] = self._adopted[digest]
        found = self.create_library(library.name)
        found._loaded = library.names, parts
        return found
