"""A value of the scene that several classes would take in different units, without saying which it is in."""

import contextlib
import sys
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

from palpate.engine.faults import Faults
from palpate.engine.graph import sent_by
from palpate.launch.load.classes import SHIPPED, ClassError, catalogue, classes, find_class
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.values.settings import Offer
from palpate.launch.load.values.source import YamlSource
from palpate.launch.load.values.units import Unit, UnitError, parse
from palpate.nodes.base import Node, settings


def uses(source: YamlSource) -> dict[str, str]:
    """The class that each node of a graph names."""
    nodes = source.data.get("nodes")
    lines = nodes.items() if isinstance(nodes, dict) else ()
    return {name: line["use"] for name, line in lines if isinstance(line, dict) and isinstance(line.get("use"), str)}


def check_units(offers: Iterable[Offer], written: dict[str, str], faults: Faults) -> None:
    """A fault for each plain number of a `with:` mapping whose key means another unit in another class: one that takes
    the same mapping, or one that such a class stands in for. That is the class that the graph names where a swap came
    from outside, `written`, and for a value of a scene that ships each shipped class that sends the same message."""
    family = cache(classes)
    takers: dict[tuple[str, str], list[Offer]] = {}
    for offer in offers:
        if offer.taken and _plain_number(offer.value):
            takers.setdefault((offer.path, offer.key), []).append(offer)
    for (path, key), claims in takers.items():
        units: dict[Unit | str, list[str]] = {}
        for cls in dict.fromkeys(c for offer in claims for c in _meant(offer, written, family)):
            with contextlib.suppress(TypeError, NameError):  # one that is not well formed has no say
                if key in settings(cls):
                    unit = settings(cls)[key].unit
                    units.setdefault(_meaning(unit), []).append(f"{unit} for {cls.__name__}")
        if len(units) > 1:
            offer = claims[-1]
            said = ", ".join(name for names in units.values() for name in names)
            cure = f"Write its unit, or give {key!r} on the line of each node that takes it."
            text = (
                f"with: {f'{path}.{key}'.lstrip('.')!r} is {offer.value!r} without a unit, and would be taken in {said}"
            )
            faults.add(text, cure, offer.place, node=offer.node, setting=key)


def _meant(
    offer: Offer, written: dict[str, str], family: Callable[[ModuleType], list[type[Node]]]
) -> Iterator[type[Node]]:
    """The class that takes an offer, and those that it stands in for; `family`: the node classes of a module."""
    yield offer.cls
    with contextlib.suppress(ClassError):
        if offer.node in written:
            yield find_class(written[offer.node])
    if not Path(offer.place.file).is_relative_to(GRAPHS):
        return
    if offer.cls.__module__.startswith(SHIPPED):  # its own family is there already; the others need not be brought in
        others = family(sys.modules[".".join(offer.cls.__module__.split(".")[:3])])
    else:
        others = [entry.cls for entry in catalogue()[0]]
    for other in others:
        if set(sent_by(offer.cls)) & set(sent_by(other)):
            yield other


def _plain_number(value: object) -> bool:
    if isinstance(value, list):
        return bool(value) and all(map(_plain_number, value))
    return isinstance(value, int | float) and not isinstance(value, bool) and value != 0


def _meaning(unit: str) -> Unit | str:
    """What a unit counts in; its text where that is not fixed (N/m^n)."""
    try:
        return parse(unit)
    except UnitError:
        return unit
