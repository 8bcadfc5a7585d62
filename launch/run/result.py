"""The result of a run, and the verdict whether it kept its rate on the real clock."""

from dataclasses import dataclass, field

import msgspec

from palpate.engine.plan import Plan


class NodeFault(msgspec.Struct, frozen=True, tag=True):
    """The failure of a node, with its traceback or output; an empty name means the whole process. Also the report of
    it."""

    node: str
    where: str
    text: str
    trace: str = ""

    def __str__(self) -> str:
        return f"node {self.node!r}, {self.where}: {self.text}" if self.node else f"{self.where}: {self.text}"


@dataclass
class Result:
    """The result of a run.

    deaths       nodes that failed
    health       the counters of each node
    start        [s] from the launcher's start to tick 0
    origin       [s] of the machine's monotonic clock at tick 0
    wall         [s] from tick 0 to the end
    ticks        number of ticks
    signal       number of the signal that stopped it; 0: none
    notes        lines for the user: denied priorities, dropped frames; those of nodes are of `RunNote`
    live         notes that a live view has printed during the run
    """

    deaths: list[NodeFault] = field(default_factory=list)
    health: dict[str, dict] = field(default_factory=dict)
    start: float = 0.0
    origin: float = 0.0
    wall: float = 0.0
    ticks: int = 0
    signal: int = 0
    notes: list[str] = field(default_factory=list)
    live: set[str] = field(default_factory=set)

    @property
    def ok(self) -> bool:
        return not self.deaths

    @property
    def interrupted(self) -> bool:
        return bool(self.signal)


LATE, OVERDUE = 1e-3, 1e-2
"""[1] Limits of a run that counts as real time: fraction of ticks left out, and of ticks answered after the next one
began."""


@dataclass(frozen=True)
class Verdict:
    """How many of the due ticks were in time.

    rate     [Hz]
    due      ticks of the run
    late     ticks that the device left out
    overdue  ticks whose force arrived after the next tick began, or not at all
    """

    rate: float
    due: int
    late: int
    overdue: int

    @property
    def kept(self) -> bool:
        """Whether the run counts as real time."""
        return self.due > 0 and self.late <= LATE * self.due and self.overdue <= OVERDUE * self.due

    def __str__(self) -> str:
        if not self.due:
            return f"not real time: no tick of {self.rate:g} Hz was run"
        share = f"{_percent((self.due - self.late - self.overdue) / self.due)} of {self.due} ticks in time"
        if self.kept:
            return f"kept {self.rate:g} Hz: {share}"
        late, overdue = _percent(self.late / self.due), _percent(self.overdue / self.due)
        return f"not real time: {late} of {self.due} ticks left out, {overdue} answered after the next had begun"


def verdict(result: Result, plan: Plan, ticks: int | None) -> Verdict | None:
    """The verdict on a run on the real clock; None without a paced node. `ticks`: planned number of ticks."""
    paced = [name for name in plan.order if plan.graph.nodes[name].cls.paced]
    if not paced:
        return None
    due = ticks if ticks is not None and not result.interrupted and not result.deaths else result.ticks
    late = overdue = 0
    for name in paced:
        every = plan.graph.nodes[name].every
        asked = -(-due // every)
        steps = result.health.get(name, {}).get("steps", 0)
        late = max(late, asked - steps)
        for edge in plan.edges[name]:
            answers = result.health.get(edge.producer, {"steps": 0, "overdue": 0})
            answered = answers["steps"] * plan.graph.nodes[edge.producer].every // every
            overdue = max(overdue, answers["overdue"] + max(0, min(steps, asked) - answered))
    late = min(max(late, 0), due)
    return Verdict(plan.graph.rate, due, late, min(overdue, due - late))


def _percent(share: float) -> str:
    """A percentage with enough digits to distinguish a good run from a perfect one."""
    percent = 100.0 * share
    return f"{percent:.2f} %" if percent > 99.0 or 0.0 < percent < 1.0 else f"{percent:.0f} %"


TROUBLES = {
    "late": "late: ticks that the clock left out, since a whole period had passed",
    "lost": "lost: messages that a node skipped, or that did not arrive within a period",
    "held": "held: steps that reused the previous value of an input",
}
"""Meaning of the columns of the table, printed if one of them is not zero."""
