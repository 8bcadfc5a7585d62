"""Random runs of processes, and random faults of them."""

from __future__ import annotations

import random
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from palpate.engine.job import Job
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import Placement, ProcessGroup
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs

MODULE = "palpate.studies.faults.launcher.nodes"
GRAPH = {
    "source": "{{use: {0}.Source, in: {{torque: sum}}}}",
    "spring": "{{use: {0}.Spring, in: {{pose: source}}}}",
    "drag": "{{use: {0}.Drag, in: {{pose: source, force: spring}}}}",
    "sum": "{{use: {0}.Sum, in: {{force: spring{1}}}}}",
    "second": "{{use: {0}.Second}}",
    "log": "{{use: {0}.Log, in: all}}",
}
HERE, FAR = "10.0.0.1", "10.0.0.2"
REPORTS = ("Starting", "Ready", "Linked", "Alive", "Paused", "Observes", "NodesEnded")
OUTAGES = ("break", "part")
BENIGN = ("stall", "pause", "absent helper")
KINDS = ("kill", "exit", "raise", "hang", "stop", "pause", "server", "interrupt", "stall", *OUTAGES, "power", "helper",
         "leave")  # fmt: skip
"""kill       SIGKILL of a worker
exit       a worker ends with an exit code and without a report
raise      a call of a node raises
hang       a call of a node never returns
stop       SIGSTOP of a worker
pause      the same for less than the patience
server     SIGKILL of the fork server
interrupt  Ctrl-C of the run
stall      the launcher gets no processor
break      the connection of a joined worker to the launcher breaks and returns
part       its connections to other workers do
power      a joined machine is switched off
helper     the second process of a joined worker is killed
leave      Ctrl-C in the terminal of a joined worker"""


@dataclass(frozen=True)
class Moment:
    """When a fault strikes.

    at      [s] after the beginning of the run; None: at an event
    report  after the `count`-th report of this type of the group, `at_once` before it has left its process
    call    in the `count`-th call of this kind of the node
    delay   [s] after the report
    """

    at: float | None = None
    report: str = ""
    call: str = ""
    count: int = 1
    delay: float = 0.0

    def __str__(self) -> str:
        if self.at is not None:
            return f"at {self.at:.4f} s"
        if self.report:
            return f"{1e6 * self.delay:.0f} us after its report {self.count} of {self.report}"
        return f"in its call {self.count} of {self.call}"


@dataclass(frozen=True)
class Fault:
    """What happens to a process.

    kind      one of `KINDS`
    group     of the worker; "": launcher or fork server
    node      whose call fails
    moment    when
    duration  [s] of pauses, stalls and outages
    status    exit code
    """

    kind: str
    group: str
    moment: Moment
    node: str = ""
    duration: float = 0.0
    status: int = 0

    def __str__(self) -> str:
        lasts = f" for {self.duration:.3f} s"
        what = {"exit": f" with code {self.status}"} | dict.fromkeys(("pause", "stall", *OUTAGES), lasts)
        return f"{self.kind} {self.node or self.group or 'run'}{what.get(self.kind, '')} {self.moment}"


