"""Values that a kernel refers to, as plain data without addresses: equal data mean equal compiled code.

What refers to other things, such as a function, is not resolved here: it becomes a number in `Values.uses`.
"""

import collections
import enum
import functools
import hashlib
import types
import typing
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir

from palpate.compiler.content.origin import is_library, is_library_function, name_of
from palpate.compiler.generators.in_record import InRecord
from palpate.compiler.target.deferred import made

Type = numba.types.Type
PLAIN = (bool, int, float, complex, str, bytes, type(None), type(...), type(NotImplemented), range, slice)
BUILTIN = (
    types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType, types.MethodWrapperType,
    types.ClassMethodDescriptorType, types.GetSetDescriptorType, types.MemberDescriptorType, np.ufunc,
)  # fmt: skip
_Field: Any = type(vars(collections.namedtuple("_Example", "field"))["field"])
_TYPES: dict[int, tuple[Type, Any]] = {}  # numba's types that depend on nothing else, by identity


def is_record_class(value: Any) -> bool:
    """Whether this is the class of a NamedTuple."""
    return isinstance(value, type) and issubclass(value, tuple) and hasattr(value, "_fields")


class Values:
    """Data of the values of one function.

    compiled  whether numba compiles it, so that it sees only fields of a NamedTuple, and not its methods
    uses      functions, classes, modules and other objects that the data refer to by number
    mutable   values that can change in place, with their data; a dict of plain values with a copy
    """

    def __init__(self, compiled: bool) -> None:
        self.compiled = compiled
        self.uses: list[Any] = []
        self.mutable: list[tuple[Any, Any]] = []

    def refer(self, value: Any) -> Any:
        """The data of something that is described by itself."""
        for number, known in enumerate(self.uses):
            if known is value:
                return ("use", number)
        self.uses.append(value)
        return ("use", len(self.uses) - 1)

    def data(self, value: Any) -> Any:
        """The data of a value; of a deferred function that of its compiled form."""
        value = made(value)
        data = self.whole(value)
        return self.refer(value) if data is None else data

    def whole(self, value: Any) -> Any:
        """The data of a value that needs no description by itself; None: it does."""
        value = made(value)
        kind = type(value)
        if kind in PLAIN:
            return (kind.__name__, repr(value))
        describe = _DESCRIBE.get(kind)
        if describe is None:
            describe = next((form for classes, form in _FORMS if issubclass(kind, classes)), Values._other)
            _DESCRIBE[kind] = describe
        return describe(self, value)

    def _other(self, value: Any) -> Any:
        """A compiled function or an intrinsic of a library."""
        name = getattr(value, "__qualname__", None)
        return ("of", *name_of(value)) if name and "<" not in name and is_library(value.__module__) else None

    def _sequence(self, value: Any) -> Any:
        kind = self.data(type(value)) if type(value) not in (tuple, list) else type(value).__name__
        return self._changing(value, (kind, *map(self.data, value)))

    def _set(self, value: Any) -> Any:
        return self._changing(value, (type(value).__name__, *sorted(map(repr, map(self.data, value)))))

    def _dict(self, value: Any) -> Any:
        data = ("dict", *((self.data(name), self.data(each)) for name, each in value.items()))
        plain = all(type(each) in PLAIN for each in value.values())
        self.mutable.append((value, dict(value) if plain else data))
        return data

    def _changing(self, value: Any, data: Any) -> Any:
        if not isinstance(value, tuple | frozenset):
            self.mutable.append((value, data))
        return data

    def _dtype(self, value: np.dtype) -> Any:
        form: Any = value.str if value.subdtype is None else (self._dtype(value.subdtype[0]), value.subdtype[1])
        if value.names is None:
            return ("dtype", form, value.itemsize)
        fields = [(name, self._dtype(found[0]), *found[1:]) for name, found in value.fields.items()]  # type: ignore
        return ("dtype", value.type.__name__, value.itemsize, value.isalignedstruct, value.alignment, *fields)

    def _array(self, value: np.ndarray) -> Any:
        if value.dtype.hasobject:
            return ("objects", value.shape, *map(self.data, value.ravel().tolist()))
        text = hashlib.sha256(value.tobytes()).hexdigest()
        flags = value.flags.c_contiguous, value.flags.f_contiguous
        return self._changing(value, ("array", self._dtype(value.dtype), value.shape, value.strides, flags, text))

    def _number(self, value: np.generic) -> Any:
        return ("number", self._dtype(value.dtype), value.tobytes())

    def _member(self, value: enum.Enum) -> Any:
        return ("member", *name_of(type(value)), value.name, self.data(value.value))

    def _module(self, value: types.ModuleType) -> Any:
        return ("module", value.__name__) if is_library(value.__name__) else None

    def _class(self, value: type) -> Any:
        if is_library(value.__module__) or value is InRecord:  # its file counts for all kernels (`code_cache`)
            return ("of", *name_of(value))
        if issubclass(value, enum.Enum):
            return ("members", *name_of(value), *((name, self.data(m.value)) for name, m in value.__members__.items()))
        if self.compiled and is_record_class(value):
            defaults = sorted(value._field_defaults.items())  # type: ignore[attr-defined]
            return ("fields", *name_of(value), value._fields, self.data(tuple(defaults)))  # type: ignore[attr-defined]
        if self.compiled and issubclass(value, BaseException):
            return ("raised", *name_of(value))
        return None

    def _ir(self, value: ir.Type) -> Any:
        return ("ir", str(value))

    def _type(self, value: Type) -> Any:
        """A type of numba: its key, which may contain classes and functions."""
        known = _TYPES.get(id(value))
        if known is not None:
            return known[1]
        if isinstance(value, InRecord):
            return ("type", InRecord.__name__, value.key)
        if not is_library(type(value).__module__):
            return ("type", self.refer(type(value)), self.data(value.key))
        if (dispatcher := getattr(value, "dispatcher", None)) is not None:
            return ("type", type(value).__name__, self.data(dispatcher))
        uses, mutable = len(self.uses), len(self.mutable)
        data = ("type", type(value).__name__, value.key if isinstance(value.key, str) else self.data(value.key))
        if (len(self.uses), len(self.mutable)) == (uses, mutable):
            _TYPES[id(value)] = value, data
        return data

    def _function(self, value: types.FunctionType) -> Any:
        """A function of a library, unless it encloses other values, which its name does not determine."""
        return ("of", *name_of(value)) if value.__closure__ is None and is_library_function(value) else None

    def _builtin(self, value: Any) -> Any:
        owner = getattr(value, "__self__", None)
        bound = None if owner is None or isinstance(owner, types.ModuleType | type) else self.data(owner)
        return ("of", *name_of(value), bound)

    def _field(self, value: Any) -> Any:
        return ("field", repr(value))

    def _partial(self, value: Any) -> Any:
        return ("partial", self.data(value.func), self.data(value.args), self.data(value.keywords))

    def _method(self, value: Any) -> Any:
        return ("method", self.data(value.__func__), self.data(value.__self__))

    def _wrapping(self, value: Any) -> Any:
        return (type(value).__name__, self.data(value.__func__))

    def _property(self, value: property) -> Any:
        return ("property", *map(self.data, (value.fget, value.fset, value.fdel)))

    def _hint(self, value: Any) -> Any:
        """A type hint with arguments: `Annotated[np.ndarray, "<f8", 2]`."""
        origin = typing.get_origin(value)
        if origin is None:
            return ("hint", repr(value)) if is_library(type(value).__module__) and " at 0x" not in repr(value) else None
        given = typing.get_args(value)
        return ("hint", self.data(origin), *map(self.data, given))


def _hint_classes() -> tuple[type, ...]:
    """The classes of type hints with arguments, and of special ones."""
    examples: list[Any] = [typing.Annotated[int, ""], list[int], int | str, typing.Any, typing.Union]
    classes = {cls for each in examples for cls in type(each).__mro__}
    return (*(classes - {object, type}), typing.TypeVar)


_FORMS: list[tuple[Any, Callable[[Values, Any], Any]]] = [
    (enum.Enum, Values._member),
    (tuple | list, Values._sequence),
    (set | frozenset, Values._set),
    (dict, Values._dict),
    (np.ndarray, Values._array),
    (np.generic, Values._number),
    (np.dtype, Values._dtype),
    (Type, Values._type),
    (ir.Type, Values._ir),
    (_hint_classes(), Values._hint),
    (type, Values._class),
    (types.ModuleType, Values._module),
    (types.FunctionType, Values._function),
    (BUILTIN, Values._builtin),
    (_Field, Values._field),
    (functools.partial, Values._partial),
    (types.MethodType, Values._method),
    ((staticmethod, classmethod), Values._wrapping),
    (property, Values._property),
]
"""How values of a class are described, by the first that fits; None: by itself."""
_DESCRIBE: dict[type, Callable[[Values, Any], Any]] = {}
