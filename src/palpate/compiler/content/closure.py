"""A kernel with everything that its code depends on: the functions that it calls, directly and indirectly, their
constants, classes and attributes of modules, and the functions that replace those of the C library.

Each function is described by itself and refers to others by number, so that functions that call one another have a
hash too. Descriptions are kept; they are read again after a change of a value that they name.
"""

import hashlib
import sys
from collections.abc import Callable, Iterable, Sequence
from types import FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core.extending import _Intrinsic
from numba.extending import is_jitted

from palpate.compiler.content.bytecode import read_code
from palpate.compiler.content.extensions import PACKAGE, Extensions
from palpate.compiler.content.origin import UnnamedError, is_library, name_of, text_of
from palpate.compiler.content.values import Values
from palpate.compiler.target.deferred import made

_ALIASES = {"arctan2": "atan2", "arccos": "acos", "arcsin": "asin", "power": "pow", "float_power": "pow"}
"""numpy's names of functions of the C library."""
_MISSING = object()
_SKIPPED = {"__doc__", "__module__", "__dict__", "__weakref__", "__firstlineno__", "__static_attributes__"}
_GENERATED = {"__new__", "__slots__", "__getnewargs__", "__match_args__", "_make", "_replace", "_asdict", "__replace__"}
"""Members of the class of a NamedTuple that follow from its fields; it cannot define them."""
_KNOWN: dict[int, "Description"] = {}
_EXTENSIONS = Extensions()


class Description(NamedTuple):
    """What something does, without the other things that it uses.

    of       the thing itself, which stays in memory with its description
    text     hash of its data
    uses     functions, classes, modules and objects that it refers to
    calls    functions of the C library that it may call
    seen     (namespace, name, value) for each value that it read by a name
    parts    (object, attribute, value) for code, defaults and variables of the enclosing function
    mutable  each value that can change in place, with its data or a copy
    compiled  whether numba compiles it
    kept     whether the description can be used again; not that of an object with a state
    """

    of: Any
    text: bytes
    uses: tuple[Any, ...]
    calls: frozenset[str]
    seen: tuple[tuple[Any, str, Any], ...]
    parts: tuple[tuple[Any, str, Any], ...]
    mutable: tuple[tuple[Any, Any], ...]
    compiled: bool
    kept: bool

    def is_current(self) -> bool:
        """Whether all values are still those that were read."""
        if not self.kept or any(namespace.get(name, _MISSING) is not value for namespace, name, value in self.seen):
            return False
        if any(getattr(thing, name, _MISSING) is not value for thing, name, value in self.parts):
            return False
        return all(
            value == known if type(known) is dict else Values(self.compiled).data(value) == known
            for value, known in self.mutable
        )


def digest(
    things: Sequence[Any], replacement: Callable[[str], Any], called: Iterable[str] = ()
) -> tuple[str, frozenset[str]]:
    """A hash of all that the code of kernels depends on, except the types of their arguments, and the functions of the
    C library that count. UnnamedError: one of them refers to an object of this process.

    things       kernels, and classes or functions that are arguments of them
    replacement  the kernel that replaces a function of the C library, or None
    called       functions of the C library that count in addition to those that the code names
    """
    if _EXTENSIONS.update():
        _KNOWN.clear()
    places: dict[int, int] = {}
    found: list[Any] = []

    def place(thing: Any) -> int:
        thing = made(thing)
        if id(thing) not in places:
            places[id(thing)] = len(found)
            found.append(thing)
        return places[id(thing)]

    def replace(names: Iterable[str]) -> list[tuple[str, int]]:
        replaced = [(name, replacement(name)) for name in sorted(names)]
        replacing.update(name for name, kernel in replaced if kernel is not None)
        return [(name, place(kernel)) for name, kernel in replaced if kernel is not None]

    replacing: set[str] = set()
    hasher = hashlib.sha256(repr(([*map(place, things)], replace(called))).encode())
    for thing in found:
        description = describe(thing)
        hasher.update(description.text)
        hasher.update(repr((replace(description.calls), [*map(place, description.uses)])).encode())
    return hasher.hexdigest(), frozenset(replacing)