@dataclass(frozen=True)
class Scene:
    """A run: its graph, groups of nodes, and settings of the launcher; with its faults.

    steps  [s] of virtual time that a call of each node takes
    slow   fraction of the messages that are late
    """

    seed: int
    clock: str
    rate: float
    ticks: int | None
    groups: tuple[tuple[str, ...], ...]
    joined: frozenset[str]
    restart: frozenset[str]
    spared: frozenset[str]
    patience: float
    steps: tuple[tuple[str, float], ...]
    slow: float
    faults: tuple[Fault, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        return tuple(name for group in self.groups for name in group)

    def name(self, group: tuple[str, ...]) -> str:
        return "-".join(group)

    def nodes_of(self, group: str) -> tuple[str, ...]:
        return next(nodes for nodes in self.groups if self.name(nodes) == group)

    def jobs(self) -> list[Job]:
        """The jobs of the workers, as of a launch file."""
        return _jobs(self.groups, self.joined, self.clock, self.rate, self.ticks)

    def but(self, faults: tuple[Fault, ...]) -> Scene:
        return replace(self, faults=faults)

    def __str__(self) -> str:
        groups = ", ".join(f"{self.name(g)}{' (joined)' if self.name(g) in self.joined else ''}" for g in self.groups)
        more = "".join(f", {word}: {', '.join(sorted(names))}" for word, names in
                       (("restart", self.restart), ("spared", self.spared)) if names)  # fmt: skip
        ticks = "until stopped" if self.ticks is None else f"{self.ticks} ticks"
        return f"{self.clock} clock, {self.rate:g} Hz, {ticks}, patience {self.patience:g} s; {groups}{more}"


@cache
def _jobs(
    groups: tuple[tuple[str, ...], ...], joined: frozenset[str], clock: str, rate: float, ticks: int | None
) -> list[Job]:
    names = {name for group in groups for name in group}
    lines = [f"rate: {rate:g} Hz", "nodes:"]
    lines += [f"  {name}: " + text.format(MODULE, ", friction: drag" if "drag" in names else "")
              for name, text in GRAPH.items() if name in names]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "simulated.yaml"
        file.write_text("\n".join(lines))
        planned = plan(LaunchFile(graph=file).load())
    ordered = {name: k for k, name in enumerate([*planned.order, *planned.observers])}
    placed = []
    for group in groups:
        name = "-".join(group)
        host = None if not joined else FAR if name in joined else HERE
        placed.append(ProcessGroup(name, sorted(group, key=ordered.__getitem__), host=host))
    return jobs(planned, Placement(placed), clock=clock, ticks=ticks)


def draw_scene(seed: int) -> Scene:
    """The run of a seed, with one to four faults, or none."""
    random_ = random.Random(f"scene {seed}")
    clock = random_.choice(["real", "simulated"])
    names = ["source", "spring", "sum"]
    names += [name for name, share in (("drag", 0.6), ("second", 0.25)) if random_.random() < share]
    groups: list[list[str]] = []
    for name in names:
        if groups and random_.random() < 0.4:
            random_.choice(groups).append(name)
        else:
            groups.append([name])
    if random_.random() < 0.85:
        if random_.random() < 0.7:
            groups.append(["log"])
        else:
            random_.choice(groups).append("log")
    given = tuple(tuple(group) for group in groups)
    labels = ["-".join(group) for group in given]
    joined = frozenset(random_.sample(labels, min(len(labels), random_.choice([1, 1, 2])))
                       if random_.random() < 0.35 else [])  # fmt: skip
    restart = frozenset(name for group in given if clock == "real" and random_.random() < 0.4 for name in group)
    rate = random_.choice([50.0, 100.0, 250.0] if clock == "real" else [1000.0])
    length = random_.choice([0.1, 0.5, 1.5, 4.0 if clock == "real" and rate < 200.0 else 1.5])  # [s]
    step = 0.1 / rate if clock == "real" else random_.choice([2e-4, 2e-3, 1e-2])
    ticks = max(2, round(length * random_.random() * (rate if clock == "real" else 0.3 / step)))
    stopped = random_.random() < 0.3
    optional = "drag" in names and random_.random() < 0.5
    steps = {name: step * (3.0 if name == "second" else random_.uniform(0.2, 1.0)) for name in names}
    scene = Scene(
        seed, clock, rate, None if stopped else ticks, given, joined, restart, frozenset(["drag"] if optional else []),
        random_.choice([0.6, 1.0, 2.0]), tuple(steps.items()), random_.choice([0.0, 0.002, 0.002, 0.02]),
    )  # fmt: skip
    count = random_.choice([0, 1, 1, 1, 2, 2, 3, 4])
    faults = [_draw_fault(scene, random_, length) for _ in range(count)]
    if scene.ticks is None and not any(fault.kind == "interrupt" and fault.moment.at for fault in faults):
        faults.append(Fault("interrupt", "", Moment(at=0.4 + length * random_.random())))
    return scene.but(tuple(faults))


def _draw_fault(scene: Scene, random_: random.Random, length: float) -> Fault:
    group = random_.choice(scene.groups)
    weights = {"kill": 5, "exit": 3, "raise": 3, "hang": 2, "stop": 2, "pause": 3, "server": 1, "interrupt": 4,
               "stall": 3}  # fmt: skip
    if scene.joined and random_.random() < 0.6:
        group = scene.nodes_of(random_.choice(sorted(scene.joined)))
        weights |= {"break": 6, "part": 4, "power": 3, "helper": 2, "leave": 3, "server": 0}
    kind = random_.choices(list(weights), list(weights.values()))[0]
    name, duration = scene.name(group), 0.0
    moment = _draw_moment(random_, length)
    if kind in ("raise", "hang"):
        node = random_.choice(group)
        call = random_.choices(["start", "step", "stop"], [2, 6, 1 if kind == "raise" else 0])[0]
        count = 1 if call == "start" else random_.randint(1, 3 if call == "stop" else 40)
        return Fault(kind, name, Moment(call=call, count=count), node=node)
    if kind in ("server", "interrupt", "stall"):
        name, moment = "", Moment(at=moment.at if moment.at is not None else random_.random() * (0.4 + length))
    if kind in ("pause", "stall"):
        duration = random_.random() ** 2 * (0.35 * scene.patience if kind == "pause" else 3.0)
    if kind in OUTAGES:
        duration = random_.random() ** 2 * 2.0
    status = random_.choice([0, 1, 3, -11]) if kind == "exit" else 0
    return Fault(kind, name, moment, duration=duration, status=status)


def _draw_moment(random_: random.Random, length: float) -> Moment:
    if random_.random() < 0.5:
        return Moment(at=random_.random() * (0.4 + length))
    delay = random_.choice([0.0, 1e-5, 1e-4, 1e-3, 2e-2])
    return Moment(report=random_.choice(REPORTS), count=random_.choice([1, 1, 2, 3]), delay=delay * random_.random())
