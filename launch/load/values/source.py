"""YAML as plain data with the position of each key.

Numbers follow YAML 1.2: `2e3` is a number. `on`, `off`, `yes` and `no` are booleans, as in YAML 1.1. Duplicate keys,
merge keys and tags are errors.
"""

from __future__ import annotations

import contextlib
import copy
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from yaml.reader import ReaderError

from palpate.engine.faults import Fault, GraphError, Location
from palpate.physics.readable import MOST_TEXT, check_readable

Keys = tuple[Any, ...]

_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_WORDS = {
    "": None, "~": None, "null": None, "true": True, "yes": True, "on": True, "false": False, "no": False, "off": False,
    ".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan,
}  # fmt: skip
_TOO_MANY = 20_000  # entries, since aliases can multiply them


@dataclass
class YamlSource:
    """Plain data, and the place of each value by the keys that lead to it."""

    data: Any = None
    places: dict[Keys, Location] = field(default_factory=dict)

    def place(self, *keys: Any) -> Location:
        """Where the value under these keys, or the nearest mapping around it, was written."""
        for end in range(len(keys), -1, -1):
            if keys[:end] in self.places:
                return self.places[keys[:end]]
        return Location()

    def sub(self, *keys: Any) -> YamlSource:
        """The part under these keys; its data is None if the keys are missing."""
        data = self.data
        for key in keys:
            data = data.get(key) if isinstance(data, dict) else None
        places = {k[len(keys) :]: self.places[k] for k in paths(data, keys) if k in self.places}
        places.setdefault((), self.place(*keys))
        return YamlSource(data, places)

    def put(self, keys: Keys, value: YamlSource) -> None:
        """Set the value under these keys; creates missing mappings."""
        data = self.data
        for depth, key in enumerate(keys[:-1]):
            if not isinstance(data.get(key), dict):
                data[key] = {}
                self.places.setdefault(keys[: depth + 1], value.place())
            data = data[key]
        self.drop(keys)
        data[keys[-1]] = value.data
        self.places.update({keys + k: p for k, p in value.places.items()})

    def drop(self, keys: Keys) -> None:
        """Remove the places under these keys, whose data are still there."""
        data = self.data
        for key in keys:
            data = data.get(key) if isinstance(data, dict) else None
        for path in paths(data, keys):
            self.places.pop(path, None)


def paths(data: Any, keys: Keys = ()) -> Iterator[Keys]:
    """The keys of a value, `keys`, and of all values in it."""
    yield keys
    inside = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inside:
        yield from paths(value, (*keys, key))


def read(path: Path) -> YamlSource:
    """The file's data with places. GraphError: it cannot be read or is not YAML; names file, line and column."""
    try:
        check_readable(path, MOST_TEXT)
        raw = path.read_bytes()
    except OSError as error:
        raise GraphError([Fault(f"cannot be read: {error.strerror}", place=Location(str(path)))]) from None
    return parse(raw, str(path))


def parse(text: str | bytes, file: str) -> YamlSource:
    """The data of a YAML text with places; `file`: its name in the places."""
    parsed = _parse(text, file)
    return YamlSource(copy.deepcopy(parsed.data), dict(parsed.places))


@lru_cache(maxsize=32)
def _parse(text: str | bytes, file: str) -> YamlSource:
    try:
        root = _compose(text)
        source = YamlSource(None, {(): Location(file, 1, 1)})
        if root is not None:
            source.data = _Builder(file, source.places).build(root, (), ())
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Location(file, mark.line + 1, mark.column + 1) if mark else Location(file)
        what = ", ".join(part for part in (error.context, error.problem) if part)
        raise GraphError([Fault(f"not YAML: column {place.column}: {what}", place=place)]) from None
    except yaml.YAMLError as error:
        raise GraphError([_unreadable(text, error, file)]) from None
    except RecursionError:
        raise GraphError([Fault("nested too deeply", place=Location(file))]) from None
    return source


