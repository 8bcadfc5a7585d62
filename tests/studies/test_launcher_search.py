"""`palpate bench faults --launcher`: what it finds, that a seed repeats a run, and that it finds what is planted."""

import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine import clock
from palpate.launch.run import ending, launcher, reports
from palpate.launch.run.member import WorkerHandle
from palpate.launch.run.wire import bus, wires
from palpate.launch.run.work import loops, simulated
from palpate.launch.run.work.far_clock import FarClock
from palpate.launch.run.work.worker import EndedError, Worker
from palpate.studies.faults.launcher import search as searching
from palpate.studies.faults.launcher.judge import judge
from palpate.studies.faults.launcher.run import simulate
from palpate.studies.faults.launcher.scene import Fault, Moment, Scene, draw_scene
from palpate.studies.faults.launcher.search import search
from palpate.studies.faults.launcher.wire import Wire
from palpate.studies.faults.launcher.world import MS

runner = CliRunner()
NODES = ("source", "spring", "sum", "log")


def scene(*faults, groups=tuple((name,) for name in NODES), seed=1, slower=(), **changes):
    """A run without long delays, by default one process for each node. `slower`: nodes whose steps take 5 ms."""
    names = [name for group in groups for name in group]
    given = {"clock": "real", "rate": 100.0, "ticks": None, "joined": frozenset(), "restart": frozenset(),
             "spared": frozenset(), "patience": 0.6, "slow": 0.0} | changes  # fmt: skip
    steps = tuple((name, 5e-3 if name in slower else 2e-4) for name in names)
    return Scene(seed=seed, groups=tuple(groups), steps=steps, faults=faults, **given)


def at(kind, group, seconds, **more):
    return Fault(kind, group, Moment(at=seconds), **more)


def after(kind, group, report, delay=0.0, count=1, **more):
    return Fault(kind, group, Moment(report=report, count=count, delay=delay), **more)


def wrong(given):
    return judge(simulate(given))


CTRL_C = at("interrupt", "", 1.0)


def test_random_faults_of_processes_break_nothing():
    results = search(1, 80)
    assert results.seeds == 80 and results.kinds.total() > 60
    assert not results.broken.total(), results.found


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_many_random_faults_of_processes_break_nothing():
    results = search(100_000, 5000)
    assert not results.broken.total(), results.found


def test_a_seed_repeats_its_run_in_another_process():
    """Also with another order of sets of texts."""
    program = (
        "import sys; from palpate.studies.faults.launcher.run import simulate;"
        "from palpate.studies.faults.launcher.scene import draw_scene;"
        "print('\\n'.join(str(simulate(draw_scene(seed)).events) for seed in (7, 11, 103)))"
    )
    printed = [
        subprocess.run([sys.executable, "-c", program], env={**os.environ, "PYTHONHASHSEED": seed},
                       capture_output=True, text=True, check=True).stdout for seed in ("1", "2")
    ]  # fmt: skip
    assert printed[0] == printed[1] and printed[0].count("reports") > 20


def test_virtual_time_ends_with_the_run():
    known = clock.now, clock.sleep_until
    simulate(draw_scene(3))
    assert (clock.now, clock.sleep_until) == known


# -- planted: what each line prevents --------------------------------------------------------------------------------


def without_pulses(monkeypatch):
    """The end of a joined process is not noticed, and only silence after its start counts."""
    monkeypatch.setattr(launcher.Launcher, "_take_pulse", lambda self, member, found: member.take_pulse(found))
    hang = WorkerHandle.hang
    monkeypatch.setattr(WorkerHandle, "hang", lambda m, t: "" if m.joined and m.state == "starting" else hang(m, t))


def without_lost_messages(monkeypatch):
    """A worker that is killed while its last messages are delivered counts as finished."""
    monkeypatch.setattr(launcher.Launcher, "_lose_messages", lambda self, member, text: None)


def with_the_end_before_the_last_messages(monkeypatch):
    """A worker marks its streams as ended before it has sent their last messages."""
    finish = Worker.finish

    def early(worker):
        worker.bus.offer_end()
        worker.bus.world.compute(MS)
        finish(worker)

    monkeypatch.setattr(Worker, "finish", early)


