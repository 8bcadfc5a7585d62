"""The settings of one node, in order of precedence: the node's line, values of the scene in `with:`, class default."""

import contextlib
import math
import sys
import types
import typing
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any

import msgspec

from palpate.engine.faults import Faults, Location, choices, nearest
from palpate.launch.load.classes import SHIPPED, catalogue, classes
from palpate.launch.load.scene import Scene
from palpate.launch.load.values.source import YamlSource
from palpate.nodes.base import Calibrated, Node, Setting, SettingError, settings
from palpate.nodes.base import convert as check
from palpate.units.quantity import UnitError, convert, is_quantity

FIXED = ("effects", "wanted")  # keys of a scene that concern the graph as a whole


@dataclass(frozen=True)
class Offer:
    """One key that `with:` offers to one node; `taken`: the node has this setting, and its line does not set it."""

    path: str
    key: str
    value: Any
    node: str
    cls: type[Node]
    place: Location
    taken: bool


def resolve(
    name: str, cls: type[Node], line: YamlSource, set_keys: list[str], scene: Scene, offers: list[Offer], faults: Faults
) -> dict[str, Any]:
    """All settings of a node as plain data in SI units, checked.

    line      the node's line of the graph file
    set_keys  keys of the line that are settings of the class
    offers    receives the keys that `with:` offers, for `check_offers`
    """
    known = settings(cls)
    given: dict[str, tuple[Any, Location]] = {}
    for mapping, path in _offered_mappings(name, line, scene, faults):
        for key, value in mapping.items():
            if value is None:
                continue  # removed by a scene that extends another
            place = scene.source.place(*path.split("."), key) if path else line.place("with", key)
            offers.append(Offer(path, key, value, name, cls, place, key in known and key not in set_keys))
            if key in known:
                given[key] = (value, place)
    given |= {key: (line.data[key], line.place(key)) for key in set_keys}
    count = len(faults.entries)
    filled = {}
    for key, setting in known.items():
        about = {"node": name, "setting": key, "unit": setting.unit}
        if key in given:
            value, place = given[key]
            before = len(faults.entries)
            value = scene.fill(value, faults, place, about)
            if len(faults.entries) == before:
                filled[key] = value
        elif setting.default is ...:
            faults.add("missing", "It has no default.", line.place(), **about)
    # Nodes of one class with the same values, as of many fingers, are checked once.
    written = cls, repr(filled)
    if len(faults.entries) == count and written in scene.resolved:
        return dict(scene.resolved[written])
    values = {}
    for key, value in filled.items():
        about = {"node": name, "setting": key, "unit": known[key].unit}
        values[key] = _check_setting(known[key], value, given[key][1], about, faults)
    if len(faults.entries) == count:
        try:
            node = cls(**values)
            values = {key: _plain(getattr(node, key)) for key in known}
            scene.resolved[written] = dict(values)
        except SettingError as error:
            faults.add(str(error), "", line.place(), node=name)
        except Exception as error:  # a user's constructor may fail in any way
            faults.add(f"{cls.__name__} cannot be made: {type(error).__name__}: {error}", "", line.place(), node=name)
    return values


def _check_setting(setting: Setting, value: Any, place: Location, about: dict[str, str], faults: Faults) -> Any:
    """The value of one setting in its unit, as plain data; None and a fault if it is invalid."""
    try:
        value = in_si(setting.type, value, setting.unit)
        _finite(value)
        return _plain(check(setting, value))
    except UnitError as error:
        faults.add(str(error), "", place, **about)
    except SettingError as error:
        faults.add(str(error).removeprefix(f"setting {setting.name!r} [{setting.unit}]: "), "", place, **about)
    return None


def _offered_mappings(name: str, line: YamlSource, scene: Scene, faults: Faults) -> list[tuple[dict[str, Any], str]]:
    """The mappings in `with:`: value and path in the scene ("" if written inline)."""
    given = line.data.get("with")
    mappings = []
    for item in given if isinstance(given, list) else [] if given is None else [given]:
        place, path = line.place("with"), ""
        if isinstance(item, str) and item.startswith("$"):
            path = item[1:]
        value = scene.fill(item, faults, place, {"node": name}) if path or not isinstance(item, dict) else item
        if isinstance(value, dict):
            mappings.append((value, path))
        elif not path or scene.has(path):
            faults.add(f"with: found {item!r}, expected a mapping of the scene, `$name`, or a list of them",
                       scene.cure(str(item)), place, node=name)  # fmt: skip
    return mappings


