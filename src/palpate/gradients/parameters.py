"""Numeric settings of a graph by path, as parameters of derivatives and fits: value, unit, limits, scale."""

import math
import re
import typing
from collections.abc import Container, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated, Any

import msgspec

from palpate.bases import depends
from palpate.engine.faults import choices
from palpate.engine.graph import Graph, NodeSpec
from palpate.nodes.base import Setting, settings
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError, convert, is_quantity, parse, split

SCALES = {"m": 0.01, "rad": 0.1, "s": 0.1, "1": 0.1, "N": 0.1, "m/s": 0.01}
"""Scale of a setting whose value is 0, by unit; and of a coordinate of a place, whose distance from 0 is no scale."""
PART = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


@dataclass(frozen=True)
class Parameter:
    """A number in a setting.

    path       as given, "tissue.stiffness", "scene.hand.path[1].to[2]"
    target     path of the override that sets it: a whole list where the number is in one
    inside     keys below the target
    container  value of the target in the graph
    value, scale, low, high  [unit]  scale: of a typical change; limits of the setting
    node       the node that has the setting; "": of the scene
    """

    path: str
    target: str
    inside: tuple[str | int, ...]
    container: Any
    value: float
    unit: str
    scale: float
    low: float = -math.inf
    high: float = math.inf
    node: str = ""

    def put(self, value: float, container: Any = None) -> Any:
        """The value of the target with this value of the number. `container`: instead of that of the graph."""
        if not self.inside:
            return float(value)
        whole = at = deepcopy(self.container if container is None else container)
        for key in self.inside[:-1]:
            at = at[key]
        at[self.inside[-1]] = float(value)
        return whole

    def read(self, container: Any) -> float:
        """The number in a value of the target."""
        for key in self.inside:
            container = container[key]
        return _number(container, self.unit)

    def side(self, step: float, value: float) -> int:
        """0: both sides of a value are within the limits; 1, -1: the one that is."""
        return 1 if value - step < self.low else -1 if value + step > self.high else 0


def put_all(parameters: Iterable[Parameter], values: Iterable[float]) -> dict[str, Any]:
    """Overrides by target that give parameters these values."""
    found: dict[str, Any] = {}
    for parameter, value in zip(parameters, values, strict=True):
        found[parameter.target] = parameter.put(value, found.get(parameter.target))
    return found


def find_parameter(graph: Graph, path: str, running: Container[str], scale: float | None = None) -> Parameter:
    """The parameter with this path.

    running  nodes that the kept fields need
    scale    of its changes [its unit]; None: its value

    ArgumentError: there is no such setting, it is no number, a stored basis contains it, or no kept field needs it.
    """
    keys = [name or int(place) for name, place in PART.findall(path)] if isinstance(path, str) else []
    head, bare = str(keys[0]) if keys else "", [key for key in keys if isinstance(key, str)]
    if len(bare) < 2:
        raise ArgumentError(f"parameter {path!r}: expected a setting, such as tissue.stiffness, or scene.<path>")
    if head in graph.nodes:
        known = settings(graph.nodes[head].cls)
        if keys[1] == "use":
            raise ArgumentError(f"{path!r}: found {graph.nodes[head].use!r}, a choice; expected a number")
        if keys[1] not in known:
            raise ArgumentError(
                f"{path!r}: {head} has no setting {keys[1]!r}. {choices('Settings', str(keys[1]), known)}"
            )
        target, data, rest = f"{head}.{keys[1]}", graph.nodes[head].settings[str(keys[1])], keys[2:]
        users = [(graph.nodes[head], known[str(keys[1])])]
    else:
        target, data, rest = _in_scene(graph, path, keys if head == "scene" else ["scene", *keys])
        users = list(_users(graph, target))
    container, number = data, data
    for depth, key in enumerate(rest):
        try:
            number = number[key]
        except (KeyError, IndexError, TypeError):
            found = f"a list of {len(number)}" if isinstance(number, list) else repr(number)
            raise ArgumentError(f"{path!r}: found {found}, which has no {rest[depth]!r}") from None
    _check_used(path, graph, users, running)
    unit = next((setting.unit for _, setting in users), "")
    if unit == "1" and rest and isinstance(rest[-1], int) and "to" in rest:
        unit = "m"  # of a point of a path
    if rest[-1:] == ["time"] or rest[-1:] == ["hold"]:
        unit = "s"
    value = _checked(path, number, unit, users if not rest else [])
    low, high = _limits(users) if not rest else (-math.inf, math.inf)
    whole = path if head in graph.nodes or head == "scene" else f"scene.{path}"
    change = _scale(path, value, unit, scale, bool(rest))
    node = head if head in graph.nodes else ""
    return Parameter(whole, target, tuple(rest), container, value, unit, change, low, high, node)


