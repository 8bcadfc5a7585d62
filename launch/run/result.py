"""What is known of a run when it has ended."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Death:
    """A node or a whole worker that failed: who, where, why, and its traceback or what it printed."""

    node: str
    where: str
    text: str
    trace: str = ""

    def __str__(self) -> str:
        return f"node {self.node!r}, {self.where}: {self.text}"


@dataclass
class Result:
    """What is known of a run when it has ended.

    deaths       nodes that failed; empty after a good run
    health       the counters of each node
    start        [s] from the launcher's start to tick 0
    origin       [s] of the machine's monotonic clock at tick 0
    wall         [s] from tick 0 to the end
    ticks        number of ticks that were run
    signal       number of the signal by which the user stopped it; 0: none did
    notes        lines that the user should see: refused priorities, frames that were dropped
    foreign      frames that were dropped because they are none of this run's
    """

    deaths: list[Death] = field(default_factory=list)
    health: dict[str, dict] = field(default_factory=dict)
    start: float = 0.0
    origin: float = 0.0
    wall: float = 0.0
    ticks: int = 0
    signal: int = 0
    notes: list[str] = field(default_factory=list)
    foreign: int = 0

    @property
    def ok(self) -> bool:
        """Whether every node lived to the end."""
        return not self.deaths

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped it."""
        return bool(self.signal)
