"""Lines of a graph that are repeated for each organ of a scene, and for each pair of organs that may touch.

contact-<organ>:            a line for each organ
between-<first>-<second>:   a line for each pair in reach, in the order of the scene's list
[contact-<organ>]           in a list of another line: an entry for each organ, or pair
[side-<organ>-<other>]      in a list: an entry for each organ that may touch this one; in the line of a pair without
                            the partner, `<first>` or `<second>`
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from palpate.engine.faults import Faults
from palpate.launch.load.values.source import YamlSource, paths

ORGAN, FIRST, SECOND, OTHER = "<organ>", "<first>", "<second>", "<other>"
MARKS = ORGAN, FIRST, SECOND, OTHER
Pair = tuple[str, str]


def has_marks(graph: YamlSource) -> bool:
    """Whether lines of a graph are repeated for each organ."""
    nodes = graph.data.get("nodes")
    return isinstance(nodes, dict) and any(mark in str(name) for name in nodes for mark in MARKS)


def repeat_lines(
    graph: YamlSource, organs: list[str] | None, pairs: Sequence[Pair], apart: Mapping[Pair, str], faults: Faults
) -> dict[str, str]:
    """Repeat the lines of a graph for these organs, and for these pairs of them. Of the pairs `apart`, the first line
    of a pair remains, which does not run; returns the reasons by the names of these lines.

    A fault if the graph has lines for each organ and the scene no organs.
    """
    if not has_marks(graph):
        return {}
    if organs is None:
        cure = "`organs: [{file: liver.stl, unit: mm, tissue: liver-human}, ...]` in the scene (docs/many_fingers.md)."
        faults.add("has lines for each organ, but the scene has no list `organs`", cure, graph.place("nodes"))
        return {}
    lines, off = YamlSource({}, {(): graph.place("nodes")}), dict[str, str]()
    for name, line in graph.data["nodes"].items():
        left = () if off or OTHER in str(name) or FIRST not in str(name) else apart
        for known in (*_repeats(str(name), organs, pairs), *_repeats(str(name), (), left)):
            filled, repeated = YamlSource(_fill(line, known, organs, pairs), {}), _replace(str(name), known)
            filled.places = {keys: graph.place("nodes", name, *keys) for keys in paths(filled.data)}
            lines.put((repeated,), filled)
            if (pair := (known.get(FIRST, ""), known.get(SECOND, ""))) in left:
                off[repeated] = apart[pair]
    graph.put(("nodes",), lines)
    return off


def _repeats(name: str, organs: Iterable[str], pairs: Iterable[Pair]) -> Iterator[dict[str, str]]:
    """The names that replace the marks, for each repetition."""
    if ORGAN in name:
        yield from ({ORGAN: organ} for organ in organs)
    elif FIRST in name or SECOND in name:
        yield from ({FIRST: first, SECOND: second} for first, second in pairs)
    else:
        yield {}


def _fill(value: Any, known: dict[str, str], organs: list[str], pairs: Sequence[Pair]) -> Any:
    """A value of a line with its marks replaced, and the entries of its lists repeated."""
    if isinstance(value, dict):
        return {_replace(key, known): _fill(each, known, organs, pairs) for key, each in value.items()}
    if isinstance(value, list):
        return [filled for each in value for filled in _entries(each, known, organs, pairs)]
    return _replace(value, known)


def _entries(entry: Any, known: dict[str, str], organs: list[str], pairs: Sequence[Pair]) -> Iterator[Any]:
    text = entry if isinstance(entry, str) else ""
    mine = {mark: name for mark, name in known.items() if mark in text}
    if OTHER in text:
        taken = set(known.values())
        for organ in mine.values():
            touched = [other for other in organs if (organ, other) in pairs or (other, organ) in pairs]
            yield from (_replace(text, known | {OTHER: other}) for other in touched if other not in taken)
    elif text and not mine:
        yield from (_replace(text, each) for each in _repeats(text, organs, pairs))
    else:
        yield _fill(entry, known, organs, pairs)


def _replace(value: Any, known: dict[str, str]) -> Any:
    if isinstance(value, str):
        for mark, name in known.items():
            value = value.replace(mark, name)
    return value
