"""Costs of the effects of a plan: whether each is on, the rule that decided it, and the nodes that run only for it."""

import copy
from dataclasses import dataclass, field, replace

from palpate.engine.faults import NOWHERE, GraphError
from palpate.engine.graph import EffectChoice
from palpate.engine.plan import Plan
from palpate.launch.load.effects import by_effect, state, trim_fields
from palpate.launch.load.plan import plan
from palpate.nodes.base import Effect, inputs


@dataclass
class EffectCost:
    """One effect and its cost.

    on      whether it is computed
    rule    the rule that decided it
    where   the nodes that can compute it; `node.setting` if a setting switches it
    nodes   nodes that run only for it
    fields  fields that are computed only for it, `stream.field`
    setting whether a setting switches it
    observed whether only observers compute it, so that no message depends on it
    price   [s] time of `nodes` per tick; None: not measured
    proof   how the forces change if it is toggled; None: not tried
    """

    effect: str
    about: str
    on: bool
    rule: str
    where: list[str]
    setting: bool = False
    observed: bool = False
    nodes: list[str] = field(default_factory=list)
    fields: list[str] = field(default_factory=list)
    price: float | None = None
    proof: str | None = None


def effect_costs(planned: Plan, times: dict[str, float] | None = None) -> list[EffectCost]:
    """One item for each effect that a node of the graph can compute; active effects first.

    times  [s] measured step time of each node
    """
    able = by_effect((spec.name, spec.cls) for spec in planned.graph.nodes.values())
    items = [_item(planned, name, parts, times or {}) for name, parts in able.items()]
    return sorted(items, key=lambda item: not item.on)


def _item(planned: Plan, name: str, able: list[tuple[str, Effect]], times: dict[str, float]) -> EffectCost:
    nodes = planned.graph.nodes
    running = [(node, e) for node, e in able if node in planned.edges or node in planned.observers]
    on = any(
        state(nodes[node].cls, nodes[node].settings, e, planned.fields(node) if node in planned.edges else frozenset())
        for node, e in running
    )
    where = [f"{node}.{e.setting}" if e.setting else node for node, e in able]
    about = next((e.about for _, e in able if e.about), "")
    setting = all(e.how == "setting" for _, e in able)
    observed = all(nodes[node].observer for node, _ in able)
    item = EffectCost(name, about, on, _rule(planned, name, able, on), list(dict.fromkeys(where)), setting, observed)
    if on:
        without = _without(planned, name, able)
        if without is not None:
            item.nodes = [
                n for n in (*planned.order, *planned.observers) if n not in (*without.order, *without.observers)
            ]
            item.fields = [
                f"{stream}.{f}"
                for stream, names in planned.wanted.items()
                if stream in without.wanted
                for f in sorted(names - without.wanted[stream])
            ]
        measured = [times[n] / nodes[n].every for n in item.nodes if n in times]
        item.price = sum(measured) if measured else None
    return item


def _without(planned: Plan, name: str, able: list[tuple[str, Effect]]) -> Plan | None:
    """The plan with one effect off; None if the graph cannot run without it."""
    graph = planned.graph
    off = {n for n, e in able if e.how == "node"}
    specs = {n: replace(spec, off="off") if n in off else copy.copy(spec) for n, spec in graph.nodes.items()}
    switched = graph.effects | {name: EffectChoice(False, NOWHERE)}
    try:
        other = plan(replace(graph, nodes=specs, effects=switched))
    except GraphError:
        return None
    wanted = {s: planned.wanted[s] & names for s, names in other.wanted.items() if s in planned.wanted}
    return replace(other, wanted=trim_fields(wanted, switched, [specs[n] for n in other.edges]))


def _rule(planned: Plan, name: str, able: list[tuple[str, Effect]], on: bool) -> str:
    graph = planned.graph
    if name in graph.effects:
        choice = graph.effects[name]
        return f"effects: {name} is {choice.word} ({choice.place})"
    node, effect = able[0]
    spec = graph.nodes[node]
    if effect.how == "setting":
        return f"{node}.{effect.setting} is {spec.settings[effect.setting]}"
    if node in planned.skipped:
        return planned.skipped[node]
    if effect.how == "part":
        return _readers(planned, node, effect, on)
    if spec.when is not None:
        return f"{spec.when} holds ({spec.place})"
    return f"{node} is in the graph ({spec.place})"


def _readers(planned: Plan, node: str, effect: Effect, on: bool) -> str:
    names = " or ".join(effect.fields)
    if not on:
        return f"output unused: {names}"
    graph = planned.graph
    streams = graph.nodes[node].streams
    readers = [reader for reader, edges in planned.edges.items() if any(e.stream in streams for e in edges)]
    by = []
    for reader in readers:
        ports = {p.name: p for p in inputs(graph.nodes[reader].cls)}
        if any(ports[e.port].wants & set(effect.fields) for e in planned.edges[reader] if e.stream in streams):
            by.append(reader)
    by += [n for n in planned.observers if not by and graph.nodes[n].settings.get("fields", "all")]
    return f"{names}: read by {', '.join(by)}" if by else f"{names}: wanted"
