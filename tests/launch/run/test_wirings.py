"""Every wiring between two nodes of a process delivers the message that the rules name: nodes in Python and compiled,
edges forward, held from a node before or behind and from the node itself, with divisors, on both clocks."""

from itertools import product
from pathlib import Path

import pytest

from palpate.engine.schedule import needed_tick
from palpate.engine.segment import CompiledSegment
from palpate.launch.load.graph import load
from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.run.assign import jobs
from palpate.launch.run.lanes import check_compiled
from palpate.launch.run.work.real import _RealClock
from palpate.launch.run.work.simulated import SimulatedClock
from palpate.launch.run.work.worker import Worker
from palpate.physics.errors import ArgumentError

TICKS = 40
FORMS = ("", "Compiled")
EVERY = ((1, 1), (1, 2), (3, 1), (3, 2))  # divisors of sender and reader
WIRINGS = ("forward", "named", "paced", "early", "itself")


def graph(folder: Path, sender: str, reader: str) -> Path:
    """A graph of all wirings. `forward`, `named` (`loop: true`) and `paced` read a sender that runs before them,
    `early` one that runs after it, `itself` those of the reader."""
    lines = ["n0: {use: nodes_for_placement.Clock}"]
    for a, b in EVERY:
        sends, reads = f"nodes_for_placement.{sender}", f"nodes_for_placement.{reader}"
        tag = f"-{a}-{b}"
        lines += [
            f"s{tag}: {{use: {sends}One, every: {a}, in: {{first: n0}}}}",
            f"forward{tag}: {{use: {reads}One, every: {b}, in: {{first: n0, second: s{tag}}}}}",
            f"named{tag}: {{use: {reads}One, every: {b}, in: {{first: n0, second: {{from: s{tag}, loop: true}}}}}}",
            f"paced{tag}: {{use: {reads}Clock, every: {b}, in: {{back: s{tag}}}}}",
            f"early{tag}: {{use: {reads}One, every: {b}, in: {{first: n0, second: t{tag}}}}}",
            f"t{tag}: {{use: {sends}One, every: {a}, in: {{first: early{tag}}}}}",
            f"itself{tag}: {{use: {reads}One, every: {b}, in: {{first: n0, second: itself{tag}}}}}",
        ]
    path = folder / "g.yaml"
    wanted = ", ".join(line.partition(":")[0] for line in lines)
    path.write_text("nodes:\n  " + "\n  ".join(lines) + f"\nwanted: [{wanted}]\n")
    return path


class Run:
    """The graph in this process on ticks of our choice; `used[stream]`: by tick, the ticks of the inputs."""

    def __init__(
        self, path: Path, clock: str, ticks: list[int], monkeypatch: pytest.MonkeyPatch, silent: range = range(0)
    ) -> None:
        """`silent`: ticks at which the nodes `s...` do not step."""
        planned = plan(load(path))
        (job,) = jobs(planned, fuse_nodes(planned), clock=clock)
        self.worker = worker = Worker(job, None, lambda report: None)
        worker.start()
        self.used: dict[str, dict[int, tuple[int, ...]]] = {stream: {} for stream in worker.outputs}
        worker.begin(0)
        for output in worker.outputs.values():
            output.observed = True
        monkeypatch.setattr(worker, "housekeep", lambda ticks=1: self.note())
        try:
            if clock == "real":
                monkeypatch.setattr(worker, "tick", -1)
                real = _RealClock(worker, worker.slots[0])
                for tick in ticks:
                    self.block(tick in silent)
                    real.run(tick, tick * 1_000_000)
            else:
                simulated = SimulatedClock(worker)
                for tick in ticks:
                    simulated.run(tick)
        finally:
            worker.stop()

    def block(self, blocked: bool) -> None:
        for slot in self.worker.slots:
            if slot.name.startswith("s-"):
                slot.blocked = blocked
        for part in self.worker.parts:
            if isinstance(part, CompiledSegment):
                part.refresh()

    def note(self) -> None:
        for stream, output in self.worker.outputs.items():
            if output.last is not None:
                self.used[stream].setdefault(output.last.tick, output.last.used)


