"""Settings that describe one thing in several nodes, such as the patch under the finger (`nodes.base.Agrees`).

If one of them is set, the others take its value; different values are refused. A setting that follows its senders
(`nodes.base.Follows`) takes the largest value of theirs.
"""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from typing import Any

from palpate.engine.faults import Faults, Location
from palpate.engine.graph import NodeSpec
from palpate.launch.load.wiring import Wire
from palpate.messages import Message
from palpate.messages.wording import written
from palpate.nodes.base import Agrees, Follows, Setting, SettingError, settings

Given = dict[str, dict[str, Location]]
"""By node, the settings that its line or the scene sets, with their places."""


def agree(nodes: Mapping[str, NodeSpec], wires: Iterable[Wire], given: Given, faults: Faults) -> None:
    """Give all settings that describe one thing the value that one of them has. A fault for different ones."""
    incoming: dict[str, list[Wire]] = {}
    for wire in wires:
        if wire.producer in nodes and wire.consumer in nodes:
            incoming.setdefault(wire.consumer, []).append(wire)
    marked = {name: dict(_marks(spec)) for name, spec in nodes.items()}
    known = {setting: mark for marks in marked.values() for setting, mark in marks.items()}
    for setting in sorted(known, key=lambda setting: known[setting].twice != ""):  # after those that they are twice of
        for group in _groups([name for name in nodes if setting in marked[name]], setting, marked, incoming):
            _settle(setting, [nodes[name] for name in group], given, faults)
    has = {name: spec.settings for name, spec in nodes.items()}
    for name, spec in nodes.items():
        _follow(name, spec, has, incoming, given, faults)


def _marks(spec: NodeSpec) -> Iterator[tuple[str, Agrees]]:
    """The marked settings of a node."""
    for setting in settings(spec.cls).values():
        if mark := mark_of(setting):
            yield setting.name, mark


def mark_of(setting: Setting) -> Agrees | None:
    """The mark of a setting that agrees with those of other nodes."""
    return next((mark for mark in setting.marks if isinstance(mark, Agrees)), None)


def _groups(
    names: Sequence[str], setting: str, marked: Mapping[str, Mapping[str, Agrees]], incoming: Mapping[str, list[Wire]]
) -> Iterator[list[str]]:
    """The nodes whose settings describe one thing: those that a sender with it reaches, or the same sender."""
    leader: dict[str, str] = {}

    def find(name: str) -> str:
        while leader.setdefault(name, name) != name:
            name = leader[name]
        return name

    for name in names:
        for at in _senders(name, setting, marked[name][setting].messages, marked, incoming):
            leader[find(name)] = find(at)
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(find(name), []).append(name)
    yield from groups.values()


def _senders(
    name: str,
    setting: str,
    messages: tuple[type[Message], ...],
    has: Mapping[str, Container[str]],
    incoming: Mapping[str, list[Wire]],
) -> Iterator[str]:
    """The nearest nodes with a setting, or without senders, from which messages of these types reach a node."""
    stack, seen = [name], {name}
    while stack:
        at = stack.pop()
        senders = [wire.producer for wire in incoming.get(at, ()) if issubclass(wire.port.type, messages)]
        if at != name and (setting in has[at] or not senders):
            yield at
            continue
        stack += [sender for sender in senders if sender not in seen]
        seen.update(senders)


def _follow(
    name: str,
    spec: NodeSpec,
    has: Mapping[str, Mapping[str, Any]],
    incoming: Mapping[str, list[Wire]],
    given: Given,
    faults: Faults,
) -> None:
    """Set the settings of a node that follow its senders, of all that the nodes have, and are not given."""
    for setting in settings(spec.cls).values():
        mark = next((mark for mark in setting.marks if isinstance(mark, Follows)), None)
        if mark is None or setting.name in given.get(name, {}):
            continue
        found = [at for at in _senders(name, setting.name, (mark.message,), has, incoming) if setting.name in has[at]]
        values = [value for at in found if (value := has[at][setting.name]) is not None]
        if values:
            _set(setting.name, spec, max(values), found[0], spec.place, faults)


def _settle(setting: str, group: Sequence[NodeSpec], given: Given, faults: Faults) -> None:
    """Set one value in all nodes of a group; a fault if those that are given, or else the defaults, differ."""
    if any(spec.settings.get(setting) is None for spec in group):
        return  # it has a fault
    chosen = [spec for spec in group if setting in given.get(spec.name, {})]
    chosen = chosen or _derive(setting, group, given) or list(group)
    value, first = chosen[0].settings[setting], chosen[0]
    other = next((spec for spec in chosen if spec.settings[setting] != value), None)
    if other is not None:
        unit = settings(first.cls)[setting].unit
        targets = " and ".join(f"{spec.name}.{setting}" for spec in (first, other))
        both = " and ".join(_describe(spec, setting, given) for spec in (first, other))
        faults.add(
            f"found {both}, expected one value, because both describe the same thing",
            f"Set the same value for {targets}, or in the scene.",
            given.get(other.name, {}).get(setting, other.place), node=other.name, setting=setting, unit=unit,
        )  # fmt: skip
        return
    place = given.get(first.name, {}).get(setting)
    for spec in group:
        if place is not None:
            given.setdefault(spec.name, {})[setting] = place
        if spec.settings[setting] != value:
            _set(setting, spec, value, first.name, place or spec.place, faults)


def _set(setting: str, spec: NodeSpec, value: Any, source: str, place: Location, faults: Faults) -> None:
    """Set a setting of a node; a fault if it refuses the value, which another node has."""
    before, spec.settings[setting] = spec.settings[setting], value
    try:
        spec.cls(**spec.settings)
    except SettingError as error:
        spec.settings[setting] = before
        faults.add(f"{error}, the value of {source}", "", place, node=spec.name)


def _derive(setting: str, group: Sequence[NodeSpec], given: Given) -> list[NodeSpec]:
    """The nodes of a group that set what the setting is twice of. They get this value, from the same place."""
    found = []
    for spec in group:
        half = mark.twice if (mark := mark_of(settings(spec.cls)[setting])) else ""
        if half in given.get(spec.name, {}) and (value := spec.settings.get(half)) is not None:
            spec.settings[setting] = 2.0 * value
            given[spec.name][setting] = given[spec.name][half]
            found.append(spec)
    return found


def _describe(spec: NodeSpec, setting: str, given: Given) -> str:
    place = given.get(spec.name, {}).get(setting)
    return f"{written(spec.settings[setting])} in {spec.name}" + (f" ({place})" if place else "")
