"""Builds the job of each worker from a plan and a placement."""

from collections.abc import Collection

from palpate.compiler.cores import usable_cores
from palpate.engine.graph import places
from palpate.engine.job import Job, node_job, observer_job
from palpate.engine.plan import Plan, force_path
from palpate.launch.load.placement import Placement, ProcessGroup
from palpate.nodes.base import inputs

PRIORITY = 60
"""Real-time priority of the force path on the real clock, if permitted. Paced nodes get one more, so that no other node
can delay the device when its torque must go to zero."""


def jobs(
    plan: Plan,
    placement: Placement,
    *,
    clock: str = "simulated",
    ticks: int | None = None,
    pace: float | None = None,
    about: dict[str, object] | None = None,
    joined: Collection[str] = (),
) -> list[Job]:
    """One job per group of the placement, with the nodes in the plan's order.

    clock  "simulated" or "real"
    ticks  number of ticks, None: until stopped
    pace   see `Job`

    joined  groups that are started by hand, perhaps on a machine with other cores

    Groups without a `core:` get those of `cores_of`; joined ones where they are started.
    """
    path = force_path(plan)
    links = _links(plan, path)
    place = {name: group.name for group in placement.groups for name in group.nodes}
    assignments = []
    for phase, group in enumerate(placement.groups):
        names = [name for name in plan.order if name in group.nodes]
        on_path = any(name in path for name in names)
        paced = [name for name in names if plan.graph.nodes[name].cls.paced]
        leads, apart = bool(paced), clock == "real" and len(paced) == len(group.nodes)
        assignments.append(
            Job(
                group=group.name,
                nodes=tuple(node_job(plan, name, path) for name in names),
                observers=tuple(observer_job(plan, name) for name in group.nodes if name in plan.observers),
                clock=clock,
                rate=plan.graph.rate,
                ticks=ticks,
                pace=pace,
                links=links,
                core=group.core or (None if group.name in joined else cores_of(on_path, apart, len(placement.groups))),
                priority=group.priority or (PRIORITY + leads if on_path else None),
                host=group.host,
                phase=phase,
                leads=leads,
                external=_external(plan, place, group),
                about=about or {},
            )
        )
    return assignments


def spared_nodes(plan: Plan) -> frozenset[str]:
    """Nodes whose death does not end a run on the real clock: optional parts of the graph (`when:`) that only optional
    inputs read. An energy ledger is not among them: it is a safety check that the user has switched on."""
    needed = set()
    for name in plan.order:
        optional = {port.name for port in inputs(plan.graph.nodes[name].cls) if port.optional}
        needed |= {edge.producer for edge in plan.edges[name] if edge.port not in optional}
    nodes = plan.graph.nodes
    return frozenset(n for n in plan.order if nodes[n].when and nodes[n].cls.effect != "energy" and n not in needed)


def _links(plan: Plan, path: set[str]) -> int:
    count = 0
    for name in path:
        cls = plan.graph.nodes[name].cls
        held = places(cls, plan.edges[name])[0 if cls.paced else 1 :]
        count += sum(edge is not None and not port.optional and edge.producer in path for port, edge in held)
    return count


def _external(plan: Plan, place: dict[str, str], group: ProcessGroup) -> dict[str, tuple[str, ...]]:
    """Streams of a group that other groups read, and the groups that read each."""
    readers: dict[str, dict[str, None]] = {}
    for name in plan.order:
        for edge in plan.edges[name]:
            if place[edge.producer] == group.name != place[name]:
                readers.setdefault(edge.stream, {})[place[name]] = None
    return {stream: tuple(groups) for stream, groups in readers.items()}


def cores_of(on_path: bool, apart: bool, groups: int) -> tuple[int, ...] | None:
    """The force path gets one core, since a wake-up on another core costs more than a context switch; all other groups
    use the other cores.

    apart  paced nodes without others, on the real clock. They get another core: if processes of real-time priority use
           a core completely, the kernel stops them for 50 ms of each second, in which the device would keep its torque
    """
    if groups < 2 or len(cores := usable_cores()) < 2:
        return None
    if not on_path:
        return tuple(cores[:-1])
    return (cores[-2],) if apart else (cores[-1],)
