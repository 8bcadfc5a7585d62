"""The values of a scene by dotted path, `$path` in settings, and the conditions of `when:`."""

import operator
import re
from collections.abc import Iterator
from typing import Any

from palpate.engine.faults import Faults, Location, choices
from palpate.launch.load.values.source import YamlSource, scalar
from palpate.messages.wording import written
from palpate.units.quantity import is_quantity, parse, split
from palpate.units.symbols import Dimension

_COMPARE = {
    ">=": operator.ge, "<=": operator.le, "==": operator.eq, "!=": operator.ne, ">": operator.gt, "<": operator.lt,
}  # fmt: skip
_PATH = r"\$?([^\s<>=!$]+)"
_CONDITION = re.compile(rf"\s*(not\s+)?{_PATH}\s*(?:(>=|<=|==|!=|>|<)\s*(.+?))?\s*")


class Scene:
    """The data of a scene; `used` are the paths that were read, `resolved` the checked settings of its nodes by class
    and values as written."""

    def __init__(self, source: YamlSource) -> None:
        self.source = source
        self.data: dict[str, Any] = source.data
        self.used: set[str] = set()
        self.resolved: dict[tuple[type, str], dict[str, Any]] = {}

    def has(self, path: str) -> bool:
        return self._find(path)[0]

    def get(self, path: str) -> Any:
        """The value under a dotted path that the scene has."""
        self.used.add(path)
        return self._find(path)[1]

    def place(self, path: str) -> Location:
        return self.source.place(*path.split("."))

    def cure(self, path: str) -> str:
        """The nearest paths of the scene."""
        return choices("The scene has", path, _paths(self.data, ""))

    def fill(
        self, value: Any, faults: Faults, place: Location, about: dict[str, str], inside: tuple[str, ...] = ()
    ) -> Any:
        """The value with each `$path` in it replaced by the scene's value; an unknown path is a fault and None."""
        if isinstance(value, dict):
            return {k: self.fill(v, faults, place, about, inside) for k, v in value.items()}
        if isinstance(value, list):
            return [self.fill(v, faults, place, about, inside) for v in value]
        if not (isinstance(value, str) and value.startswith("$")):
            return value
        path = value[1:]
        if path in inside:
            faults.add(f"found {value!r}, which leads back to itself", "", place, **about)
            return None
        if not self.has(path):
            faults.add(f"found {value!r}; the scene has no {path!r}", self.cure(path), place, **about)
            return None
        return self.fill(self.get(path), faults, place, about, (*inside, path))

    def _find(self, path: str) -> tuple[bool, Any]:
        data: Any = self.data
        for key in path.split("."):
            if not (isinstance(data, dict) and key in data):
                return False, None
            data = data[key]
        return True, data


def _paths(data: Any, head: str) -> Iterator[str]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield f"{head}{key}"
            yield from _paths(value, f"{head}{key}.")


def condition(text: Any, scene: Scene, faults: Faults, place: Location, node: str) -> str | None:
    """Why a `when:` is false; None if it is true. An invalid condition is a fault.

    Forms: `path`, `not path`, of a switch, true or false; `path > 0` (also >= < <= == !=), whose sides are of one kind,
    with a path of the scene; or true or false.
    """
    if isinstance(text, bool):
        return None if text else f"when is false ({place})"
    match = _CONDITION.fullmatch(text) if isinstance(text, str) else None
    if match is None or (match[1] and match[3]):
        faults.add(
            f"when: found {text!r}, expected a path of the scene, `not path` or a comparison such as `path > 0`",
            scene.cure(str(text)), place, node=node,
        )  # fmt: skip
        return None
    negate, path, sign, right = match.groups()
    if not scene.has(path):
        faults.add(f"when: the scene has no {path!r}", scene.cure(path), place, node=node)
        return None
    value = scene.fill(scene.get(path), faults, place, {"node": node})
    fact = f"{path} is {_words(value)} ({scene.place(path)})"
    if sign is None:
        if not isinstance(value, bool):
            faults.add(f"{path}: found {written(value)}, expected true or false, because it switches the node",
                       _switch_cure(path, value), scene.place(path), node=node)  # fmt: skip
            return None
        return None if value is not bool(negate) else fact
    left, dimension = _measure(value)
    other, expected = _measure(scalar(right.strip("'\"")))
    if not _comparable(left, other, sign) or (None not in (dimension, expected) and dimension != expected):
        faults.add(f"when: found {text!r}; {_words(value)} and {right} cannot be compared", "", place, node=node)
        return None
    return None if _COMPARE[sign](left, other) else f"{path} {sign} {right} is false: {fact}"


def _switch_cure(path: str, value: Any) -> str:
    """What to write instead of a value that is no boolean."""
    word = scalar(value.strip()) if isinstance(value, str) else None
    key = path.rpartition(".")[2]
    if isinstance(word, bool):
        return f"Write it without quotes: {key}: {_words(word)}."
    compared = f" Or compare it: when: {path} > 0." if isinstance(_measure(value)[0], int | float) else ""
    return f"Without quotes: {key}: true, or on, yes; {key}: false, or off, no.{compared}"


def _comparable(left: Any, right: Any, sign: str) -> bool:
    """Whether both sides of a comparison are numbers or texts; or with == and != booleans, or one of them null."""
    one, other = ("number" if type(side) in (int, float) else type(side) for side in (left, right))
    equality = sign in ("==", "!=")
    return (one == other and (equality or one in ("number", str))) or (equality and None in (left, right))


def _words(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return "null" if value is None else f"a mapping of {len(value)}" if isinstance(value, dict) else str(value)


def _measure(value: Any) -> tuple[Any, Dimension | None]:
    """A quantity as its number in SI units and its dimension; anything else as it is."""
    if isinstance(value, str) and is_quantity(value):
        number, text = split(value)
        unit = parse(text or "1")
        return float(number * unit.factor), unit.dimension if text else None
    return value, None