def check_offers(offers: list[Offer], scene: Scene, faults: Faults) -> None:
    """A fault for each key of a `with:` mapping that is not a setting of any class.

    A model ignores keys of the models that may replace it; so a key is known if a class of the node's module, another
    user of the same mapping, a `when:` or `$path`, or a shipped class has it. A boolean may also be an effect of the
    scene that no node of this graph reads, unless its key resembles the name of a setting.
    """
    read_at = {prefix for used in scene.used for prefix in _prefixes(used)}
    taken = {(o.path, o.key) for o in offers if o.key in settings(o.cls)}
    taken |= {(o.path, o.key) for o in offers if o.path and f"{o.path}.{o.key}" in read_at}
    for offer in offers:  # only for other keys, the other classes are imported
        if (offer.path, offer.key) not in taken:
            names, seen = _family(offer.cls)
            if offer.key in names or not seen:
                taken.add((offer.path, offer.key))
    reported = set()
    for offer in offers:
        path = f"{offer.path}.{offer.key}"
        if (offer.path, offer.key) in taken or offer.place in reported:
            continue
        names, _ = _family(offer.cls)
        if isinstance(offer.value, bool) and not nearest(offer.key, names, likeness=0.8):
            continue
        shipped, missing = catalogue()
        if missing or any(offer.key in settings(entry.cls) for entry in shipped):
            continue
        reported.add(offer.place)
        text = f"with: {path.lstrip('.')!r} is a setting of no class of {offer.cls.__module__}"
        cure = choices(f"Settings of {offer.cls.__name__}", offer.key, names)
        faults.add(text, cure, offer.place, node=offer.node, setting=offer.key)


def check_taken(
    offers: list[Offer], changes: Iterable[tuple[str, YamlSource]], scene: Scene, faults: Faults
) -> tuple[str, ...]:
    """A fault for each value of the scene that the user has set and no node uses; notes on other values of the scene
    that the classes in use ignore.

    changes  dotted paths in the scene and the new values
    """
    offered = {offer.path for offer in offers}
    read = {path for path in scene.used if path not in offered}
    ends = read | {f"{o.path}.{o.key}" for o in offers if o.taken}
    above = {prefix for path in read for prefix in _prefixes(path)}

    def reaches(path: str) -> bool:
        return path in above or not ends.isdisjoint(_prefixes(path))

    for path, value in [leaf for change in changes for leaf in _leaves(*change)]:
        if path.partition(".")[0] in FIXED or not scene.has(path) or reaches(path):
            continue  # an unknown path was reported before
        lost = [offer for offer in offers if f"{path}.".startswith(f"{offer.path}.{offer.key}.")]
        cure = " ".join(_instead(offer) for offer in lost) or "No node reads it."
        faults.add(f"{path!r} of the scene reaches no node of this graph", cure, value.place())
    left: dict[tuple[str, str], list[str]] = {}
    knowing = {(offer.path, offer.key) for offer in offers if offer.key in settings(offer.cls)}
    for offer in offers:
        path = f"{offer.path}.{offer.key}"
        known = (offer.path, offer.key) in knowing
        if not offer.path or known or reaches(path):
            continue
        other = _family(offer.cls)[0].get(offer.key)
        if other is not None and not _calibration_of(other):
            close = _closest(offer.key, offer.cls)
            about = f"{offer.node} ({offer.cls.__name__}) does not take from scene.{offer.path}: "
            left.setdefault((offer.node, about), []).append(f"{offer.key}{f' (it has {close})' if close else ''}")
    return tuple(f"{about}{', '.join(keys)}" for (_, about), keys in left.items())


def _prefixes(path: str) -> Iterator[str]:
    """A dotted path and the paths above it."""
    while path:
        yield path
        path = path.rpartition(".")[0]


def calibration_notes(name: str, cls: type[Node], set_keys: list[str], offers: Iterable[Offer]) -> Iterator[str]:
    """Notes on settings of a node that keep defaults calibrated for another tissue.

    set_keys  settings in its line
    offers    those to this node
    """
    given = {*set_keys, *(offer.key for offer in offers)}
    left: dict[Calibrated, list[str]] = {}
    for setting in settings(cls).values():
        if setting.name not in given and (mark := _calibration_of(setting)):
            left.setdefault(mark, []).append(setting.name)
    for mark, names in left.items():
        yield (
            f"{name} ({cls.__name__}) has the {', '.join(names)} of {mark.default}, as the scene gives none: "
            f"`{mark.command}` fits them to a reference"
        )


def _calibration_of(setting: Setting) -> Calibrated | None:
    """The mark of a setting that is calibrated for one tissue."""
    return next((mark for mark in setting.marks if isinstance(mark, Calibrated)), None)