def expected(sent: list[int], tick: int, every: int, loop: bool, clock: str) -> int:
    """The tick of the message that a step uses: the newest one that the schedule permits."""
    if clock == "simulated":
        return needed_tick(tick, every, loop)
    return max((other for other in sent if other <= tick - loop), default=-1)


@pytest.mark.parametrize(("sender", "reader"), list(product(FORMS, FORMS)))
@pytest.mark.parametrize("clock", ["simulated", "real", "real with ticks left out"])
def test_each_wiring_delivers_the_message_that_the_rules_name(tmp_path, monkeypatch, sender, reader, clock):
    clock, gaps = clock.split()[0], "left" in clock
    ticks = [tick for tick in range(TICKS) if not (gaps and tick in (1, 7, 8, 13, 20, 21, 22, 30))]
    used = Run(graph(tmp_path, sender, reader), clock, ticks, monkeypatch).used
    checked = 0
    for (a, b), wiring in product(EVERY, WIRINGS):
        tag = f"-{a}-{b}"
        source, every = {"early": (f"t{tag}", a), "itself": (f"itself{tag}", b)}.get(wiring, (f"s{tag}", a))
        port = 0 if wiring == "paced" else 1
        for tick, given in used[f"{wiring}{tag}"].items():
            right = expected(list(used[source]), tick, every, wiring != "forward", clock)
            assert given[port] == right, f"{wiring}{tag} at tick {tick} used {given[port]}, expected {right}"
            checked += 1
    assert checked >= 5 * 2 * (len(ticks) + len(ticks) // 2 - 4)


def test_an_optional_input_is_absent_only_before_the_first_message(tmp_path, monkeypatch):
    for sender, reader in product(FORMS, FORMS):
        used = Run(graph(tmp_path, sender, reader), "real", list(range(TICKS)), monkeypatch).used
        for (a, b), wiring in product(EVERY, WIRINGS):
            given = [ticks[0 if wiring == "paced" else 1] for ticks in used[f"{wiring}-{a}-{b}"].values()]
            assert given.count(-1) == (wiring != "forward") and -1 not in given[1:], (wiring, a, b, given)


@pytest.mark.parametrize(("sender", "reader"), list(product(FORMS, FORMS)))
def test_steps_without_an_expired_input_are_counted(tmp_path, monkeypatch, sender, reader):
    """A sender that falls silent for 20 ms; its messages are held for 7 ms, 9 ms by a paced reader."""
    run = Run(graph(tmp_path, sender, reader), "real", list(range(TICKS)), monkeypatch, silent=range(10, 30))
    for part in run.worker.parts:
        if isinstance(part, CompiledSegment):
            part.count()
    for slot in run.worker.slots:
        wiring, *tag = slot.name.split("-")
        if wiring not in ("forward", "named", "paced"):
            continue
        used = [ticks[0 if wiring == "paced" else 1] for ticks in run.used[slot.name].values()]
        absent = used[used[0] < 0 :].count(-1)
        assert slot.health.absent == absent > 0, slot.name
        if tag == ["1", "1"]:
            back = 30 + (wiring != "forward")
            assert absent == back - 1 - (9 + (9 if wiring == "paced" else 7)), slot.name


def test_a_lane_refuses_a_message_that_its_table_does_not_keep(tmp_path):
    with pytest.raises(ArgumentError, match=r"input 'second' of 'named' holds an earlier message of 's'.*loop: true"):
        text = "nodes:\n  n0: {use: nodes_for_placement.CompiledClock}\n"
        text += "  s: {use: nodes_for_placement.CompiledOne, in: {first: n0}}\n"
        text += "  named: {use: nodes_for_placement.CompiledOne, in: {first: n0, second: {from: s, loop: true}}}\n"
        (tmp_path / "lane.yaml").write_text(text + "wanted: [named]\n")
        check_compiled(plan(load(tmp_path / "lane.yaml")))