def describe(thing: Any) -> Description:
    """The description of a function, a class, a module or another object."""
    thing = made(thing)
    known = _KNOWN.get(id(thing))
    if known is None or not known.is_current():
        known = _KNOWN[id(thing)] = _Reader(thing).description()
    return known


class _Reader:
    """Reads one thing."""

    def __init__(self, thing: Any) -> None:
        compiled = is_jitted(thing)
        self._thing, self._values = thing, Values(compiled)
        self._seen: list[tuple[Any, str, Any]] = []
        self._parts: list[tuple[Any, str, Any]] = []
        self._calls: set[str] = set()
        self._kept = True

    def description(self) -> Description:
        """Everything about the thing."""
        data = self._data()
        found = self._values
        text = hashlib.sha256(repr(data).encode()).digest()
        return Description(
            self._thing, text, tuple(found.uses), frozenset(self._calls), tuple(self._seen), tuple(self._parts),
            tuple(found.mutable), found.compiled, self._kept,
        )  # fmt: skip

    def _data(self) -> Any:
        thing = self._thing
        if is_jitted(thing):
            self._parts += [(thing, name, getattr(thing, name)) for name in ("targetoptions", "locals", "py_func")]
            options = self._values.data(thing.targetoptions), self._values.data(thing.locals)
            return ("kernel", options, self._function(thing.py_func))
        if isinstance(thing, _Intrinsic):
            options = self._values.data({**thing._ctor_kwargs, "literal": thing._prefer_literal})
            return ("intrinsic", options, self._function(thing._defn))
        if isinstance(thing, FunctionType):
            return ("function", self._function(thing))
        if isinstance(thing, ModuleType):
            return ("module", thing.__name__, text_of(thing.__name__))
        if isinstance(thing, type):
            return self._class(thing)
        return self._object(thing)

    def _function(self, function: Any) -> Any:
        """Code, defaults, variables of the enclosing function, and global names with their attributes."""
        code, value = read_code(function.__code__), self._values.data
        self._parts += [
            (function, name, getattr(function, name)) for name in ("__code__", "__defaults__", "__kwdefaults__")
        ]
        closure = function.__closure__ or ()
        self._parts += [(cell, "cell_contents", getattr(cell, "cell_contents", _MISSING)) for cell in closure]
        if code.power:
            self._calls.add("pow")
        named = [(path, self._named(path, function, code.names)) for path in code.paths]
        cells = [self._bare(getattr(cell, "cell_contents", None), code.names) for cell in closure]
        imported = [(name, self._bare(sys.modules.get(name), code.names)) for name in code.imports]
        defaults = value(function.__defaults__), value(function.__kwdefaults__)
        extended = [value(each) for name in sorted(code.names) for each in _EXTENSIONS.names.get(name, ())]
        if not str(function.__module__).startswith(f"{PACKAGE}."):
            extended += [(name, text_of(name)) for name in _EXTENSIONS.files]
        return (*name_of(function), code.digest, named, cells, imported, defaults, extended)

    def _named(self, path: tuple[str, ...], function: Any, names: frozenset[str]) -> Any:
        """The value of a global name, or of the attribute that is read from a module or class of this name."""
        namespace = function.__globals__
        found = namespace.get(path[0], _MISSING)
        self._seen.append((namespace, path[0], found))
        if found is _MISSING:
            built_in = namespace.get("__builtins__", {})
            built_in = vars(built_in) if isinstance(built_in, ModuleType) else built_in
            if path[0] == "pow":
                self._calls.add("pow")
            return ("missing",) if path[0] not in built_in else self._extended(built_in[path[0]])
        for number, name in enumerate(path[1:], 1):
            if isinstance(found, ModuleType) and is_library(found.__name__):
                return self._of_library(found, path[number:])
            if isinstance(found, ModuleType):
                inside: Any = vars(found)
            elif isinstance(found, type) and not is_library(found.__module__):
                inside = next((vars(base) for base in found.__mro__ if name in vars(base)), vars(found))
            else:
                break
            self._seen.append((inside, name, inside.get(name, _MISSING)))
            found = getattr(found, name, _MISSING)
            if found is _MISSING:
                return ("missing",)
        return self._bare(found, names)

    def _of_library(self, module: ModuleType, path: tuple[str, ...]) -> Any:
        """What a module of a library has under a name: by itself, because a module may have two names."""
        value: Any = module
        for name in path:
            value = getattr(value, name, _MISSING)
            if not isinstance(value, ModuleType):
                break
        whole = None if value is _MISSING else self._values.whole(value)
        return self._with_extensions(value, ("of", module.__name__, *path) if whole is None else whole)

    def _bare(self, value: Any, names: frozenset[str]) -> Any:
        """A value; of a module as a whole also what the function may read from it."""
        if isinstance(value, ModuleType) and not is_library(value.__name__):
            found = vars(value)
            read = sorted(names & found.keys())
            self._seen += [(found, name, found[name]) for name in read]
            inside = [
                (name, self._values.data(found[name])) for name in read if not isinstance(found[name], ModuleType)
            ]
            return ("module", self._values.data(value), inside)
        return self._extended(value)

    def _extended(self, value: Any) -> Any:
        return self._with_extensions(value, self._values.data(value))

    def _with_extensions(self, value: Any, data: Any) -> Any:
        """A value with its implementations for numba from outside, and the function of the C library that it calls."""
        value = made(value)
        module, name = getattr(value, "__module__", None), getattr(value, "__name__", None)
        if isinstance(value, np.ufunc) or module in ("math", "cmath", "numpy"):
            self._calls.add(_ALIASES.get(name, name))  # type: ignore[arg-type]
        extended = _EXTENSIONS.functions.get(id(value))
        return (data, *map(self._values.data, extended)) if extended else data

    def _class(self, cls: type) -> Any:
        """A class with all its members and annotations."""
        skipped = _SKIPPED | _GENERATED if "_fields" in vars(cls) else _SKIPPED
        members = [(name, value) for name, value in sorted(vars(cls).items()) if name not in skipped]
        self._seen += [(vars(cls), name, value) for name, value in members]
        bases = [self._values.data(base) for base in cls.__bases__]
        data = [(name, self._values.data(value)) for name, value in members]  # a dict of annotations may change
        return ("class", *name_of(cls), self._values.data(type(cls)), bases, data, self._hints(cls))

    def _hints(self, cls: type) -> Any:
        from typing import get_type_hints

        try:
            hints = get_type_hints(cls, include_extras=True)
        except Exception:  # a name that exists only for the type checker
            hints = dict(vars(cls).get("__annotations__", {}))
        return [(name, self._values.data(hint)) for name, hint in hints.items()]

    def _object(self, thing: Any) -> Any:
        """An object by its class and state; UnnamedError: its state is hidden."""
        if isinstance(wrapped := getattr(thing, "__wrapped__", None), FunctionType):
            options = repr(getattr(thing, "targetoptions", None))
            return ("wrapped", *name_of(type(thing)), options, self._values.data(wrapped))
        state = dict(getattr(thing, "__dict__", {}))
        for cls in type(thing).__mro__:
            slots = vars(cls).get("__slots__", ())
            for name in (slots,) if isinstance(slots, str) else slots:
                if name not in ("__dict__", "__weakref__") and hasattr(thing, name):
                    state[name] = getattr(thing, name)
        if not state:
            text = repr(thing)
            if " at 0x" in text:
                raise UnnamedError(f"{text} cannot be described")
            return ("object", self._values.data(type(thing)), text)
        self._kept = False
        return ("object", self._values.data(type(thing)), self._values.data(state))
