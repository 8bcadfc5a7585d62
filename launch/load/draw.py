"""A plan as a Mermaid flow chart, a text that GitHub, editors and https://mermaid.live draw.

Solid edges are direct, dashed ones hold the message of the tick before; grey nodes do not run.
"""

from palpate.engine.plan import Plan

SHARES = (0.05, 0.15, 0.3)  # shares of the time of a tick from which a node is drawn darker
SHADES = ("#e8f1fa", "#bcd7ee", "#7fb2dd", "#4a90c8")


def mermaid(plan: Plan, times: dict[str, float] | None = None) -> str:
    """The plan as a Mermaid flow chart; with the duration [s] of each node's step, the darker a node the more of a tick
    it takes."""
    nodes, times = plan.graph.nodes, times or {}
    ids = {name: f"n{i}" for i, name in enumerate(nodes)}
    lines = ["flowchart LR"]
    for name, spec in nodes.items():
        taken = f"<br/>{times[name] * 1e6:.1f} µs" if name in times else ""
        lines.append(f'  {ids[name]}["{name}<br/>{spec.use}{taken}"]')
    for name, edges in plan.edges.items():
        for edge in edges:
            kind = plan.graph.streams[edge.stream].__name__
            lines.append(f"  {ids[edge.producer]} {'-.->' if edge.loop else '-->'}|{kind}| {ids[name]}")
    taken_by = {name: times[name] / nodes[name].every for name in plan.order if name in times}
    for name, time in taken_by.items():
        shade = SHADES[sum(time > share * sum(taken_by.values()) for share in SHARES)]
        lines.append(f"  style {ids[name]} fill:{shade}")
    if plan.skipped:
        lines.append("  classDef skipped stroke-dasharray: 4 4,color:#888,fill:#f2f2f2")
        lines.append(f"  class {','.join(ids[name] for name in plan.skipped)} skipped")
    if plan.observers:
        lines.append("  classDef observer fill:#fff7e0")
        lines.append(f"  class {','.join(ids[name] for name in plan.observers)} observer")
    return "\n".join(lines) + "\n"
