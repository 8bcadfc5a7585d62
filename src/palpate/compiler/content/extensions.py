"""What extends numba from outside: `overload`, `overload_method`, `overload_attribute` and lowering.

A kernel that calls an extended function or method depends on its implementation, which it does not name. What is
registered below the level of functions (types, templates, lowering) counts by the text of its file, for all kernels
outside palpate.
"""

from collections import defaultdict
from typing import Any

from numba.core.imputils import builtin_registry as lowering
from numba.core.typing.templates import builtin_registry as typing

from palpate.compiler.content.origin import is_library, is_library_function

PACKAGE = __name__.partition(".")[0]


class Extensions:
    """What is registered with numba so far.

    functions  implementations by the identity of the function that they extend
    names      implementations by the name of the attribute or method
    files      modules that register something else
    """

    def __init__(self) -> None:
        self.functions: defaultdict[int, list[Any]] = defaultdict(list)
        self.names: defaultdict[str, list[Any]] = defaultdict(list)
        self.files: dict[str, None] = {}
        self._kept: list[Any] = []  # so that no identity is used again
        self._read = (0, 0, 0)

    def update(self) -> bool:
        """Read new registrations. Returns whether there are foreign ones among them."""
        lists = typing.globals, typing.attributes, lowering.functions
        if (counts := tuple(map(len, lists))) == self._read:
            return False
        before = len(self._kept)
        for function, form in typing.globals[self._read[0] :]:
            for template in getattr(form, "templates", ()):
                if hasattr(template, "_overload_func"):
                    self._add(self.functions, id(function), template._overload_func, function)
                elif not hasattr(template, "_definition_func"):  # an intrinsic, which is described by its definition
                    self._add_file(template)
        for template in typing.attributes[self._read[1] :]:
            if hasattr(template, "_overload_func"):
                self._add(self.names, template._attr, template._overload_func, template)
            else:
                self._add_file(template)
        for implementation, *_ in lowering.functions[self._read[2] :]:
            self._add_file(implementation)
        self._read = counts  # type: ignore[assignment]
        return len(self._kept) > before

    def _add(self, table: defaultdict[Any, list[Any]], key: Any, implementation: Any, kept: Any) -> None:
        if not is_library_function(implementation):
            table[key].append(implementation)
            self._kept.append(kept)

    def _add_file(self, found: Any) -> None:
        module = getattr(found, "__globals__", {}).get("__name__") or getattr(found, "__module__", None)
        if module is not None and not is_library(module) and not module.startswith(f"{PACKAGE}."):
            self.files[module] = None
            self._kept.append(found)
