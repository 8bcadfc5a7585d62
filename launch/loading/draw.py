"""A plan as a Mermaid flow chart, a text that GitHub, editors and https://mermaid.live draw.

Solid edges are direct, dashed ones hold the message of the tick before; grey nodes do not run.
"""

from __future__ import annotations

from palpate.launch.loading.plan import Plan


def mermaid(plan: Plan) -> str:
    """The plan as a Mermaid flow chart."""
    nodes = plan.graph.nodes
    ids = {name: f"n{i}" for i, name in enumerate(nodes)}
    lines = ["flowchart LR"]
    for name, spec in nodes.items():
        lines.append(f'  {ids[name]}["{name}<br/>{spec.use}"]')
    for name, edges in plan.edges.items():
        for edge in edges:
            kind = plan.graph.streams[edge.stream].__name__
            lines.append(f"  {ids[edge.producer]} {'-.->' if edge.loop else '-->'}|{kind}| {ids[name]}")
    if plan.skipped:
        lines.append("  classDef skipped stroke-dasharray: 4 4,color:#888,fill:#f2f2f2")
        lines.append(f"  class {','.join(ids[name] for name in plan.skipped)} skipped")
    if plan.observers:
        lines.append("  classDef observer fill:#fff7e0")
        lines.append(f"  class {','.join(ids[name] for name in plan.observers)} observer")
    return "\n".join(lines) + "\n"