def with_an_end_of_nodes_alone(monkeypatch):
    """On simulated time, observers end with the nodes of their worker."""
    run = simulated.run_simulated

    def ended(worker):
        try:
            run(worker)
        except EndedError:
            worker.audience.slots.clear()
            raise

    monkeypatch.setattr(loops, "run_simulated", ended)


def without_a_deadline_for_absent_groups(monkeypatch):
    """When all nodes have ended, observers have no deadline, also those that were never started."""
    follow = ending.Ending.follow

    def old(self):
        follow(self)
        if self.closed and any(m.state not in ("done", "gone") for m in self._members.values()):
            self._deadline = None

    monkeypatch.setattr(ending.Ending, "follow", old)


def without_a_quit_after_stop(monkeypatch):
    """A death after Ctrl-C schedules nothing."""
    quit_after = ending.Ending.quit_after
    monkeypatch.setattr(ending.Ending, "quit_after", lambda self, s: self.near or quit_after(self, s))


def without_ended_leads(monkeypatch):
    """A paced node that has ended does not take part in the agreement on the last tick."""
    agree = launcher.Launcher._agree_on_the_end

    def old(self):
        if all(lead.alive for lead in self._leads()):
            agree(self)

    monkeypatch.setattr(launcher.Launcher, "_agree_on_the_end", old)


def without_an_offer_while_it_waits(monkeypatch):
    """A paced worker agrees on the last tick only between two ticks."""
    offer = simulated._offer_the_end
    monkeypatch.setattr(
        simulated, "_offer_the_end", lambda worker, tick: None if worker.awaits else offer(worker, tick)
    )


def without_repeated_orders(monkeypatch):
    """A worker whose connection returns does not get the orders that it has missed."""
    known = set()

    def deliver(self):
        while (note := self.sockets.subscription()) is not None:
            group = note[2:-1].decode()
            if note[:1] == b"\1" and group in self._sent and (self, group) not in known:
                known.add((self, group))
                for data in self._sent[group]:
                    self.sockets.send(data)

    monkeypatch.setattr(wires.ControlChannel, "deliver", deliver)
    monkeypatch.setattr(bus.Exchange, "take", lambda self, data: reports.ORDERS.decode(data[data.index(b" ") :]))


def without_repeated_reports(monkeypatch):
    """Reports that are lost with their connection are not sent again."""
    monkeypatch.setattr(bus.Exchange, "lost", lambda self, received: [])
    monkeypatch.setattr(bus, "REPEATED", ())


def without_an_end_of_orphans(monkeypatch):
    """A joined worker waits for its observers also when the launcher has ended."""
    monkeypatch.setattr("palpate.launch.run.work.process._orphan_check", lambda bus, alone: lambda: False)


def without_restarts(monkeypatch):
    fork = launcher.Launcher._fork
    not_again = lambda self, m: setattr(m, "state", "gone") if m.starter else fork(self, m)  # noqa: E731
    monkeypatch.setattr(launcher.Launcher, "_fork", not_again)


def with_a_wait_for_readers_that_have_ended(monkeypatch):
    """A restarted worker waits for all readers of its streams, also those that have ended."""
    wait, link, count = Wire.wait_linked, launcher.Launcher._link, launcher.listeners

    def linked(self, member):
        counted = lambda job, _: count(job, {g: each for g, each in self.jobs.items() if g != job.group})  # noqa: E731
        monkeypatch.setattr(launcher, "listeners", counted)
        link(self, member)

    monkeypatch.setattr(launcher.Launcher, "_link", linked)
    monkeypatch.setattr(Wire, "wait_linked", lambda self, observers, poll, awaited: wait(self, observers, poll, True))


def with_late_news(monkeypatch):
    """The launcher handles the end of a process 0.1 s later."""
    end = launcher.Launcher._end_process
    late = lambda self, m: None if m.since.poll() < 1e8 else end(self, m)  # noqa: E731
    monkeypatch.setattr(launcher.Launcher, "_end_process", late)


