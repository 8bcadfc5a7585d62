"""What a simulated run did."""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.launch.run.result import Result
from palpate.studies.faults.launcher.scene import Fault, Scene


@dataclass
class Struck:
    """A fault that has struck.

    at        time [ns]
    phase     of the launcher
    near      whether the launcher was ending the run
    state     of the worker, in the launcher
    ended     whether the nodes of the worker had reported their end or a failure
    taken     whether a joined worker had its job
    """

    fault: Fault
    at: int
    phase: str
    near: bool
    state: str
    ended: bool
    taken: bool


@dataclass
class Worked:
    """A worker's process: its group, its name, and when it was started and ended [ns]."""

    group: str
    name: str
    begun: int
    ended: int | None = None


@dataclass
class Outcome:
    """What a simulated run did.

    result      of the launcher; None: it did not return
    error       exception of the launcher, or of the simulation
    returned    time at which the launcher returned [ns]
    begun       time at which it began to run, 0: not [ns]
    struck      faults that have struck
    workers     the processes of the workers
    stepped     time of the first report of steps of each process [ns]
    gone        arrivals of `Gone`: dead node, process, time [ns]
    left        processes that the launcher has left behind
    late        joined workers that did not end after their launcher
    received    ticks of each stream that the logger received
    states      of the workers in the launcher, at the end
    events      the last events
    """

    scene: Scene
    result: Result | None = None
    error: BaseException | None = None
    returned: int = 0
    begun: int = 0
    struck: list[Struck] = field(default_factory=list)
    gone: list[tuple[str, str, int]] = field(default_factory=list)
    workers: list[Worked] = field(default_factory=list)
    stepped: dict[str, int] = field(default_factory=dict)
    left: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)
    received: dict[str, list[int]] = field(default_factory=dict)
    states: dict[str, str] = field(default_factory=dict)
    events: tuple[str, ...] = ()
