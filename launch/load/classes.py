"""Node classes by their name in `use:`, and the catalogue of shipped and registered classes."""

import importlib
import importlib.util
import os
import traceback
from collections.abc import Iterable
from functools import lru_cache
from types import ModuleType, UnionType
from typing import Any, Literal, NamedTuple, Union, get_args, get_origin

import palpate.nodes
from palpate.engine.faults import choices, nearest
from palpate.engine.graph import sent_by
from palpate.engine.imports import search_here
from palpate.messages import Message, fields
from palpate.messages.base import HEADER
from palpate.messages.docs import summary
from palpate.nodes.base import CompiledNode, Effect, Node, Observer, effects, inputs, outputs, settings
from palpate.nodes.base.effect import switch
from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.extras import extra_of, missing
from palpate.registry import collection_suspended, declared_classes, files, registered_modules

SHIPPED = palpate.nodes.__name__


class ClassError(PalpateError, ValueError):
    """A `use:` without a usable node class; `cure` says what would work."""

    exit_code = MISUSE

    def __init__(self, text: str, cure: str = "") -> None:
        super().__init__(text)
        self.cure = cure


class Entry(NamedTuple):
    """One node class of the catalogue and the name to write in `use:`."""

    use: str
    cls: type[Node]


def find_class(use: str, sends: Iterable[type[Message]] = ()) -> type[Node]:
    """The node class that `use:` names: a shipped one such as `contact.Series`, or a full dotted name.

    sends  message types that the graph expects from it: the error lists classes that send them. Read only for an error

    ClassError: module, class or a package missing, not a node, or the class is malformed.
    """
    module_name, _, name = use.rpartition(".")
    if not module_name or not all(part.isidentifier() for part in use.split(".")):
        raise ClassError(f"use: found {use!r}, expected module.Class such as contact.Series", _fitting(use, sends))
    module = _module(use, module_name, sends)
    try:
        cls = getattr(module, name, None)
    except ImportError as error:
        raise _missing(use, error) from None
    if cls is None:
        known, kinds = [c.__name__ for c in classes(module)], list(sends)
        close = choices(f"{module_name} has", name, known)
        more = "" if close.startswith("Did you mean") and not kinds else _fitting(use, kinds)
        raise ClassError(f"use: {module_name!r} has no class {name!r}", f"{close} {more}".strip())
    if not (isinstance(cls, type) and issubclass(cls, Node)):
        what = f"the class {cls.__name__}" if isinstance(cls, type) else f"a {type(cls).__name__}"
        raise ClassError(f"use: {use!r} is {what}, expected a subclass of palpate.nodes.Node", _fitting(use, sends))
    _check(use, cls)
    return cls


def is_shipped(module: str) -> bool:
    """Whether palpate ships a module that `use:` names. Shipped modules take precedence."""
    return importlib.util.find_spec(f"{SHIPPED}.{module.partition('.')[0]}") is not None


def _module(use: str, name: str, sends: Iterable[type[Message]]) -> ModuleType:
    shipped = is_shipped(name)
    here = os.getcwd() if shipped else search_here()
    full = f"{SHIPPED}.{name}" if shipped else name
    try:
        with collection_suspended():
            return importlib.import_module(full)
    except ModuleNotFoundError as error:
        if error.name is not None and (full == error.name or full.startswith(error.name + ".")):
            entries, missed = catalogue()  # includes modules that cannot be imported without an extra
            modules = sorted({entry.use.rpartition(".")[0] for entry in entries} | set(missed))
            known = choices("Modules of palpate", name.partition(".")[0], modules)
            cure = f"{known} Looked in {here} and on the Python path."
            text = f"use: {use!r}: module {name!r} not found"
            raise ClassError(text, f"{cure} {_fitting(use, sends)}".strip()) from None
        raise _missing(use, error) from None
    except ImportError as error:
        raise _missing(use, error) from None
    except (Exception, SystemExit) as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        at = (error.filename, error.lineno) if isinstance(error, SyntaxError) else (last.filename, last.lineno)
        text = f"use: importing {name!r} failed: {type(error).__name__}: {error} ({at[0]}:{at[1]})"
        raise ClassError(text) from None


def _missing(use: str, error: ImportError) -> ClassError:
    extra = extra_of(error.name or "")
    if extra:
        return ClassError(missing(f"use: {use!r}", error.name, extra))
    return ClassError(f"use: {use!r} cannot be imported: {error}")


def _check(use: str, cls: type[Node]) -> None:
    """Read ports and settings once. ClassError: the class is malformed."""
    try:
        settings(cls)
        if issubclass(cls, Observer):
            return
        if not _works(cls):
            raise TypeError(f"{cls.__name__} has no {'compute' if issubclass(cls, CompiledNode) else 'step'}")
        for port in inputs(cls):
            odd = port.wants - set(port.type.__struct_fields__)
            if odd:
                known = [f.name for f in fields(port.type)]
                cure = choices(f"Fields of {port.type.__name__}", min(odd), known)
                raise TypeError(
                    f"input {port.name!r} wants the field {min(odd)!r}, which {port.type.__name__} lacks. {cure}"
                )
        sent = [m.__name__ for m in outputs(cls)]
        if len(set(sent)) < len(sent):
            raise TypeError(f"{cls.__name__} sends the same message type twice: {', '.join(sent)}")
    except (TypeError, NameError, AttributeError) as error:
        raise ClassError(f"use: {use!r} is not well formed: {error}", "See docs/add_a_node.md.") from None