def without_a_look_at_finished_workers(monkeypatch):
    """A worker that a signal stops while its last messages are delivered is not found."""
    hang = WorkerHandle.hang
    monkeypatch.setattr(WorkerHandle, "hang", lambda m, t: "" if m.state == "done" else hang(m, t))


def without_leads_next_to_observers(monkeypatch):
    """A paced node that has made all its ticks takes part in the agreement only if its process has no observers."""
    note = launcher.Launcher._note_last_tick
    monkeypatch.setattr(launcher.Launcher, "_note_last_tick", lambda self, m: m.observes or note(self, m))


def without_an_end_of_stopped_workers(monkeypatch):
    """A worker that has reported its failure, and that a signal stops before it exits, is awaited."""
    kill = ending.Ending.kill

    def old(self, only=None):
        kill(self, None if only is None else {g for g in only if not self._members[g].flushed})

    monkeypatch.setattr(ending.Ending, "kill", old)


def with_one_clock(monkeypatch):
    """A worker on another machine takes the launcher's time for its."""
    monkeypatch.setattr(FarClock, "begin", lambda self, moment: moment)


def without_an_end_of_what_restarts(monkeypatch):
    """A worker that has reported its failure and is stopped before it exits has no successor."""
    hang = WorkerHandle.hang
    monkeypatch.setattr(WorkerHandle, "hang", lambda m, t: "" if m.state == "restarting" else hang(m, t))


def without_losses_after_ctrl_c(monkeypatch):
    """After Ctrl-C no message counts as lost, and its reader waits for it."""
    check = launcher.Launcher._check_lost
    monkeypatch.setattr(launcher.Launcher, "_check_lost", lambda self: self.phase == "running" and check(self))


def with_a_wait_for_two_things(monkeypatch):
    """A worker whose observers are full reports that it waits for the message that it awaited before."""

    def old(self):
        self.check_orders()
        if self.heartbeat.due(clock.now()):
            self.heartbeat.send()

    monkeypatch.setattr(Worker, "_poll_while_full", old)


