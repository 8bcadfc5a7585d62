"""The rules of the real clock one by one, without processes: ages of inputs, omitted ticks, skipped messages."""

from types import SimpleNamespace

import msgspec
import pytest

from palpate.engine.job import InputJob, NodeJob
from palpate.engine.slot import Slot, make
from palpate.launch.run.work import real
from palpate.launch.run.work.worker import EndedError
from palpate.messages import Force, Message, Pose, Torque

FORCE = Force(force=(1.0, 0.0, 0.0), state="free", energy=0.0)
POSE = Pose(position=(0, 0, 0), velocity=(0, 0, 0), dt=1e-3)
TORQUE = Torque(torques=(1.0, 0.0, 0.0))
MS = 1_000_000


def slot(cls: str, *ports: tuple[str, dict]) -> Slot:
    """A node of tests/support with inputs from another process."""
    jobs = tuple(InputJob(port=name, stream=name, producer=name, **given) for name, given in ports)
    job = NodeJob("node", f"nodes_for_runs.{cls}", {}, 1, jobs, ("node",))
    made = Slot(job, make(job), ())
    made.wire({})
    for port in made.inputs:
        port.feed = port
    return made


def put(made: Slot, port: int, message: Message, tick: int) -> None:
    made.inputs[port].put(msgspec.structs.replace(message, tick=tick, time=tick * MS))


def worker(rate: float = 1000.0, links: int = 0, wait=lambda feed, deadline=0: None) -> SimpleNamespace:
    return SimpleNamespace(
        job=SimpleNamespace(rate=rate, links=links),
        wait=wait,
        now=lambda: real.clock.now(),
        stopping=False,
        tick=-1,
        origin=0,
        last=None,
        hop=None,
        drain=lambda: None,
    )


def drag(age: int, every: int = 1, loop: bool = False, **given) -> tuple[Slot, list | None]:
    """A drag node, and its inputs at tick 100 with a held force that is `age` ticks old."""
    made = slot("Drag", ("pose", {}), ("force", {"every": every, "loop": loop, "waits": False}))
    put(made, 0, POSE, 100)
    put(made, 1, FORCE, 100 - age)
    return made, real.take_inputs(worker(**given), made, 100, 0, leading=True)


@pytest.mark.parametrize(
    ("given", "oldest"),
    [
        ({}, 7),
        ({"links": 1}, 7),
        ({"links": 2}, 3),
        ({"links": 7}, 1),
        ({"links": 100}, 1),
        ({"rate": 500.0}, 3),
        ({"rate": 100.0}, 3),
        ({"rate": 2000.0}, 14),
        ({"every": 10}, 30),
        ({"every": 10, "links": 2}, 15),
    ],
)
def test_a_required_input_is_held_up_to_its_age(given, oldest):
    assert drag(oldest, **given)[1] is not None
    assert drag(oldest + 1, **given)[1] is None


def test_an_optional_input_is_absent_beyond_its_age():
    for links in (0, 3):
        for age, absent in ((7, False), (8, True)):
            made = slot("Spread", ("force", {}), ("friction", {"optional": True, "waits": False}))
            put(made, 0, FORCE, 100)
            put(made, 1, FORCE, 100 - age)
            gathered = real.take_inputs(worker(links=links), made, 100, 0, leading=True)
            assert gathered is not None and (gathered[1] is None) == absent


@pytest.mark.parametrize(("age", "absent"), [(9, False), (10, True)])
def test_a_device_is_without_torque_beyond_its_age(age, absent):
    made = slot("Source", ("torque", {"loop": True, "optional": True}))
    put(made, 0, TORQUE, 100 - age)
    gathered = real.take_inputs(worker(links=5), made, 100, 0, leading=True)
    assert gathered is not None and (gathered[0] is None) == absent


