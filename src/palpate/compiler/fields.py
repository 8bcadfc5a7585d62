"""Records with named fields, from a description of their fields: the state of a law, the constants of a law.

    STATE = {"place": (3,), "energy": (), "contact": bool, "wall": WALL}

(): a number; (3,): a vector; int, bool; a dict: a group; (16, {...}): several groups; a dtype: itself. Kernels read and
write the fields by name. A name that records of numpy have, such as `mean`, is an error: where a kernel runs in Python,
`record.mean` would be numpy's method. A NamedTuple of arrays and numbers is another description: `form`.
"""

from typing import Any, get_args, get_origin, get_type_hints

import numpy as np

KINDS: dict[type, str] = {float: "<f8", int: "<i8", bool: "?"}
"""Numbers of a record."""

TAKEN = frozenset(dir(np.record))
"""Names that a field cannot have: attributes of numpy's records, which Python finds before the field."""


def record_type(name: str, fields: dict[str, Any]) -> np.dtype:
    """The dtype of these fields. TypeError: an invalid form or name, of a field of `name`."""
    return np.dtype(field_list(name, fields), align=True)


def field_list(name: str, fields: dict[str, Any]) -> list[tuple[Any, ...]]:
    """The fields as numpy describes them. TypeError: an invalid form or name."""
    for field in filter(TAKEN.__contains__, fields):
        raise TypeError(
            f"{name}[{field!r}]: records of numpy have an attribute of this name, which hides the field; expected "
            f"another name, such as {f'{field}_value'!r}"
        )
    return [(field, *_form(f"{name}[{field!r}]", form)) for field, form in fields.items()]


def _form(name: str, form: Any) -> tuple[Any, ...]:
    if isinstance(form, dict):
        return (record_type(name, form),)
    if isinstance(form, np.dtype):
        return (form,)
    if isinstance(form, type) and form in KINDS:
        return (KINDS[form],)
    if isinstance(form, tuple) and form and isinstance(form[-1], np.dtype):
        return form[-1], form[:-1]
    if isinstance(form, tuple) and form and isinstance(form[-1], dict):
        return record_type(name, form[-1]), form[:-1]
    if isinstance(form, tuple) and all(isinstance(length, int) for length in form):
        return ("<f8", form) if form else ("<f8",)
    raise TypeError(
        f"{name}: found {form!r}, expected a shape such as () or (3,), int, bool, a dict of these for a group, "
        "(16, {...}) for several groups, or ARRAY or TABLE for an array that `start` holds"
    )


def element_type(fields: dict[str, Any]) -> np.dtype:
    """The dtype of an array of these records; in Python, the fields of its elements are also attributes."""
    return np.dtype((np.record, record_type("fields", fields)))


def blank_record(fields: dict[str, Any], **values: Any) -> Any:
    """A new record, zero except for these values, for calls of kernels from Python. Its fields are also attributes."""
    made = np.zeros(1, element_type(fields))[0]
    for name, value in values.items():
        made[name] = value
    return made


def form(kind: type) -> np.dtype:
    """The dtype of the record of a NamedTuple of numbers, tuples of numbers, NamedTuples, and arrays with element type
    and number of axes, `Annotated[np.ndarray, "<f8", 2]`."""
    return np.dtype([(name, *_member(hint)) for name, hint in members_of(kind)], align=True)


def members_of(kind: type) -> list[tuple[str, Any]]:
    """Names and type hints of the fields of a NamedTuple."""
    return list(get_type_hints(kind, include_extras=True).items())


def _member(hint: Any) -> tuple[Any, ...]:
    if hasattr(hint, "__metadata__"):
        return (np.dtype([("address", "<i8"), ("shape", "<i8", (hint.__metadata__[1],))], align=True),)
    if get_origin(hint) is tuple:
        return "<f8", (len(get_args(hint)),)
    return (KINDS[hint],) if hint in KINDS else (form(hint),)