FAR, LOG = frozenset(["spring"]), frozenset(["log"])
SECOND = (("source", "log"), ("spring",), ("sum",), ("second",))
LOGGED = (("source", "spring", "sum"), ("second", "log"))
COUPLED = (("source", "sum"), ("spring", "second"), ("drag",), ("log",))
BLOCKED = Scene(
    530479, "simulated", 1000.0, 37, (("source",), ("spring", "log"), ("sum",), ("drag",)), frozenset(), frozenset(),
    frozenset(), 2.0, (("source", 0.0047), ("spring", 0.0077), ("sum", 0.008), ("drag", 0.0047)), 0.002,
    (at("stop", "spring-log", 0.8989),),
)  # fmt: skip
TOGETHER = (("source",), ("spring",), ("sum", "log"))
LATER = at("interrupt", "", 2.5)
PLANTED = [
    (without_pulses, "ends", [scene(after("kill", "spring", "Starting"), joined=FAR)]),
    (without_lost_messages, "named",
     [scene(after("kill", "spring", "NodesEnded", 2e-4), clock="simulated", ticks=20, seed=seed) for seed in range(3)]),
    (with_the_end_before_the_last_messages, "ticks", [scene(ticks=30, clock="simulated")]),
    (with_an_end_of_nodes_alone, "ticks",
     [scene(at("interrupt", "", 0.5), at("pause", "spring", t, duration=0.2), clock="simulated", groups=TOGETHER)
      for t in (0.601, 0.605, 0.609, 0.613, 0.62)]),
    (without_a_deadline_for_absent_groups, "ends",
     [scene(at("stop", "log", 0.0), at("interrupt", "", 0.6), joined=LOG)]),
    (without_a_quit_after_stop, "ends",
     [scene(CTRL_C, after("kill", "second", "Paused"), clock="simulated", groups=SECOND, slower=NODES)]),
    (without_ended_leads, "ends",
     [scene(at("interrupt", "", 0.5), clock="simulated", groups=SECOND, slower=NODES, ticks=80)]),
    (without_an_offer_while_it_waits, "ends",
     [scene(at("interrupt", "", 0.5), clock="simulated", groups=COUPLED, seed=seed) for seed in range(8)]),
    (without_repeated_orders, "ends", [scene(at("break", "spring", 0.9, duration=0.3), CTRL_C, joined=FAR)]),
    (without_repeated_reports, "ends",
     [scene(after("break", "spring", "Linked", 2e-5, duration=0.3), joined=FAR, ticks=100, seed=s) for s in (1, 2)]),
    (without_an_end_of_orphans, "left",
     [scene(Fault("hang", "log", Moment(call="step", count=6), node="log"), CTRL_C, joined=FAR | LOG)]),
    (without_restarts, "returns", [scene(at("kill", "spring", 0.8), LATER, restart=FAR)]),
    (with_late_news, "gone", [scene(at("kill", "spring", 0.8), LATER, restart=FAR)]),
    (without_a_look_at_finished_workers, "innocent",
     [scene(after("stop", "spring", "NodesEnded", 1e-5), ticks=20, seed=seed) for seed in range(3)]),
    (without_leads_next_to_observers, "ends",
     [scene(at("interrupt", "", 0.3), clock="simulated", groups=LOGGED, slower=("source",), ticks=80)]),
    (without_an_end_of_stopped_workers, "ends",
     [scene(Fault("raise", "source", Moment(call="step", count=19), node="source"),
            after("stop", "source", "NodesEnded", 6e-4), seed=seed) for seed in range(3)]),
    (with_one_clock, "steps", [scene(joined=FAR, ticks=100, seed=seed) for seed in range(8)]),
    (with_one_clock, "ticks", [scene(joined=frozenset(["source"]), ticks=100, seed=seed) for seed in range(8)]),
    (without_an_end_of_what_restarts, "ends",
     [scene(Fault("raise", "spring", Moment(call="step", count=9), node="spring"),
            after("stop", "spring", "NodesEnded", 1e-5), ticks=200, restart=FAR, seed=seed) for seed in range(3)]),
    (without_losses_after_ctrl_c, "ends",
     [scene(at("interrupt", "", 0.5), at("part", "spring", 0.5 + 1e-4 * k, duration=0.1), clock="simulated", joined=FAR,
            groups=SECOND, slower=NODES, seed=k) for k in range(8)]),
    (with_a_wait_for_two_things, "innocent", [BLOCKED]),
    (with_a_wait_for_readers_that_have_ended, "returns",
     [scene(at("kill", "log", 0.5), at("kill", "spring", 1.8), restart=FAR, ticks=400)]),
]  # fmt: skip


@pytest.mark.parametrize(("plant", "invariant", "runs"), PLANTED, ids=[each[0].__name__ for each in PLANTED])
def test_a_planted_fault_is_found(monkeypatch, plant, invariant, runs):
    assert [wrong(run) for run in runs] == [{}] * len(runs)
    plant(monkeypatch)
    assert any(invariant in wrong(run) for run in runs)


def test_a_broken_seed_is_reduced_and_printed_with_its_last_events(monkeypatch, tmp_path):
    given = scene(at("pause", "log", 0.4, duration=0.05), after("kill", "spring", "Starting"), joined=FAR, ticks=9)
    monkeypatch.setattr(searching, "draw_scene", lambda seed: given)
    without_pulses(monkeypatch)
    out = tmp_path / "out"
    done = runner.invoke(app, ["bench", "faults", "--launcher", "--seeds", "1", "--json", "-o", str(out)])
    assert done.exit_code == 1
    report = json.loads(done.stdout)
    (found,) = report["found"]
    assert found["invariant"] == "ends" and found["faults"] == ["kill spring 0 us after its report 1 of Starting"]
    assert len(found["events"]) == 50 and report["faults"]["kill"] == 1
    assert "palpate bench faults --launcher --seed 1 --seeds 1" in (out / "launcher.txt").read_text()
