"""Machine code of kernels: optimised and generated once per entry point, together with all functions that it calls.

numba generates machine code for each function as soon as it is compiled, and optimises it again in each caller. Here a
function that is called only by kernels remains LLVM IR until its address is requested. The cache on disk contains the
machine code of entry points, and the IR of other functions.
"""

import functools
import hashlib
from collections.abc import Iterable
from typing import Any

import llvmlite.binding as llvm
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.environment import lookup_environment

COUNTING = "NRT_incref"  # numba's function that counts a reference to an array; one module contains all that count
ENVIRONMENT = "_ZN08NumbaEnv"  # Prefix of the names of numba's environments
REPLACEMENT = "palpate."  # Prefix of the names of functions that replace those of the C library
DYNAMIC = "numba.dynamic.globals"  # Prefix of the names of Python objects that code refers to


class Part:
    """IR of one function, with what is asked of it for each function that calls it.

    module   LLVM's module
    bitcode  its content
    digest   a hash of the content
    """

    def __init__(self, module: Any, bitcode: bytes = b"") -> None:
        self.module, self.bitcode = module, bitcode or module.as_bitcode()

    @functools.cached_property
    def digest(self) -> str:
        return hashlib.sha256(self.bitcode).hexdigest()

    @functools.cached_property
    def functions(self) -> list[tuple[str, bool]]:
        """Names of functions, and whether the module only declares them."""
        return [(f.name, f.is_declaration) for f in self.module.functions]

    @functools.cached_property
    def replaced(self) -> frozenset[str]:
        """Functions of the C library whose replacement it calls or defines."""
        return _replaced(name for name, _ in self.functions)

    @functools.cached_property
    def dynamic(self) -> bool:
        """Whether it refers to an object of this process."""
        return any(v.name.startswith(DYNAMIC) for v in self.module.global_variables)


class Library(JITCodeLibrary):
    """The code of one function."""

    _codegen: Any
    _loaded: tuple[list[str], dict[str, Part]] | None = None  # IR from disk: names of its functions, and the parts
    _tidied: dict[str, Part] | None = None  # IR of the function itself
    _replaced: frozenset[str] | None = None  # found when machine code was generated

    def add_ir_module(self, ir_module: Any) -> None:
        """Add the IR of a function. Its calls of the C library's functions become calls of kernels of this package
        (`replaced.REPLACED`), before a pass of LLVM knows them as functions of the C library."""
        text = cgutils.normalize_ir_text(str(ir_module))
        for function in ir_module.functions:
            code = self._codegen.replacement(function.name) if function.is_declaration else None
            if code is not None:
                text = text.replace(f'@"{function.name}"', f'@"{code.name}"')
                self.add_linking_library(code)
        module = llvm.parse_assembly(text)
        module.name = ir_module.name
        module.verify()
        self.add_llvm_module(module)

    def add_linking_library(self, library: Any) -> None:
        """Add a function that this one calls."""
        if library not in self._linking_libraries:
            self._reload_init.update(library._reload_init)
            self._linking_libraries.append(library)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Nothing: the passes over a whole entry point optimise it."""
        ll_module.data_layout = self._codegen._data_layout

    def parts(self) -> dict[str, Part]:
        """IR of the function and of all functions that it calls, by the hash of its content."""
        found: dict[str, Part] = {}
        for library in self._all():
            found |= library._part() if isinstance(library, Library) else _by_digest(library._get_module_for_linking())
        return found

    def _all(self) -> list[Any]:
        """The library itself and those of all functions that it calls, directly or indirectly."""
        found: dict[Any, None] = {self: None}
        waiting = [self]
        while waiting:
            new = [each for each in waiting.pop(0)._linking_libraries if each not in found]
            found |= dict.fromkeys(new)
            waiting += [each for each in new if isinstance(each, Library)]
        return list(found)

    @property
    def has_dynamic_globals(self) -> bool:
        """Whether code refers to an object of this process and therefore cannot be cached on disk."""
        if self._finalized:
            return super().has_dynamic_globals
        return any(part.dynamic for part in self.parts().values())

    @property
    def replaced(self) -> frozenset[str]:
        """Functions of the C library whose replacement the code contains."""
        return _joined(self.parts().values()) if self._replaced is None else self._replaced

    def _part(self) -> dict[str, Part]:
        if self._loaded is not None:
            return self._loaded[1]
        if self._tidied is None:
            module = self._final_module.clone()
            names = [f.name for f in module.functions if not f.is_declaration]
            for name in names:
                module.get_function(name).linkage = "external"  # keep functions for callers in other modules
            self._codegen.tidy(module)
            for name in names:
                module.get_function(name).linkage = "linkonce_odr"  # several entry points may contain it
            self._tidied = _by_digest(module)
        return self._tidied

    @property
    def names(self) -> list[str]:
        """The functions that the library itself defines."""
        return self._loaded[0] if self._loaded is not None else _defined_functions(self._final_module)

    def finalize(self) -> None:
        """Generate machine code."""
        self._raise_if_finalized()
        names = self.names
        parts = self.parts().values()
        self._replaced = _joined(parts)
        for part in self._part().values() if self._loaded is not None else ():
            if defined := [name for name, declared in part.functions if name in names and not declared]:
                copy = part.module.clone()  # LLVM links a function without callers only if it is external
                for name in defined:
                    copy.get_function(name).linkage = "external"
                self._final_module.link_in(copy)
        at = {name: part.module for part in parts for name, declared in part.functions if not declared}
        counting = at.get(COUNTING)
        at = {name: part for name, part in at.items() if part is not counting}
        while needed := dict.fromkeys(
            at[f.name] for f in self._final_module.functions if f.is_declaration and f.name in at
        ):
            for part in needed:  # LLVM links only the functions that are called
                self._final_module.link_in(part, preserve=True)
        for name in names:
            self._final_module.get_function(name).linkage = "external"
        self._optimize(counting)
        self._final_module.verify()
        self._finalize_final_module()

    def _optimize(self, counting: Any) -> None:
        """The passes of `_optimize_final_module`. After the first, which removes superfluous counts, the functions of
        the module `counting` are inlined, so that nothing remains of counts for arrays in records, which have no owner:
        a tick of ReducedFE takes 9 % less time."""
        generator = self._codegen
        passes, builder = generator._module_pass_manager(
            loop_vectorize=generator._loopvect, slp_vectorize=False, opt=generator._opt_level, cost="cheap"
        )
        passes.run(self._final_module, builder)
        if counting is not None:
            self._final_module.link_in(llvm.parse_assembly(str(counting).replace("noinline", "alwaysinline")))
        passes, builder = generator._module_pass_manager()
        passes.run(self._final_module, builder)

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        self._codegen.register_code(*_names(self._final_module))

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function of this library, or 0. The first request generates machine code."""
        return super().get_pointer_to_function(name) if self._finalized or self._has(name) else 0

    def _has(self, name: str) -> bool:
        if self._loaded is not None:
            return name in self._loaded[0]
        try:
            return not self._final_module.get_function(name).is_declaration
        except NameError:
            return False

    def serialize_using_object_code(self) -> Any:
        """The content of the cache file: machine code if it was generated, else IR."""
        if self._finalized:
            return self.name, "object", (self._get_compiled_object(), _names(self._final_module))
        return self.name, "parts", (self.names, {digest: part.bitcode for digest, part in self.parts().items()})

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, (content, more) = state
        library = codegen.create_library(name)
        if kind == "parts":
            known = codegen.parts
            for digest, bitcode in more.items():
                if digest not in known:
                    known[digest] = Part(llvm.parse_bitcode(bitcode), bitcode)
            library._loaded = content, {digest: known[digest] for digest in more}
            return library
        library.enable_object_caching()
        library._set_compiled_object(content)
        library._finalize_final_module()
        codegen.register_code(*more)
        return library