def _leaves(path: str, value: YamlSource) -> Iterator[tuple[str, YamlSource]]:
    if not isinstance(value.data, dict):
        yield path, value
        return
    for key in value.data:
        yield from _leaves(f"{path}.{key}", value.sub(key))


def _instead(offer: Offer) -> str:
    """What to set instead of a value of the scene that a node does not use."""
    name = f"{offer.node!r} ({offer.cls.__name__})"
    if offer.key in settings(offer.cls):
        return f"The line of {name} gives {offer.key!r} itself: set {offer.node}.{offer.key}."
    close = _closest(offer.key, offer.cls)
    return f"{name} has {close!r}." if close else f"Settings of {name}: {', '.join(settings(offer.cls)) or 'none'}."


def _closest(key: str, cls: type[Node]) -> str:
    """The setting that may replace `key` of another class: same unit and a common word, else a similar name; or ""."""
    mine, other = settings(cls), _family(cls)[0].get(key)
    same = [name for name, setting in mine.items() if other is None or setting.unit == other.unit]
    words = [name for name in same if set(name.split("_")) & set(key.split("_"))]
    return next(iter(words or nearest(key, same, 1)), "")


def _family(cls: type[Node]) -> tuple[dict[str, Setting], bool]:
    """The settings of all node classes in a class's module or folder, and whether all of them could be imported."""
    kind: Any = cls
    return _shipped_family(kind) if cls.__module__.startswith(SHIPPED) else _read_family(cls)


@cache
def _shipped_family(cls: Any) -> tuple[dict[str, Setting], bool]:
    """`_read_family`, kept because loading a graph asks for it 14 times; the classes of a user may change."""
    return _read_family(cls)


def _read_family(cls: type[Node]) -> tuple[dict[str, Setting], bool]:
    names, seen = dict(settings(cls)), True
    file = cls.__module__
    for module in dict.fromkeys((file, ".".join(file.split(".")[:3]) if file.startswith(SHIPPED) else file)):
        try:
            others = classes(sys.modules[module])
        except ImportError:
            seen = False
            continue
        for other in others:
            with contextlib.suppress(TypeError, NameError):  # ignore malformed classes
                names |= settings(other)
    return names, seen


def in_si(hint: Any, value: Any, unit: str) -> Any:
    """A value of this type with quantities such as "6 mm" turned into numbers of the unit. UnitError: not possible."""
    options = _options(hint)
    numeric = float in options or int in options
    if isinstance(value, str):
        if not numeric or any(value in typing.get_args(o) for o in options if typing.get_origin(o) is typing.Literal):
            return value
        return value if str in options and not is_quantity(value) else _whole(convert(value, unit), options)
    if isinstance(value, float) and int in options:
        return _whole(value, options)
    for option in options:
        origin, inner = typing.get_origin(option), typing.get_args(option)
        if isinstance(value, list) and origin in (tuple, list) and inner:
            each = origin is tuple and Ellipsis not in inner and len(inner) == len(value)
            kinds = inner if each else inner[:1] * len(value)
            return [in_si(kind, item, unit) for kind, item in zip(kinds, value, strict=True)]
        if isinstance(value, dict) and isinstance(option, type) and issubclass(option, msgspec.Struct):
            return {key: _field_in_si(option, key, item) for key, item in value.items()}
        if isinstance(value, dict) and origin is dict and inner:
            return {key: in_si(inner[1], item, unit) for key, item in value.items()}
    return value


def _field_in_si(struct: type[msgspec.Struct], key: str, value: Any) -> Any:
    """A field of a setting that is a struct; without a unit it takes plain values only."""
    hint = _hints(struct).get(key)
    unit = next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, str)), None)
    return value if unit is None else in_si(hint, value, unit)


@cache
def _hints(struct: type[msgspec.Struct]) -> dict[str, Any]:
    return typing.get_type_hints(struct, include_extras=True)


def _whole(value: float, options: list[Any]) -> float | int:
    """Convert 2e3 to an int if the setting takes no floats."""
    return int(value) if float not in options and value.is_integer() else value


def _options(hint: Any) -> list[Any]:
    """The alternatives of a union type, without annotations."""
    if typing.get_origin(hint) is Annotated:
        return _options(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return [o for a in typing.get_args(hint) for o in _options(a)]
    return [hint]


def _plain(value: Any) -> Any:
    """The value as plain data, as after a round trip through JSON."""
    value = msgspec.to_builtins(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def _finite(value: Any) -> None:
    """UnitError: an infinite number or NaN. Only defaults may be infinite."""
    if isinstance(value, float) and not math.isfinite(value):
        raise UnitError(f"found {value}; expected a finite number")
    for item in value if isinstance(value, list | tuple) else value.values() if isinstance(value, dict) else ():
        _finite(item)
