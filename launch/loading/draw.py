"""A plan as a picture: Mermaid text, or SVG with the nodes in layers from the sources to the sinks.

Solid edges are direct, dashed ones hold the message of the tick before; grey nodes do not run.
"""

from __future__ import annotations

from collections import defaultdict
from html import escape
from itertools import pairwise

from palpate.launch.loading.plan import Plan

BOX, HIGH, COLUMN, ROW, MARGIN = 140, 44, 250, 84, 40  # pixels
INK, RUN, SKIP, HELD = "#1b1f24", "#e8f1fb", "#f2f2f2", "#b3541e"


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


def svg(plan: Plan) -> str:
    """The plan as a stand-alone SVG picture."""
    spots, lanes = _layout(plan)
    rest = [*plan.observers, *plan.skipped]
    right = max((x for x, _ in spots.values()), default=MARGIN) + BOX + 2 * MARGIN
    foot = max((y for _, y in [*spots.values(), *(p for lane in lanes.values() for p in lane)]), default=MARGIN) + HIGH
    loops = [(name, edge) for name, edges in plan.edges.items() for edge in edges if edge.loop]
    shelf = foot + 26 * (len(loops) + 1)
    per_row = max(1, int((right - MARGIN) // (BOX + 20)))
    for i, name in enumerate(rest):
        spots[name] = (MARGIN + (i % per_row) * (BOX + 20), shelf + (i // per_row) * (HIGH + 16))
    bottom = shelf + -(-len(rest) // per_row) * (HIGH + 16) + MARGIN - 10
    kinds = plan.graph.streams
    parts = []
    for name, edges in plan.edges.items():
        for edge in edges:
            if not edge.loop:
                parts += _direct(lanes[edge.producer, name], kinds[edge.stream].__name__)
    for i, (name, edge) in enumerate(loops):
        parts += _held(spots[edge.producer], spots[name], i, foot + 24 + 26 * i, kinds[edge.stream].__name__)
    for name, (x, y) in spots.items():
        parts += _box(name, plan.graph.nodes[name].use, x, y, name in plan.skipped, name in plan.observers)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{right:.0f}" height="{bottom:.0f}" '
            f'viewBox="0 0 {right:.0f} {bottom:.0f}" font-family="sans-serif">',
            '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
            '<path d="M0 0 L8 4 L0 8 z" fill="context-stroke"/></marker></defs>',
            f'<rect width="100%" height="100%" fill="white"/><title>{escape(plan.graph.path.name)}</title>',
            *parts,
            "</svg>\n",
        ]
    )


Point = tuple[float, float]


def _layout(plan: Plan) -> tuple[dict[str, Point], dict[tuple[str, str], list[Point]]]:
    """Top left corners of the boxes, and the way of each direct edge through the layers.

    Layers by longest way; within a layer, sorted by the mean place of the neighbours (Sugiyama, Tagawa and Toda 1981).
    """
    direct = {(e.producer, name): None for name, edges in plan.edges.items() for e in edges if not e.loop}
    layer: dict[str, int] = {}
    for name in plan.order:
        layer[name] = 1 + max((layer[a] for a, b in direct if b == name), default=-1)
    rows: dict[int, list[object]] = defaultdict(list)
    near: dict[object, list[object]] = defaultdict(list)
    for name in plan.order:
        rows[layer[name]].append(name)
    for a, b in direct:
        chain: list[object] = [a, *((a, b, i) for i in range(layer[a] + 1, layer[b])), b]
        for i, way in enumerate(chain[1:-1], layer[a] + 1):
            rows[i].append(way)
        for one, two in pairwise(chain):
            near[one].append(two)
            near[two].append(one)
    height: dict[object, float] = {}
    for row in rows.values():
        height |= {thing: i - (len(row) - 1) / 2 for i, thing in enumerate(row)}
    for _ in range(8):
        for row in rows.values():
            row.sort(key=lambda thing: sum(height[n] for n in near[thing]) / max(1, len(near[thing])))
            height |= {thing: i - (len(row) - 1) / 2 for i, thing in enumerate(row)}
    top = min(height.values(), default=0.0)

    def at(thing: object, column: int) -> Point:
        return MARGIN + column * COLUMN, MARGIN + (height[thing] - top) * ROW

    spots = {name: at(name, layer[name]) for name in plan.order}
    lanes = {}
    for a, b in direct:
        middle = [at((a, b, i), i) for i in range(layer[a] + 1, layer[b])]
        through = [p for x, y in middle for p in ((x, y + HIGH / 2), (x + BOX, y + HIGH / 2))]
        (xa, ya), (xb, yb) = spots[a], spots[b]
        lanes[a, b] = [(xa + BOX, ya + HIGH / 2), *through, (xb, yb + HIGH / 2)]
    return spots, lanes


def _direct(way: list[Point], label: str) -> list[str]:
    path = [f"M{way[0][0]:.0f} {way[0][1]:.0f}"]
    for (xa, ya), (xb, yb) in pairwise(way):
        bend = (xb - xa) / 2 if ya != yb else 0
        path.append(f"C{xa + bend:.0f} {ya:.0f} {xb - bend:.0f} {yb:.0f} {xb:.0f} {yb:.0f}")
    (xa, ya), (xb, yb) = way[-2:]
    return [
        f'<path d="{" ".join(path)}" fill="none" stroke="{INK}" stroke-width="1.3" marker-end="url(#tip)"/>',
        _label(xa + (0.62 if ya != yb else 0.47) * (xb - xa), ya + 0.72 * (yb - ya), label, INK),
    ]


def _held(start: Point, end: Point, lane: int, y: float, label: str) -> list[str]:
    """Out on the right, down beside the column, back below everything, in from the left."""
    gutter = 12 + 9 * lane
    xa, ya, xb, yb = start[0] + BOX, start[1] + 0.75 * HIGH, end[0], end[1] + 0.75 * HIGH
    right, left = xa + gutter, xb - gutter - 8
    path = f"M{xa:.0f} {ya:.0f} H{right:.0f} V{y:.0f} H{left:.0f} V{yb:.0f} H{xb:.0f}"
    style = f'fill="none" stroke="{HELD}" stroke-width="1.3" stroke-dasharray="6 4" marker-end="url(#tip)"'
    style += ' stroke-linejoin="round"'
    return [f'<path d="{path}" {style}/>', _label((right + left) / 2, y, f"{label}, tick before", HELD)]


def _label(x: float, y: float, text: str, colour: str) -> str:
    halo = 'stroke="white" stroke-width="4" paint-order="stroke" stroke-linejoin="round"'
    place = f'x="{x:.0f}" y="{y + 4:.0f}" text-anchor="middle"'
    return f'<text {place} font-size="11" fill="{colour}" {halo}>{escape(text)}</text>'


def _box(name: str, use: str, x: float, y: float, skipped: bool, observer: bool) -> list[str]:
    dash = ' stroke-dasharray="4 4"' if skipped else ""
    ink = "#888" if skipped else INK
    fill = SKIP if skipped else "#fff7e0" if observer else RUN
    middle = x + BOX / 2
    return [
        f'<rect x="{x:.0f}" y="{y:.0f}" width="{BOX}" height="{HIGH}" rx="7" fill="{fill}" stroke="{ink}"{dash}/>',
        f'<text x="{middle:.0f}" y="{y + 19:.0f}" text-anchor="middle" font-size="13" font-weight="bold" '
        f'fill="{ink}">{escape(name)}</text>',
        f'<text x="{middle:.0f}" y="{y + 35:.0f}" text-anchor="middle" font-size="10" '
        f'fill="{ink}">{escape(use)}</text>',
    ]