@pytest.mark.parametrize(
    ("age", "every", "loop", "held"),
    [(0, 1, False, 0), (1, 1, False, 1), (1, 1, True, 0), (2, 1, True, 1), (0, 10, False, 0)],
)
def test_only_inputs_older_than_required_count_as_held(age, every, loop, held):
    made, gathered = drag(age, every, loop)
    assert gathered is not None and made.health.held == held


def test_a_step_waits_for_its_inputs_until_the_deadline_and_no_longer(monkeypatch):
    clock = [0]
    monkeypatch.setattr(real.clock, "now", lambda: clock[0])

    def gather(comes: int | None, waits: bool) -> tuple[list | None, int]:
        clock[0] = 0
        made = slot("Drag", ("pose", {}), ("force", {"waits": waits}))
        put(made, 0, POSE, 100)
        put(made, 1, FORCE, 99)

        def wait(feed: object, deadline: int) -> None:
            clock[0] += MS
            if clock[0] == comes:
                put(made, 1, FORCE, 100)

        gathered = real.take_inputs(worker(wait=wait), made, 100, 5 * MS, leading=True)
        return [message.tick for message in gathered], clock[0]

    assert gather(3 * MS, True) == ([100, 100], 3 * MS)
    assert gather(None, True) == ([100, 99], 5 * MS)
    assert gather(3 * MS, False) == ([100, 99], 0)


def test_a_missing_driving_message_means_no_step():
    made = slot("Drag", ("pose", {}), ("force", {"waits": False}))
    put(made, 0, POSE, 99)
    put(made, 1, FORCE, 100)
    assert real.take_inputs(worker(), made, 100, 0, leading=False) is None
    assert made.health.held == 0


def test_of_several_driving_messages_the_newest_counts_and_the_others_are_lost():
    made, here = slot("Drag", ("pose", {}), ("force", {})), worker()
    for tick in (3, 4, 6):
        put(made, 0, POSE, tick)
    assert real._follow(here, made, None) == (6, 6 * MS)
    assert made.health.lost == 2
    here.tick, made.due = 6, 7
    assert real._follow(here, made, None) is None  # messages of earlier ticks
    assert made.health.lost == 2 and not made.inputs[0].queue