def _in_scene(graph: Graph, path: str, keys: list[str | int]) -> tuple[str, Any, list[str | int]]:
    """Target, value and the keys below it of a path of the scene, "scene.hand.path[1].to[2]"."""
    data: Any = graph.scene
    for depth, key in enumerate(keys[1:], 1):
        if isinstance(data, list):
            return ".".join(map(str, keys[:depth])), data, keys[depth:]
        if not (isinstance(data, dict) and key in data):
            names = [*graph.nodes, *graph.scene] if depth == 1 else list(data) if isinstance(data, dict) else []
            raise ArgumentError(f"{path!r}: there is no {key!r}. {choices('There is', str(key), names)}")
        data = data[key]
    if isinstance(data, list):
        raise ArgumentError(f"{path!r}: found a list of {len(data)}, expected one of its numbers: {path}[0]")
    return ".".join(map(str, keys)), data, []


def _users(graph: Graph, target: str) -> Iterator[tuple[NodeSpec, Setting]]:
    """The nodes, with the setting, that may take a value of the scene."""
    name = target.rpartition(".")[2]
    for spec in graph.nodes.values():
        known = settings(spec.cls)
        if name in known:
            yield spec, known[name]


def _check_used(path: str, graph: Graph, users: list[tuple[NodeSpec, Setting]], running: Container[str]) -> None:
    """ArgumentError: no node that is needed has the setting, or a stored basis contains it."""
    if users and all(spec.name not in running for spec, _ in users):
        spec = users[0][0]
        why = f"it does not run: {spec.off}" if spec.off else "no kept field needs it"
        raise ArgumentError(f"{path!r}: node {spec.name!r} is not in the plan: {why}; keep a field that depends on it")
    for spec, setting in users:
        made: Any = spec.cls
        if depends(f"{spec.name}.{setting.name}") and hasattr(made, "bases") and made(**spec.settings).bases():
            able = [s.name for s in settings(spec.cls).values()
                    if type(spec.settings[s.name]) is float and not depends(f"{spec.name}.{s.name}")]  # fmt: skip
            raise ArgumentError(
                f"{path!r}: the stored basis of {spec.name!r} ({spec.cls.__name__}) is built for one value; these vary "
                f"without another basis: {', '.join(able)}"
            )


def _checked(path: str, number: Any, unit: str, users: Iterable[tuple[NodeSpec, Setting]]) -> float:
    """A number [unit]. ArgumentError: it is none that can vary."""
    kinds = {option for _, setting in users for option in _options(setting.type)}
    whole = bool(kinds) and float not in kinds and isinstance(number, int)
    if isinstance(number, bool) or number is None or isinstance(number, list | tuple | dict) or whole:
        what = "a switch" if isinstance(number, bool) else "a whole number" if whole else "no number"
        cure = f"; one of its numbers is {path}[0]" if isinstance(number, list | tuple) else ""
        raise ArgumentError(f"{path!r}: found {number!r}, {what}, expected one that varies without steps{cure}")
    try:
        return _number(number, unit)
    except (UnitError, ValueError):
        raise ArgumentError(
            f"{path!r}: found {number!r}, a choice; expected a number, which has a derivative"
        ) from None


def _number(given: Any, unit: str) -> float:
    """A number, or a quantity such as "20 ms", in this unit, by default the SI unit. UnitError, ValueError: neither."""
    if not isinstance(given, str):
        return float(given)
    if not is_quantity(given):
        raise ValueError(given)
    if unit:
        return convert(given, unit)
    number, text = split(given)
    return float(number * parse(text or "1").factor)


def _options(hint: Any) -> list[Any]:
    """The alternatives of a type, without annotations."""
    if typing.get_origin(hint) is Annotated:
        return _options(typing.get_args(hint)[0])
    return [o for a in typing.get_args(hint) for o in _options(a)] or [hint]


def _limits(users: Iterable[tuple[NodeSpec, Setting]]) -> tuple[float, float]:
    """The limits that all of these settings allow."""
    low, high = -math.inf, math.inf
    for _, setting in users:
        for mark in getattr(setting.type, "__metadata__", ()):
            if isinstance(mark, msgspec.Meta):
                lows = [low, *(float(x) for x in (mark.ge, mark.gt) if x is not None)]
                highs = [high, *(float(x) for x in (mark.le, mark.lt) if x is not None)]
                low, high = max(lows), min(highs)
    return low, high


def _scale(path: str, value: float, unit: str, scale: float | None, inside: bool) -> float:
    """Scale of the changes of a parameter. ArgumentError: it is not positive, or unknown."""
    if scale is not None:
        if not (isinstance(scale, int | float) and 0.0 < scale < math.inf):
            raise ArgumentError(f"scale of {path!r}: found {scale!r}, expected a number above 0")
        return float(scale)
    if inside and unit == "m":
        return SCALES["m"]
    if value != 0.0:
        return abs(value)
    if unit not in SCALES:
        raise ArgumentError(
            f"{path!r} is 0, so the size of its changes is unknown; expected scale={{{path!r}: ...}} [{unit}]"
        )
    return SCALES[unit]


def scales_of(given: Mapping[str, float] | None, paths: Iterable[str]) -> Mapping[str, float]:
    """Scales by path. ArgumentError: one of another parameter."""
    paths = list(paths)
    for path in given or {}:
        if path not in paths:
            raise ArgumentError(f"scale: found {path!r}, expected one of the parameters: {', '.join(paths)}")
    return given or {}
