"""The pages of the public Python: the names of `import palpate`, and the formulas."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from prose import prose

import palpate
import palpate.physics


def public() -> str:
    """The names of `palpate.__all__`, with the methods of the classes."""
    lines = ["# palpate", "", prose(palpate.__doc__ or ""), ""]
    for name in palpate.__all__:
        thing = getattr(palpate, name)
        lines += _thing(f"palpate.{name}", thing, "##")
        if inspect.isclass(thing):
            for key in dir(thing):  # inherited ones too, by palpate's classes
                member = next((vars(one)[key] for one in thing.__mro__ if key in vars(one) and _ours(one)), None)
                member = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
                if not key.startswith("_") and inspect.isfunction(member) and member.__doc__:
                    lines += _thing(f"{name}.{key}", member, "###")
    return "\n".join(lines)


def _ours(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "palpate"


def library() -> Iterator[tuple[str, str]]:
    """A page for each folder of `palpate.physics`: every formula with its equation, units and source."""
    rooms = [info.name for info in pkgutil.iter_modules(palpate.physics.__path__) if info.ispkg]
    for room in sorted(rooms):
        package = importlib.import_module(f"palpate.physics.{room}")
        lines = [f"# palpate.physics.{room}", "", prose(package.__doc__ or ""), ""]
        for info in sorted(pkgutil.walk_packages(package.__path__, package.__name__ + "."), key=lambda one: one.name):
            module = importlib.import_module(info.name)
            lines += [f"## {info.name.removeprefix('palpate.physics.')}", "", prose(module.__doc__ or ""), ""]
            for name, thing in _own(module):
                lines += _thing(name, thing, "###")
        yield f"physics-{room}", "\n".join(lines)


def _own(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Public functions, kernels and classes of a module."""
    for name, thing in vars(module).items():
        home = getattr(getattr(thing, "py_func", thing), "__module__", None)
        if not name.startswith("_") and home == module.__name__ and callable(thing) and getattr(thing, "__doc__", None):
            yield name, thing


def _thing(name: str, thing: Any, level: str) -> list[str]:
    """Heading, signature and docstring."""
    thing = getattr(thing, "py_func", thing)
    try:
        signature = str(inspect.signature(thing, eval_str=False)).replace("'", "")
    except (TypeError, ValueError):
        signature = ""
    doc = inspect.getdoc(thing) or ""
    return [f"{level} {name}", "", f"```python\n{name}{signature}\n```", "", prose(doc), ""]