def _unreadable(text: str | bytes, error: yaml.YAMLError, file: str) -> Fault:
    if not (isinstance(text, bytes) and isinstance(error, ReaderError) and error.encoding == "utf-8"):
        return Fault(f"not YAML: {' '.join(str(error).split())}", place=Location(file))
    if b"\0" in text:
        cure = "It is a recording: `palpate info FILE` shows it." if text.startswith(b"\x89MCAP") else ""
        return Fault("not a text file; expected YAML", cure, Location(file))
    lines = text[: error.position].split(b"\n")
    place = Location(file, len(lines), len(lines[-1]) + 1)
    return Fault(f"not UTF-8: byte {error.character:#x} in column {place.column}", "Save the file as UTF-8.", place)


def merge(base: YamlSource, top: YamlSource) -> YamlSource:
    """`top` merged over `base`, recursively; null in `top` removes a key of `base`."""
    if not (isinstance(base.data, dict) and isinstance(top.data, dict)):
        return top
    merged = YamlSource(dict(base.data), dict(base.places))
    for key, value in top.data.items():
        if value is None and key in merged.data:
            merged.drop((key,))
            del merged.data[key]
        elif isinstance(value, dict) and isinstance(merged.data.get(key), dict):
            merged.put((key,), merge(merged.sub(key), top.sub(key)))
        else:
            merged.put((key,), top.sub(key))
    merged.places[()] = top.place()
    return merged


def _compose(text: str | bytes) -> yaml.Node | None:
    """Parse with libyaml, which is 6 × as fast; on an error parse again in Python for its better message."""
    if hasattr(yaml, "CSafeLoader"):
        with contextlib.suppress(yaml.YAMLError):
            return yaml.compose(text, Loader=yaml.CSafeLoader)
    return yaml.compose(text, Loader=yaml.SafeLoader)


class _Builder:
    """Turns composed nodes into data, collecting places."""

    def __init__(self, file: str, places: dict[Keys, Location]) -> None:
        self.file, self.places = file, places

    def build(self, node: yaml.Node, keys: Keys, parents: tuple[int, ...]) -> Any:
        place = Location(self.file, node.start_mark.line + 1, node.start_mark.column + 1)
        self.places.setdefault(keys, place)
        if id(node) in parents:
            raise GraphError([Fault("an alias that contains itself", place=place)])
        if len(self.places) > _TOO_MANY:
            raise GraphError([Fault(f"more than {_TOO_MANY} entries", place=place)])
        if not node.tag.startswith("tag:yaml.org,2002:"):
            raise GraphError([Fault(f"tag {node.tag!r}: tags are not read", place=place)])
        inside = (*parents, id(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, keys, inside)
        if isinstance(node, yaml.SequenceNode):
            return [self.build(item, (*keys, i), inside) for i, item in enumerate(node.value)]
        return node.value if getattr(node, "style", None) else scalar(node.value)

    def _mapping(self, node: yaml.MappingNode, keys: Keys, inside: tuple[int, ...]) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        for key, value in node.value:
            place = Location(self.file, key.start_mark.line + 1, key.start_mark.column + 1)
            if not isinstance(key, yaml.ScalarNode):
                raise GraphError([Fault("a key must be a word", place=place)])
            name = key.value
            if name == "<<":
                raise GraphError([Fault("merge keys (<<) are not read", "Use `extends:`.", place)])
            if name in mapping:
                first = self.places[(*keys, name)].line
                raise GraphError([Fault(f"duplicate key {name!r}, first on line {first}", "Remove one.", place)])
            self.places[(*keys, name)] = place
            mapping[name] = self.build(value, (*keys, name), inside)
        return mapping


def scalar(text: str) -> Any:
    """The value of an unquoted word: null, boolean, number or text."""
    word = text.lower()
    if word in _WORDS:
        return _WORDS[word]
    if _INT.fullmatch(text):
        return int(text) if len(text) < 40 else float(text)
    return float(text) if _FLOAT.fullmatch(text) else text
