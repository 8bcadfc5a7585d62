"""A plan as a Mermaid flow chart, a text that GitHub, editors and https://mermaid.live draw.

Solid edges are direct, dashed ones hold the message of the tick before; grey nodes do not run.
"""

from __future__ import annotations

from palpate.engine.plan import Plan

SHARES = (0.05, 0.15, 0.3)  # shares of the time of a tick from which a node is drawn darker
SHADES = ("#e8f1fa", "#bcd7ee", "#7fb2dd", "#4a90c8")


def mermaid(plan: Plan, times: dict[str, float] | None = None) -> str:
    """The plan as a Mermaid flow chart; with the duration [s] of each node's step, the darker a node the more of a tick
    it takes."""
    nodes = plan.graph.nodes
    ids = {name: f"n{i}" for i, name in enumerate(nodes)}
    lines = ["flowchart LR"]
    for name, spec in nodes.items():
        taken = f"<br/>{(times or {})[name] * 1e6:.1f} µs" if name in (times or {}) else ""
        lines.append(f'  {ids[name]}["{name}<br/>{spec.use}{taken}"]')
    for name, edges in plan.edges.items():
        for edge in edges:
            kind = plan.graph.streams[edge.stream].__name__
            lines.append(f"  {ids[edge.producer]} {'-.->' if edge.loop else '-->'}|{kind}| {ids[name]}")
    lines += _shades(plan, times or {}, ids)
    if plan.skipped:
        lines.append("  classDef skipped stroke-dasharray: 4 4,color:#888,fill:#f2f2f2")
        lines.append(f"  class {','.join(ids[name] for name in plan.skipped)} skipped")
    if plan.observers:
        lines.append("  classDef observer fill:#fff7e0")
        lines.append(f"  class {','.join(ids[name] for name in plan.observers)} observer")
    return "\n".join(lines) + "\n"


def _shades(plan: Plan, times: dict[str, float], ids: dict[str, str]) -> list[str]:
    taken = {name: times[name] / plan.graph.nodes[name].every for name in plan.order if name in times}
    whole = sum(taken.values())
    lines = []
    for name, time in taken.items():
        shade = SHADES[sum(time > share * whole for share in SHARES)]
        lines.append(f"  style {ids[name]} fill:{shade}")
    return lines
