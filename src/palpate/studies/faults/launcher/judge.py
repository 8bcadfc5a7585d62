"""What holds for a run whose processes suffer faults.

ends      the launcher returns: at most `run.LIMIT` after the last fault and the last tick
errors    no exception in the launcher, and none in a worker but those that it reports
named     a worker that dies, hangs or fails before the end of its nodes, or is killed while its last messages are
          delivered, is among `result.deaths`
innocent  no other node is
left      each process here has ended before the launcher returns, and a joined one `run.AFTER` later
stop      after Ctrl-C the run ends within `STOP` if no process is stopped or hangs, else `STUCK`; after a second one
          within `NOW`
gone      on the real clock `Gone` reaches the others `NEWS` after a death by a signal or a reported failure
returns   a node with `restart` runs again within `BACK`, and steps
steps     on the real clock, without faults other than Ctrl-C, each node makes at least half of the steps
ticks     a run without deaths makes all its ticks; on the simulated clock all nodes end at the same one, also after
          Ctrl-C, and the logger has all messages
"""

from __future__ import annotations

from collections.abc import Iterator

from palpate.launch.run.ending import STOP_PATIENCE
from palpate.launch.run.launcher import GRACE
from palpate.launch.run.member import ALIVE
from palpate.studies.faults.launcher.outcome import Outcome, Struck
from palpate.studies.faults.launcher.run import AFTER
from palpate.studies.faults.launcher.scene import OUTAGES, Fault, Scene
from palpate.studies.faults.launcher.world import MS, SECOND

NEWS = 20 * MS  # [ns]
NOW = 2 * SECOND  # [ns]
STOP = 3 * SECOND  # [ns]
TOGETHER = SECOND // 5  # [ns] between two signals that count as one: a terminal that closes may cause several
STUCK = int((2 * STOP_PATIENCE + 5) * SECOND)  # [ns]
BACK = SECOND  # [ns]
LATE = 40 * MS  # [ns] of the slowest frames
BEGINNING = 20  # ticks in which the first messages may be late
DEADLY = ("kill", "exit", "raise", "hang", "stop", "power", "leave")
ABOUT = {
    "ends": "the launcher returns",
    "errors": "no exception in the launcher",
    "named": "a worker that dies, hangs or fails before its nodes have ended is named",
    "innocent": "no other node is named",
    "left": "no process is left, and joined workers end after their launcher",
    "stop": "the run ends in time after Ctrl-C, and at once after a second one",
    "gone": "the other workers learn of a death within 20 ms on the real clock",
    "returns": "a node with `restart` steps again within a second",
    "steps": "without faults on the real clock each node makes at least half of the steps",
    "ticks": "a run without deaths makes all ticks, and its logger has all messages of simulated time",
}


def judge(outcome: Outcome) -> dict[str, str]:
    """What does not hold, with the reason, by name of the invariant."""
    if outcome.error is not None:
        return {"errors": f"{type(outcome.error).__name__}: {outcome.error}"}
    if outcome.result is None:
        if not all(s.taken for s in outcome.struck) and not any(s.fault.kind == "interrupt" for s in outcome.struck):
            return {}  # the group is awaited until it is started by hand again
        waiting = ", ".join(f"{group} {state}" for group, state in outcome.states.items() if state != "gone")
        return {"ends": f"the launcher waits for {waiting}"}
    found: dict[str, str] = {}
    for name, check in (
        ("named", _named), ("innocent", _innocent), ("left", _left), ("stop", _stop), ("gone", _gone),
        ("returns", _returns), ("steps", _steps), ("ticks", _ticks),
    ):  # fmt: skip
        for text in check(outcome):
            found.setdefault(name, text)
    return found


def _suspects(scene: Scene, fault: Fault) -> set[str]:
    """The nodes that may be named for a fault: for an outage also those on the other side of its connections."""
    if fault.kind == "server":
        return {"all"}
    if fault.kind in OUTAGES:
        return set(scene.nodes)
    if fault.group and fault.kind != "pause":
        return set(scene.nodes_of(fault.group))
    return set()


def _deaths(outcome: Outcome) -> list[set[str]]:
    assert outcome.result is not None
    return [set(death.node.split(", ")) for death in outcome.result.deaths]


def _named(outcome: Outcome) -> Iterator[str]:
    named = set().union(*_deaths(outcome))
    for struck in outcome.struck:
        fault = struck.fault
        delivers = struck.state == "done" and (fault.kind == "kill" or (fault.kind == "exit" and fault.status != 0))
        if fault.kind not in DEADLY or struck.near or "all" in named or not struck.taken:
            continue
        if not delivers and (struck.ended or struck.state not in ALIVE):
            continue
        if fault.kind == "raise" and fault.moment.call == "step" and struck.state == "starting":
            continue  # a step on examples
        if _overtaken(outcome, struck):
            continue
        if not named & set(outcome.scene.nodes_of(fault.group)):
            yield f"{fault} is not named"


def _overtaken(outcome: Outcome, struck: Struck) -> bool:
    """Whether the run was ended by something else before it could notice this."""
    patience = outcome.scene.patience if struck.fault.kind in ("hang", "stop") else 0.5
    slack = int((2.0 * patience + GRACE + 5.0) * SECOND)
    others = [
        o for o in outcome.struck if o is not struck and (o.fault.kind in (*DEADLY, "interrupt", "server", *OUTAGES))
    ]
    if any(abs(other.at - struck.at) < slack for other in others):
        return True
    return struck.fault.kind in ("hang", "stop") and outcome.returned - struck.at < slack


