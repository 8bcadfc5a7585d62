"""Placement: groups of nodes that share a process, with core, priority and host.

    loop: {nodes: [device, finger, contact, controller], core: 0, priority: 80}
    rest: {nodes: [tissue, log], core: [1], host: tcp://10.0.0.2}

Placement never changes what is computed.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec

from palpate.compiler.cores import usable_cores
from palpate.engine.faults import Fault, Faults, GraphError, choices
from palpate.engine.plan import Plan, force_path
from palpate.launch.load.files import PLACES, find_file
from palpate.launch.load.values.lines import fill
from palpate.launch.load.values.source import YamlSource, read

FUSED = "fused"
AUTO = "auto"
APART = "apart"
BUILT_IN = (FUSED, AUTO, APART)  # placements without a file
SHARE = 0.5
"""[1] Limit of the median time of the force path, as a fraction of the period, with margin for the worst case."""
AWAY = 100.0
"""[µs] Lower bound of the time per tick of a node that gets a separate process, whose messages cost about 40 µs."""
_Core = Annotated[int, msgspec.Meta(ge=0)]
_Cores = Annotated[list[_Core], msgspec.Meta(min_length=1)]
_HOST = r"^(tcp://)?[A-Za-z0-9.-]+(:[0-9]+)?$"


class _GroupLine(msgspec.Struct):
    """One group of the file, see `ProcessGroup`."""

    nodes: Annotated[list[str], msgspec.Meta(min_length=1, description="a list of node names")]
    core: Annotated[_Core | _Cores | None, msgspec.Meta(description="the number of a core from 0, or a list")] = None
    priority: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=99)] | None, msgspec.Meta(description="a whole number from 1 to 99")
    ] = None
    host: Annotated[
        Annotated[str, msgspec.Meta(pattern=_HOST)] | None,
        msgspec.Meta(description="a name or address such as tcp://10.0.0.2 or tcp://10.0.0.2:5600"),
    ] = None
    join: Annotated[bool, msgspec.Meta(description="true or false")] = False


@dataclass
class ProcessGroup:
    """Nodes that share one process.

    nodes     names, in the plan's order, observers last
    core      CPU cores that the process may use, None: any
    priority  of SCHED_RR, 1 to 99, None: ordinary scheduling
    host      name or address of the machine, with or without a port; None: this one, no network
    join      started by hand with `palpate remote join`, as every group on another machine
    why       the reason for this group, if `auto` made it
    """

    name: str
    nodes: list[str]
    core: tuple[int, ...] | None = None
    priority: int | None = None
    host: str | None = None
    join: bool = False
    why: str = ""


@dataclass
class Placement:
    """The groups of a plan; each running node is in exactly one."""

    groups: list[ProcessGroup] = field(default_factory=list)

    def group_of(self, node: str) -> ProcessGroup:
        """The group that runs a node. KeyError: the plan does not run it."""
        return {name: group for group in self.groups for name in group.nodes}[node]


def fuse_nodes(plan: Plan) -> Placement:
    """Everything in one process."""
    return Placement([ProcessGroup(FUSED, _names(plan))])


def apart(plan: Plan) -> Placement:
    """Each node in a separate process."""
    return Placement([ProcessGroup(name, [name]) for name in _names(plan)])


def auto(plan: Plan, times: Mapping[str, float] | None = None, cores: Collection[int] | None = None) -> Placement:
    """The force path in one process, all other nodes in another. Within a process a message costs a function call,
    between processes a wake-up; with more processes than cores the force path would wait for other processes.

    times  [s] median step of each node. If the path takes more than `SHARE` of a period, its slowest node whose output
           the path uses only in the next tick (a body) gets a separate process and core, and computes in parallel. The
           path gets the last core
    cores  usable cores; None: those of this process
    """
    times, free = times or {}, sorted(usable_cores() if cores is None else cores)[:-1]
    path, period = force_path(plan), 1e6 / plan.graph.rate
    now = {edge.producer for name in path for edge in plan.edges[name] if not edge.loop}
    costs = {name: 1e6 * times.get(name, 0.0) / plan.graph.nodes[name].every for name in path}
    groups = []
    movable = sorted(path - now - {name for name in path if plan.graph.nodes[name].cls.paced}, key=costs.__getitem__)
    while movable and free and sum(costs.values()) > SHARE * period and costs[movable[-1]] > AWAY:
        name = movable.pop()
        why = f"{costs.pop(name):.0f} of {period:.0f} µs a tick, used in the next one"
        groups.append(ProcessGroup(name, [name], core=(free.pop(),), why=why))
    load = f", {sum(costs.values()):.0f} of {period:.0f} µs a tick" if times else "; no step times yet"
    groups.insert(0, ProcessGroup("loop", [name for name in plan.order if name in costs], why=f"force path{load}"))
    others = [name for name in _names(plan) if name not in path]
    groups.append(ProcessGroup("rest", others, why="off the force path"))
    return Placement([group for group in groups if group.nodes])


def find_place(given: str | Path | None) -> str | Path | None:
    """A placement for a launch file: a word of `BUILT_IN`, or a file. GraphError: no such file."""
    if given is None or str(given) in BUILT_IN:
        return given
    return find_file(str(given), PLACES, what="placement", words=BUILT_IN)


def load_place(path: str | Path | Placement | None, plan: Plan, times: Mapping[str, float] | None = None) -> Placement:
    """The placement of a plan.

    path   a placement, a file, or the name of a shipped one; "fused": one process, "auto": see `auto`, "apart" or None:
           a process per node
    times  [s] step times, for `auto`

    Nodes that the plan skips are left out; running nodes that the file does not name get a process each.
    GraphError: all faults of the file.
    """
    if isinstance(path, Placement):
        placed = [name for group in path.groups for name in group.nodes]
        return Placement([*path.groups, *(ProcessGroup(name, [name]) for name in _names(plan) if name not in placed)])
    if path is None or str(path) in BUILT_IN:
        return auto(plan, times) if path == AUTO else fuse_nodes(plan) if path == FUSED else apart(plan)
    source = read(find_file(str(path), PLACES, what="placement", words=BUILT_IN))
    if not isinstance(source.data, dict):
        text = "expected a mapping of group names to {nodes: [...], core: ...}"
        raise GraphError([Fault(text, place=source.place())])
    faults, running = Faults(), _names(plan)
    taken: dict[str, str] = {}
    groups = []
    for name in source.data:
        group = _group(name, source.sub(name), list(plan.graph.nodes), taken, faults)
        group.nodes = [n for n in running if n in group.nodes]
        groups.append(group)
    for name in running:
        if name not in taken:
            if name in source.data:
                faults.add(f"group {name!r} has the name of a node that is not in it",
                           f"Rename the group, or put node {name!r} into a group.", source.place(name))  # fmt: skip
            groups.append(ProcessGroup(name, [name]))
    faults.done()
    return Placement([g for g in groups if g.nodes])


def _names(plan: Plan) -> list[str]:
    return [*plan.order, *plan.observers]


def _group(name: str, line: YamlSource, known: list[str], taken: dict[str, str], faults: Faults) -> ProcessGroup:
    about = f"group {name!r}"
    if isinstance(line.data, list):
        line = YamlSource({"nodes": line.data}, {("nodes", *keys): place for keys, place in line.places.items()})
    if not isinstance(line.data, dict):
        faults.add(f"{about}: found {line.data!r}, expected {{nodes: [...], core: ...}}", "", line.place())
        return ProcessGroup(name, [])
    given = fill(_GroupLine, line, faults, about)
    if given is None:
        return ProcessGroup(name, [])
    members = []
    for index, node in enumerate(given.nodes):
        place = line.place("nodes", index)
        if node not in known:
            faults.add(f"{about}: there is no node {node!r}", choices("Nodes", node, known), place)
        elif node in taken:
            faults.add(f"{about}: node {node!r} is in group {taken[node]!r} already", "Remove one.", place)
        else:
            taken[node] = name
            members.append(node)
    cores = given.core if isinstance(given.core, list) else [given.core] if given.core is not None else []
    return ProcessGroup(
        name,
        members,
        core=tuple(cores) or None,
        priority=given.priority,
        host=given.host and given.host.removeprefix("tcp://"),
        join=given.join,
    )
