"""Machine code of kernels: optimised and generated once for each entry point, together with all that it calls.

numba generates machine code for each function as soon as it is compiled, and optimises it again in each caller. A
function that only kernels call needs no machine code of its own: here it stays LLVM IR until something asks for its
address. On disk an entry point is machine code, and a function for kernels is IR.
"""

import hashlib
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.environment import lookup_environment

ENVIRONMENT = "_ZN08NumbaEnv"  # How names of numba's environments begin
DYNAMIC = "numba.dynamic.globals"  # and of objects that code refers to


class Library(JITCodeLibrary):
    """The code of one function."""

    _codegen: Any
    _loaded: tuple[list[str], dict[str, Any]] | None = None
    """Of IR from disk: names of its functions, and the parts."""
    _own: dict[str, Any] | None = None

    def add_linking_library(self, library: Any) -> None:
        """Add a function that this one calls."""
        if library not in self._linking_libraries:
            self._reload_init.update(library._reload_init)
            self._linking_libraries.append(library)

    def _optimize_functions(self, ll_module: Any) -> None:
        """Leave it to the passes over the whole of an entry point."""
        ll_module.data_layout = self._codegen._data_layout

    def parts(self) -> dict[str, Any]:
        """IR of the function and of all that it calls: modules by a hash of their content."""
        found: dict[str, Any] = {}
        for library in self._all():
            found |= library._part() if isinstance(library, Library) else _part(library._get_module_for_linking())
        return found

    def _all(self) -> list[Any]:
        """Itself and the libraries of all functions that it calls, and that they call."""
        found: list[Any] = [self]
        for library in found:
            if isinstance(library, Library):
                found += [each for each in library._linking_libraries if each not in found]
        return found

    @property
    def has_dynamic_globals(self) -> bool:
        """Whether code refers to an object of this process, so that it cannot be kept on disk."""
        if self._finalized:
            return super().has_dynamic_globals
        return any(v.name.startswith(DYNAMIC) for part in self.parts().values() for v in part.global_variables)

    def _part(self) -> dict[str, Any]:
        if self._loaded is not None:
            return self._loaded[1]
        if self._own is None:
            module = self._final_module.clone()
            names = [f.name for f in module.functions if not f.is_declaration]
            for name in names:
                module.get_function(name).linkage = "external"  # nothing here may use it, but a caller
            self._codegen.tidy(module)
            for name in names:
                module.get_function(name).linkage = "linkonce_odr"  # several entry points may contain it
            self._own = _part(module)
        return self._own

    def finalize(self) -> None:
        """Generate machine code."""
        self._raise_if_finalized()
        names = self._loaded[0] if self._loaded is not None else _defined(self._final_module)
        parts = self.parts().values()
        for part in self._part().values() if self._loaded is not None else ():
            if own := [f.name for f in part.functions if f.name in names and not f.is_declaration]:
                copy = part.clone()  # of functions that nothing calls LLVM takes those that are external
                for name in own:
                    copy.get_function(name).linkage = "external"
                self._final_module.link_in(copy)
        at = {f.name: part for part in parts for f in part.functions if not f.is_declaration}
        while needed := dict.fromkeys(
            at[f.name] for f in self._final_module.functions if f.is_declaration and f.name in at
        ):
            for part in needed:  # of which LLVM takes only functions that are called
                self._final_module.link_in(part, preserve=True)
        for name in names:
            self._final_module.get_function(name).linkage = "external"
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        self._codegen.found(*_names(self._final_module))

    def get_pointer_to_function(self, name: str) -> int:
        """Address of one of its functions, 0 where it has none of this name. The first one makes machine code."""
        return super().get_pointer_to_function(name) if self._finalized or self._has(name) else 0

    def _has(self, name: str) -> bool:
        if self._loaded is not None:
            return name in self._loaded[0]
        try:
            return not self._final_module.get_function(name).is_declaration
        except NameError:
            return False

    def serialize_using_object_code(self) -> Any:
        """What is kept on disk: machine code if it was made, else IR."""
        if self._finalized:
            return self.name, "object", (self._get_compiled_object(), _names(self._final_module))
        return (
            self.name,
            "parts",
            (_defined(self._final_module), {digest: part.as_bitcode() for digest, part in self.parts().items()}),
        )

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, (content, more) = state
        library = codegen.create_library(name)
        if kind == "parts":
            known = codegen.parts
            for digest, bitcode in more.items():
                if digest not in known:
                    known[digest] = llvm.parse_bitcode(bitcode)
            library._loaded = content, {digest: known[digest] for digest in more}
            return library
        library.enable_object_caching()
        library._set_compiled_object(content)
        library._finalize_final_module()
        codegen.found(*more)
        return library


def _part(module: Any) -> dict[str, Any]:
    return {hashlib.sha256(module.as_bitcode()).hexdigest(): module}


def _defined(module: Any) -> list[str]:
    return [f.name for f in module.functions if not f.is_declaration and f.linkage == llvm.Linkage.external]


def _names(module: Any) -> tuple[list[str], list[str]]:
    """Functions of a module that others see, and environments."""
    environments = [v.name for v in module.global_variables if v.name.startswith(ENVIRONMENT)]
    return [f.name for f in module.functions if not f.is_declaration], environments


class Codegen(JITCPUCodegen):
    """numba's code generator for this process, with machine code for entry points only."""

    _library_class = Library

    def __init__(self, module_name: str) -> None:
        super().__init__(module_name)
        self.parts: dict[str, Any] = {}  # modules that were loaded, by a hash of their content
        self._environments: set[str] = set()

    def found(self, functions: list[str], environments: list[str]) -> None:
        """There is machine code of these functions now, which reads these environments."""
        self._engine._defined_symbols.update(functions)
        self._environments.update(environments)
        for name in environments:
            if (environment := lookup_environment(name)) is not None:
                super().set_env(name, environment)

    def set_env(self, env_name: str, env: Any) -> None:
        """Let machine code find an environment; what is IR finds it when it is machine code."""
        if env_name in self._environments:
            super().set_env(env_name, env)

    def tidy(self, module: Any) -> None:
        """Drop from IR what nothing uses, as the objects that stand for functions."""
        builder = llvm.create_pass_builder(self._tm, llvm.create_pipeline_tuning_options(speed_level=0))
        passes = llvm.create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        passes.add_dead_code_elimination_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(module, builder)
