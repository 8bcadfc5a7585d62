"""Effects that graphs, scenes and `--set effects.NAME=off` switch: `effects: {friction: off, pressure: on}`.

On: the effect is computed even if no node reads it. Off: its nodes do not run, its fields stay empty, and the settings
that switch it get the value that disables it. By default, `when:` and the inputs of other nodes decide.
"""

from collections.abc import Iterable
from typing import Any

from palpate.engine.faults import Faults, choices
from palpate.engine.graph import EffectChoice, NodeSpec
from palpate.launch.load.classes import catalogue
from palpate.launch.load.values.source import YamlSource
from palpate.messages.wording import written
from palpate.nodes.base import Effect, Node, effects
from palpate.nodes.base.effect import switch

KEY = "effects"


def by_effect(named: Iterable[tuple[str, type[Node]]]) -> dict[str, list[tuple[str, Effect]]]:
    """The effects of these classes by name, sorted: the name of each class that can compute it, and how."""
    table: dict[str, list[tuple[str, Effect]]] = {}
    for name, cls in named:
        for effect in effects(cls):
            table.setdefault(effect.name, []).append((name, effect))
    return dict(sorted(table.items()))


def list_effects() -> dict[str, list[tuple[str, Effect]]]:
    """Each effect that a shipped class can compute: the class's name in `use:` and the kind of effect."""
    return by_effect((entry.use, entry.cls) for entry in catalogue()[0])


def choose_effects(graph: YamlSource, scene: YamlSource, faults: Faults) -> dict[str, EffectChoice]:
    """The effects that are switched explicitly; the scene takes precedence over the graph."""
    switched: dict[str, EffectChoice] = {}
    for source in (graph, scene):
        given = source.data.get(KEY)
        if given is not None and not isinstance(given, dict):
            text = f"effects: found {written(given)}, expected a mapping such as {{friction: off}}"
            faults.add(text, "", source.place(KEY))
            continue
        for name, value in (given or {}).items():
            place = source.place(KEY, str(name))
            if isinstance(value, bool):
                switched[str(name)] = EffectChoice(value, place)
            else:
                faults.add(f"effects, {name}: found {written(value)}, expected on or off", "", place)
    return switched


def apply(switched: dict[str, EffectChoice], nodes: dict[str, NodeSpec], faults: Faults) -> None:
    """Switch nodes and settings. A fault for each effect that no node can compute or leave out, with the classes that
    can. A class without declared parts is assumed to fill all fields of its messages."""
    for name, choice in switched.items():
        parts = [(spec, effect) for spec in nodes.values() for effect in effects(spec.cls) if effect.name == name]
        if not parts:
            if name not in list_effects() or not (choice.on and _fills_effect(name, nodes)):
                _unknown(name, choice, faults)
            continue
        for spec, effect in parts:
            for other in effects(spec.cls) if not choice.on else ():
                if other.name in switched and switched[other.name].on and not set(effect.also).isdisjoint(other.fields):
                    faults.add(f"effects: {other.name} is on, but needs {name}, which is off", "", choice.place)
            if effect.how == "node":
                spec.off = None if choice.on else f"the effect {name} is off ({choice.place})"
            elif effect.how == "setting" and not choice.on:
                mark = switch(spec.cls, effect)
                spec.settings[effect.setting] = mark.without(spec.settings[effect.setting])
        active = [switch(spec.cls, e).has(spec.settings[e.setting]) for spec, e in parts if e.how == "setting"]
        if choice.on and len(active) == len(parts) and not any(active):
            at = ", ".join(f"{spec.name}.{effect.setting}" for spec, effect in parts)
            faults.add(f"effects: {name} is on, but {at} is at the value without it", "Change its value.", choice.place)


def _fills_effect(name: str, nodes: dict[str, NodeSpec]) -> bool:
    """Whether a node without declared parts sends a message with the fields that show an effect."""
    shown = {field for _, effect in list_effects()[name] for field in effect.fields}
    plain = [spec for spec in nodes.values() if all(effect.how != "part" for effect in effects(spec.cls))]
    return any(not shown.isdisjoint(kind.__struct_fields__) for spec in plain for kind in spec.streams.values())


def _unknown(name: str, choice: EffectChoice, faults: Faults) -> None:
    table = list_effects()
    if name in table:
        able = dict.fromkeys(use for use, _ in table[name])
        does = "computes" if choice.on else "can leave out"
        faults.add(
            f"effects: no node of this graph {does} {name!r}",
            f"These do: {', '.join(able)}.",
            choice.place,
        )
    else:
        faults.add(f"effects: there is no effect {name!r}", choices("Effects", name, table), choice.place)


def trim_fields(
    wanted: dict[str, frozenset[str]], switched: dict[str, EffectChoice], specs: Iterable[NodeSpec]
) -> dict[str, frozenset[str]]:
    """Wanted fields of each stream: adds those of effects that are on; removes those of effects that are off and those
    that depend on them."""
    fields = dict(wanted)
    for spec in specs:
        for effect in effects(spec.cls):
            if effect.how != "part" or effect.name not in switched:
                continue
            for stream, kind in spec.streams.items():
                on = switched[effect.name].on
                shown = frozenset(effect.fields if on else effect.fields + effect.also) & set(kind.__struct_fields__)
                fields[stream] = fields[stream] | shown if on else fields[stream] - shown
    return fields


def state(cls: type[Node], settings: dict[str, Any], effect: Effect, fields: frozenset[str]) -> bool:
    """Whether a running node computes an effect, given its settings and the fields that are read."""
    if effect.how == "part":
        return not fields.isdisjoint(effect.fields)
    return effect.how == "node" or switch(cls, effect).has(settings[effect.setting])