@pytest.mark.parametrize("every", [1, 3, 10])
def test_messages_between_the_runs_of_a_divisor_are_not_lost(monkeypatch, every):
    """Tick by tick no message is lost; after a stall each run of the divisor with skipped messages counts once."""
    made = slot("Drag", ("pose", {}), ("force", {"loop": True, "waits": False}))
    made.every = every
    made.begin()
    put(made, 1, FORCE, 0)
    arriving = [[tick] for tick in range(1, 41)] + [list(range(41, 61))] + [[tick] for tick in range(61, 101)]

    def follow(worker, lead, until):
        if not made.inputs[0].queue:
            if not arriving:
                here.last = here.tick
                return None
            for tick in arriving.pop(0):
                put(made, 0, POSE, tick)
                put(made, 1, FORCE, tick - 1)
        return original(worker, lead, until)

    original, steps = real._follow, []
    monkeypatch.setattr(real, "_follow", follow)
    here = worker()
    here.slots, here.parts, here.send = [made], [made], lambda slot: steps.append(here.tick)
    here.check_orders = here.housekeep = lambda: None
    real.run_real(here)
    runs = {tick // every for tick in range(1, 101)}
    assert (
        made.health.lost
        == len(runs) - len(steps)
        == len({tick // every for tick in range(41, 60)} - {40 // every, 60 // every})
    )


def test_a_run_that_lacks_an_input_counts_as_lost_once(monkeypatch):
    made, here = slot("Drag", ("pose", {}), ("force", {"waits": False})), worker()
    made.every, here.last, here.slots, here.parts = 10, 25, [made], [made]
    made.begin()
    here.send = here.check_orders = here.housekeep = lambda *_: None
    ticks = iter(range(26))
    monkeypatch.setattr(real, "_follow", lambda *_: (next(ticks), 0))
    monkeypatch.setattr(real, "take_inputs", lambda *_: None)
    real.run_real(here)
    assert made.health.lost == 3


def test_a_waiting_node_ends_on_an_order():
    made, here = slot("Drag", ("pose", {}), ("force", {})), worker()

    def check_orders() -> None:
        here.stopping = True

    here.check_orders = check_orders
    with pytest.raises(EndedError):
        real._follow(here, made, None)


class Sender:
    """Messages of one of two drivers that arrive at given times."""

    def __init__(self, made: Slot, port: int, ticks: dict[int, int]) -> None:
        self.made, self.port, self.ticks = made, port, ticks

    def arrive(self, now: int) -> None:
        for tick in [tick for tick, at in self.ticks.items() if at <= now]:
            put(self.made, self.port, POSE, tick)
            del self.ticks[tick]


def test_another_driver_replaces_one_that_is_silent_until_it_returns(monkeypatch):
    """Of two senders the first one sends ticks 1 to 3, is silent, and returns at tick 9."""
    clock = [0]
    monkeypatch.setattr(real.clock, "now", lambda: clock[0])
    made = slot("Both", ("poses", {"optional": True}), ("poses", {"optional": True}))
    assert made.drivers == made.inputs and made.driver is made.inputs[0]
    first = Sender(made, 0, {tick: tick * MS for tick in (1, 2, 3, 9, 10, 11)})
    second = Sender(made, 1, {tick: tick * MS - 2000 for tick in range(1, 12)})
    here = worker()

    def drain() -> None:
        first.arrive(clock[0])
        second.arrive(clock[0])

    def wait(feed: object, deadline: int) -> None:
        due = [at for sender in (first, second) if made.inputs[sender.port] is feed for at in sender.ticks.values()]
        clock[0] = max(clock[0] + 1, min([*due, deadline]))
        drain()

    here.wait, here.drain, here.check_orders = wait, drain, lambda: None
    ticks, times, drivers = [], [], []
    while not ticks or ticks[-1] < 11:
        begun = clock[0]
        made_at = real._follow(here, made, begun + round(real.WAITED * MS))
        if made_at is not None:
            here.tick = made_at[0]
            ticks.append(made_at[0])
            times.append(clock[0])
            drivers.append(made.inputs.index(made.driver))
    assert ticks == list(range(1, 12)), "the first one is waited for until 4.5"
    assert drivers == [0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0]
    late = [at - tick * MS for tick, at in zip(ticks, times, strict=True)]
    assert max(map(abs, late[:3] + late[4:])) <= 2000, "once the other drives, no step waits for the silent one"


@pytest.mark.parametrize(("late", "skipped"), [(0.0, 0), (0.9, 0), (1.1, 1), (2.6, 2)])
@pytest.mark.parametrize("before", [-1, 0, 4])
def test_ticks_whose_whole_period_has_passed_are_omitted_and_counted(monkeypatch, late, skipped, before):
    origin, deadlines = 1000, []
    monkeypatch.setattr(real.clock, "sleep_until", lambda deadline: deadlines.append(deadline) or round(late * MS))
    monkeypatch.setattr(real.clock, "now", lambda: origin + 77)
    made, here = slot("Source", ("torque", {"loop": True})), worker()
    here.tick, here.origin = before, origin
    assert real._pace(here, made, MS) == (before + 1 + skipped, 77)
    assert deadlines == [origin + (before + 1) * MS]
    assert made.health.late == (skipped if before >= 0 else 0)


def test_a_stall_at_the_end_causes_no_tick_beyond_the_last(monkeypatch):
    monkeypatch.setattr(real.clock, "sleep_until", lambda deadline: 10 * MS)
    made, here = slot("Source", ("torque", {"loop": True})), worker()
    here.tick, here.last = 597, 599
    assert real._pace(here, made, MS)[0] == 599 and made.health.late == 1


def test_a_stopped_run_ends_at_its_next_tick(monkeypatch):
    monkeypatch.setattr(real.clock, "sleep_until", lambda deadline: 0)
    here = worker()
    here.stopping = True
    with pytest.raises(EndedError):
        real._pace(here, slot("Source", ("torque", {"loop": True})), MS)


def test_messages_of_a_dead_sender_are_not_used():
    made, _ = drag(0)
    made.inputs[1].dead = True
    assert real.take_inputs(worker(), made, 100, 0, leading=True) is None


def test_the_input_of_a_loop_is_from_the_previous_tick():
    made = slot("Source", ("torque", {"loop": True}))
    put(made, 0, TORQUE, 99)
    put(made, 0, TORQUE, 100)
    assert real.take_inputs(worker(), made, 100, 0, leading=True)[0].tick == 99


class Here(SimpleNamespace):
    """A worker with a paced node at each tick, a node at every second tick, and a blocked node."""

    def __init__(self, last: int) -> None:
        super().__init__(
            job=SimpleNamespace(rate=1000.0, links=0), tick=-1, last=last, origin=0, stopping=False, hop=None
        )
        self.clock = [0]
        self.slots = [slot("Source", ("torque", {"loop": True, "optional": True})) for _ in range(3)]
        self.parts = self.slots
        for made in self.slots:
            made.begin()
        self.slots[1].every = 2
        self.slots[2].blocked = True
        self.sent: list[tuple[int, int]] = []

    def send(self, made: Slot) -> None:
        self.sent.append((self.slots.index(made), made.outputs[0].last.tick))
        self.clock[0] += 30_000

    def drain(self) -> None:
        """No message arrives."""

    check_orders = housekeep = drain


def test_each_node_runs_at_its_ticks_up_to_the_last(monkeypatch):
    here, deadlines = Here(last=3), []
    origin = 5 * MS

    def sleep(deadline: int) -> int:
        here.clock[0] = deadline + 10_000
        return 10_000

    def gather(worker, made, tick, deadline, leading):
        deadlines.append((deadline, leading))
        return None if tick == 3 else [None]

    monkeypatch.setattr(real.clock, "sleep_until", sleep)
    monkeypatch.setattr(real.clock, "now", lambda: here.clock[0])
    monkeypatch.setattr(real, "take_inputs", gather)
    here.origin = origin
    real.run_real(here)
    assert here.sent == [(0, 0), (1, 0), (0, 1), (0, 2), (1, 2)]
    ticks = (0, 0, 1, 2, 2, 3)
    assert deadlines == [
        (origin + tick * MS + 10_000 + MS, leading)
        for tick, leading in zip(ticks, (True, False, True, True, False, True), strict=True)
    ]
    assert [made.health.lost for made in here.slots] == [1, 0, 0]
    assert here.slots[0].outputs[0].last.time == 2 * MS + 10_000
    assert here.slots[0].health.age.longest == 30_000 and here.slots[1].health.age.longest == 60_000


def test_a_node_does_not_wait_for_a_stopped_optional_sender(monkeypatch):
    """Otherwise every step of its reader would take one more period."""
    clock = [0]
    monkeypatch.setattr(real.clock, "now", lambda: clock[0])
    waited = []

    def gather(optional: str, age: int) -> int:
        clock[0] = 0
        waited.clear()
        made = slot("Spread" if optional else "Drag", ("pose" if not optional else "force", {}), *(
            (("friction", {"optional": True}),) if optional else (("force", {}),)))  # fmt: skip
        put(made, 0, FORCE if optional else POSE, 100)
        put(made, 1, FORCE, 100 - age)

        def wait(feed, deadline):
            waited.append(feed)
            clock[0] += MS

        real.take_inputs(worker(wait=wait), made, 100, MS, leading=True)
        return len(waited)

    assert gather("optional", 1) == 1 and gather("optional", 7) == 1
    assert gather("optional", 8) == 0
    assert gather("", 8) == 1


@pytest.mark.parametrize(("hardware", "absent"), [(False, False), (True, True)])
def test_a_stall_of_the_node_ages_its_inputs_only_for_hardware(hardware, absent):
    """The whole loop stalls from tick 70 to 100, and the newest input is of tick 68: its age is 2 ticks, or 32."""
    made = slot("Spread", ("force", {}), ("friction", {"optional": True, "waits": False}))
    made.due = 70
    made.node.hardware = hardware
    put(made, 0, FORCE, 100)
    put(made, 1, FORCE, 68)
    gathered = real.take_inputs(worker(), made, 100, 0, leading=True)
    assert gathered is not None and (gathered[1] is None) == absent


def test_an_output_after_the_period_is_overdue(monkeypatch):
    here = Here(last=0)
    monkeypatch.setattr(real.clock, "sleep_until", lambda deadline: 0)
    monkeypatch.setattr(real.clock, "now", lambda: here.clock[0])
    monkeypatch.setattr(real, "take_inputs", lambda *given: [None])
    here.slots[0].node.step = lambda torque, **given: here.clock.__setitem__(0, MS - 30_000) or POSE
    here.slots[0].takes(here.slots[0].counts)
    real.run_real(here)
    assert [made.health.overdue for made in here.slots] == [0, 1, 0]


def test_a_step_has_the_time_of_its_driving_message_and_first_a_nominal_dt(monkeypatch):
    here, seen = Here(last=100), []
    made = slot("Drag", ("pose", {}), ("force", {"waits": False}))
    made.every = made.inputs[0].every = 2
    made.begin()
    here.slots = here.parts = [made]
    made.follows = True
    here.tick = 99
    put(made, 0, POSE, 100)
    put(made, 1, FORCE, 100)
    monkeypatch.setattr(real.clock, "now", lambda: 0)
    monkeypatch.setattr(made, "step", lambda *given: seen.append(given))
    here.send = lambda sent: None
    real.run_real(here)
    ((tick, at, messages, nominal),) = seen
    assert (tick, at, nominal) == (100, 100 * MS, 2e-3) and [m.tick for m in messages] == [100, 100]


def test_a_wait_ends_when_its_sender_dies_or_the_run_stops():
    for ends in ("dead", "stopping"):
        made, here, waits = slot("Drag", ("pose", {}), ("force", {"waits": True})), worker(), []
        put(made, 0, POSE, 100)
        put(made, 1, FORCE, 99)

        def wait(feed, deadline, made=made, here=here, waits=waits, ends=ends):
            waits.append(feed)
            setattr(made.inputs[1] if ends == "dead" else here, ends, True)

        here.wait = wait
        assert real.take_inputs(here, made, 100, 1 << 62, leading=True) is None
        assert len(waits) == 1


def test_a_blocked_node_polls_the_sockets_while_its_input_arrives():
    made, here, drained = slot("Drag", ("pose", {}), ("force", {})), worker(), []
    made.blocked, here.check_orders = True, lambda: None
    put(made, 0, POSE, 3)

    def drain():
        drained.append(None)
        if len(drained) == 3:
            made.blocked = False

    here.drain = drain
    assert real._follow(here, made, None) == (3, 3 * MS)
    assert len(drained) == 4


@pytest.mark.parametrize("lacks", ["dead", "feed"])
def test_a_node_pauses_while_its_driving_sender_is_dead(lacks):
    made, here = slot("Drag", ("pose", {}), ("force", {})), worker(wait=None)
    port, pauses = made.inputs[0], []
    setattr(port, lacks, True if lacks == "dead" else None)

    def pause():
        pauses.append(None)
        port.dead = False
        put(made, 0, POSE, 5)

    here.pause = pause
    assert real._follow(here, made, None) == (5, 5 * MS)
    assert len(pauses) == 1
