"""The pages of the public Python: `__all__` of `palpate` and of the packages for custom nodes, bodies and laws."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from types import ModuleType
from typing import Any

from prose import prose

import palpate
import palpate.gym
import palpate.messages
import palpate.models.fe
import palpate.nodes
import palpate.physics

PACKAGES = (palpate, palpate.nodes, palpate.messages, palpate.models.fe, palpate.gym)
"""Packages of the page `python`; the laws of `palpate.physics` have a page for each folder."""


def public() -> str:
    """The public names, with the methods of the classes of `palpate`."""
    return "\n".join(line for package in PACKAGES for line in _package(package))


def _package(package: ModuleType) -> list[str]:
    lines = [f"# {package.__name__}", "", prose(package.__doc__ or ""), ""]
    for name in package.__all__:
        thing = getattr(package, name)
        if not (callable(thing) and getattr(thing, "__doc__", None)) or getattr(thing, "__module__", "") == "typing":
            lines += [f"## {package.__name__}.{name}", ""]
            continue
        lines += _thing(f"{package.__name__}.{name}", thing, "##")
        if package is palpate and inspect.isclass(thing):
            for key in dir(thing):  # inherited ones too, by palpate's classes
                member = next((vars(one)[key] for one in thing.__mro__ if key in vars(one) and _ours(one)), None)
                member = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
                if not key.startswith("_") and inspect.isfunction(member) and member.__doc__:
                    lines += _thing(f"{name}.{key}", member, "###")
    return lines


def _ours(kind: type) -> bool:
    return kind.__module__.partition(".")[0] == "palpate"


def library() -> Iterator[tuple[str, str]]:
    """A page for each folder of `palpate.physics`: every public law with its equation, units and source."""
    rooms = [info.name for info in pkgutil.iter_modules(palpate.physics.__path__) if info.ispkg]
    for room in sorted([*rooms, "errors"]):
        package = importlib.import_module(f"palpate.physics.{room}")
        lines = [f"# palpate.physics.{room}", "", prose(package.__doc__ or ""), ""]
        within = pkgutil.walk_packages(getattr(package, "__path__", ()), package.__name__ + ".")
        for full in sorted(one.name for one in within) or [package.__name__]:
            module = importlib.import_module(full)
            laws = list(_laws(module))
            if laws:
                lines += [f"## {full.removeprefix('palpate.physics.')}", "", prose(module.__doc__ or ""), ""]
            for name, thing in laws:
                lines += _thing(name, thing, "###")
        yield f"physics-{room}", "\n".join(lines)


def _laws(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Public functions, kernels and classes of a module."""
    for name in palpate.physics.__all__:
        thing = getattr(palpate.physics, name)
        if getattr(getattr(thing, "py_func", thing), "__module__", "") == module.__name__ and callable(thing):
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