def _works(cls: type[Node]) -> bool:
    """Whether a class defines its step; abstract base classes do not."""
    return callable(getattr(cls, "compute" if issubclass(cls, CompiledNode) else "step", None))


def body(kind: type[Message]) -> frozenset[str]:
    """The field names of a message without its header."""
    return frozenset(kind.__struct_fields__) - set(HEADER)


def classes(module: ModuleType) -> list[type[Node]]:
    """The node classes of a module, sorted by name, without palpate's base classes."""
    members = (getattr(module, name, None) for name in sorted(set(dir(module))) if not name.startswith("_"))
    kinds = [kind for kind in members if isinstance(kind, type) and issubclass(kind, Node)]
    return [kind for kind in kinds if kind not in (Node, Observer) and (issubclass(kind, Observer) or _works(kind))]


@lru_cache(maxsize=1)
def catalogue() -> tuple[tuple[Entry, ...], dict[str, str]]:
    """Shipped node classes and those of entry points in the group `palpate.nodes`, sorted by name; and the modules
    that cannot be imported, with the reason."""
    uses: dict[type[Node], str] = {}
    others, missing = registered_modules("palpate.nodes")
    for file in files(palpate.nodes):
        name = file.rpartition(".")[2]
        try:
            offered = classes(importlib.import_module(file)) if name != "base" else []
        except ImportError as error:
            missing[name] = str(error)
            continue
        for cls in offered:
            if cls.__module__.startswith(file):
                uses.setdefault(cls, f"{name}.{cls.__name__}")
    for name, module in others.items():
        try:
            for cls in declared_classes(module, Node):
                _check(f"{name}.{cls.__name__}", cls)
                uses[cls] = f"{name}.{cls.__name__}"
        except ClassError as error:
            missing[name] = f"{error}. {error.cure}"
    return tuple(Entry(use, cls) for cls, use in sorted(uses.items(), key=lambda item: item[1])), missing


def senders(kind: type[Message]) -> list[str]:
    """Names of the shipped classes that send a message type."""
    return [e.use for e in catalogue()[0] if any(issubclass(m, kind) for m in sent_by(e.cls))]


def takers(kind: type[Message], cls: type[Node]) -> list[str]:
    """Names of the shipped classes with an input that takes several messages of a type; only those that send the same
    types as `cls`, if there are any."""
    found = {e.use: e.cls for e in catalogue()[0] if not issubclass(e.cls, Observer)}
    ports = {use: inputs(cls) for use, cls in found.items()}
    several = [use for use, its_ports in ports.items() if any(p.many and p.type is kind for p in its_ports)]
    return [use for use in several if outputs(found[use]) == outputs(cls)] or several


def _fitting(use: str, sends: Iterable[type[Message]]) -> str:
    """Suggestions: the shipped classes that send the wanted types; without wanted types, those with similar names."""
    kinds = list(dict.fromkeys(sends))
    if not kinds:
        close = nearest(use, [e.use for e in catalogue()[0]])
        return f"Did you mean {' or '.join(close)}?" if close else ""
    return " ".join(f"Classes that send {k.__name__}: {', '.join(senders(k)) or 'none'}." for k in kinds)


def describe(use: str, cls: type[Node]) -> dict[str, Any]:
    """A node class as plain data: ports, settings, units, effects, first sentence of its docstring."""
    observer = issubclass(cls, Observer)
    return {
        "use": use,
        "about": summary(cls),
        "source": cls.paced,
        "sink": cls.sink,
        "observer": observer,
        "inputs": [
            {"name": p.name, "type": p.expects, "optional": p.optional, "drives": i == 0 and not cls.paced}
            for i, p in enumerate(() if observer else inputs(cls))
        ],
        "outputs": [kind.__name__ for kind in sent_by(cls)],
        "settings": [
            {"name": s.name, "unit": s.unit, "type": _type(s.type), "limits": _limits(s.type),
             "default": None if s.default is ... else s.default, "required": s.default is ...}
            for s in settings(cls).values()
        ],
        "effects": [_describe_effect(cls, effect) for effect in effects(cls)],
    }  # fmt: skip


def _describe_effect(cls: type[Node], effect: Effect) -> dict[str, Any]:
    """An effect of a class as plain data: how the class computes it (by the whole node, by a part, by a setting), the
    output fields that contain it (none listed: all), the fields of other effects that need it, and the setting that
    switches it with the number that disables it."""
    return {
        "effect": effect.name,
        "how": effect.how,
        "fields": list(effect.fields),
        "needed_by": list(effect.also),
        "setting": effect.setting or None,
        "off": switch(cls, effect).off if effect.setting else None,
        "about": effect.about,
    }


def _type(hint: Any) -> str:
    """A setting's type as a user writes it: "float", "steel or silicone", "float or none"."""
    plain = getattr(hint, "__origin__", hint) if hasattr(hint, "__metadata__") else hint
    if get_origin(plain) is Literal:
        return " or ".join(map(str, get_args(plain)))
    if get_origin(plain) in (Union, UnionType):
        return " or ".join("none" if member is type(None) else _type(member) for member in get_args(plain))
    return plain.__name__ if isinstance(plain, type) and not hasattr(plain, "__args__") else str(plain)


def _limits(hint: Any) -> str:
    """The bounds of a setting, "> 0, <= 1"."""
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "min_length": "length >=", "max_length": "length <="}
    limits = [
        (sign, getattr(meta, key, None)) for meta in getattr(hint, "__metadata__", ()) for key, sign in signs.items()
    ]
    return ", ".join(f"{sign} {limit}" for sign, limit in limits if limit is not None)