def _by_digest(module: Any) -> dict[str, Part]:
    part = Part(module)
    return {part.digest: part}


def _defined_functions(module: Any) -> list[str]:
    return [f.name for f in module.functions if not f.is_declaration and f.linkage == llvm.Linkage.external]


def _joined(parts: Iterable[Part]) -> frozenset[str]:
    return frozenset(name for part in parts for name in part.replaced)


def _replaced(names: Iterable[str]) -> frozenset[str]:
    return frozenset(name.removeprefix(REPLACEMENT) for name in names if name.startswith(REPLACEMENT))


def _names(module: Any) -> tuple[list[str], list[str]]:
    """Functions that a module defines, and environments."""
    environments = [v.name for v in module.global_variables if v.name.startswith(ENVIRONMENT)]
    return [f.name for f in module.functions if not f.is_declaration], environments


class Codegen(JITCPUCodegen):
    """numba's code generator for this process, with machine code for entry points only."""

    _library_class = Library

    def __init__(self, module_name: str) -> None:
        super().__init__(module_name)
        self.parts: dict[str, Part] = {}  # those that were loaded, by the hash of their content
        self._environments: set[str] = set()

    def register_code(self, functions: list[str], environments: list[str]) -> None:
        """Register machine code of these functions, which reads these environments."""
        self._engine._defined_symbols.update(functions)
        self._environments.update(environments)
        for name in environments:
            if (environment := lookup_environment(name)) is not None:
                super().set_env(name, environment)

    def set_env(self, env_name: str, env: Any) -> None:
        """Set an environment for machine code; for IR this happens when machine code is generated."""
        if env_name in self._environments:
            super().set_env(env_name, env)

    def tidy(self, module: Any) -> None:
        """Remove unused IR, such as the Python objects of functions."""
        builder = llvm.create_pass_builder(self._tm, llvm.create_pipeline_tuning_options(speed_level=0))
        passes = llvm.create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        passes.add_dead_code_elimination_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(module, builder)