def _innocent(outcome: Outcome) -> Iterator[str]:
    assert outcome.result is not None
    guilty = set().union(*(_suspects(outcome.scene, struck.fault) for struck in outcome.struck))
    for death, names in zip(outcome.result.deaths, _deaths(outcome), strict=True):
        if not names & guilty:
            yield f"{death} is named"


def _left(outcome: Outcome) -> Iterator[str]:
    if outcome.left and sum(struck.fault.kind == "interrupt" for struck in outcome.struck) < 2:
        yield f"{', '.join(outcome.left)} runs when the launcher returns"
    if outcome.late:
        yield f"{', '.join(outcome.late)} runs {AFTER / SECOND:g} s after the launcher has returned"


def _stop(outcome: Outcome) -> Iterator[str]:
    scene = outcome.scene
    times = [struck.at for struck in outcome.struck if struck.fault.kind == "interrupt"]
    times = times[:1] + [at for at in times[1:] if at - times[0] > TOGETHER]
    stalls = sum(int(s.fault.duration * SECOND) for s in outcome.struck if s.fault.kind in ("stall", "pause", *OUTAGES))
    if len(times) > 1 and outcome.returned - times[1] > NOW + stalls:
        yield f"it ends {(outcome.returned - times[1]) * 1e-9:.3f} s after the second Ctrl-C"
    if scene.clock == "simulated" and "second" in scene.nodes:  # all end at the tick of the farthest
        assert outcome.result is not None
        stalls += int(outcome.result.ticks * 5.0 * max(step for _, step in scene.steps) * SECOND)
    if times:
        stuck = any(s.fault.kind in (*DEADLY, *OUTAGES) and s.fault.kind != "raise" for s in outcome.struck)
        if outcome.returned - times[0] > (STUCK if stuck else STOP) + stalls:
            yield f"it ends {(outcome.returned - times[0]) * 1e-9:.3f} s after Ctrl-C"


def _clear_deaths(outcome: Outcome, during: int) -> Iterator[Struck]:
    """Kills and reported failures of workers here that run on the real clock, while nothing else disturbs the launcher
    for this time [ns]."""
    scene = outcome.scene
    for struck in outcome.struck:
        fault, until = struck.fault, struck.at + during
        at_once = fault.kind in ("kill", "raise") or (fault.kind == "exit" and fault.status < 0)
        clear = scene.clock == "real" and at_once and struck.state == "running" and not (struck.near or struck.ended)
        if not clear or fault.group in scene.joined or outcome.returned < until:
            continue
        others = (other for other in outcome.struck if other is not struck and other.fault.kind != "helper")
        if all(o.at > until or o.at + int(o.fault.duration * SECOND) + 5 * MS < struck.at - during for o in others):
            yield struck


def _gone(outcome: Outcome) -> Iterator[str]:
    limit = NEWS + (4 * LATE if outcome.scene.slow else 0)
    for struck in _clear_deaths(outcome, limit):
        for node in set(outcome.scene.nodes_of(struck.fault.group)) - {"log"}:
            knows = {name for dead, name, at in outcome.gone if dead == node and struck.at <= at <= struck.at + limit}
            for worker in outcome.workers:
                lives = worker.begun < struck.at and (worker.ended is None or worker.ended > struck.at + limit)
                if lives and worker.group != struck.fault.group and worker.name not in knows:
                    yield f"{worker.name} does not receive the death of {node} within {limit // MS} ms"


def _returns(outcome: Outcome) -> Iterator[str]:
    last = outcome.begun + int((outcome.scene.ticks or 1e6) / outcome.scene.rate * SECOND)
    for struck in _clear_deaths(outcome, BACK):
        if struck.at + BACK > last:
            continue
        group = struck.fault.group
        nodes = set(outcome.scene.nodes_of(group)) - {"log"}
        if nodes and nodes <= outcome.scene.restart:
            later = [w.name for w in outcome.workers if w.group == group and w.begun > struck.at]
            if not any(struck.at < outcome.stepped.get(name, 0) <= struck.at + BACK for name in later):
                yield f"{group} does not step again within {BACK / SECOND:g} s"


def _steps(outcome: Outcome) -> Iterator[str]:
    result = outcome.result
    assert result is not None
    if outcome.scene.clock != "real" or outcome.scene.slow > 0.01:
        return
    if any(struck.fault.kind != "interrupt" for struck in outcome.struck):
        return
    first = min(f.moment.at or 0.0 for f in outcome.scene.faults) if outcome.scene.faults else 9.0
    least = (result.ticks - BEGINNING) // 2
    for name, health in result.health.items():
        if name != "log" and health["steps"] < least and first > 0.4:
            yield f"{name} makes {health['steps']} steps in {result.ticks} ticks"


def _ticks(outcome: Outcome) -> Iterator[str]:
    scene, result = outcome.scene, outcome.result
    assert result is not None
    if result.deaths:
        return
    if any(s.fault.kind in (*DEADLY, "server", *OUTAGES) for s in outcome.struck):
        return
    interrupts = sum(s.fault.kind == "interrupt" for s in outcome.struck)
    if not interrupts and scene.ticks is not None and result.ticks != scene.ticks:
        yield f"{result.ticks} of {scene.ticks} ticks"
    if scene.clock == "simulated" and interrupts < 2 and result.ticks:
        last = {name: h["tick"] for name, h in result.health.items() if name != "log"}
        if len(set(last.values())) > 1:
            yield f"last ticks {last}"
        if "log" in scene.nodes:
            for stream in set(scene.nodes) - {"log"}:
                if outcome.received.get(stream, []) != list(range(result.ticks)):
                    yield f"the logger lacks messages of {stream}"
