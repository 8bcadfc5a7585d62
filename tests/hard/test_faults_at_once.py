"""Faults that coincide, and faults that the motion causes, by the rules of the real clock on simulated time.

Two faults overlap: an outage of messages, a node that is stopped (as by SIGSTOP) or one that dies and is restarted
without its state. Or a fault follows the motion: a loose plug loses messages while the finger is fast, a power supply
fails while the force is large, a node stalls when the finger touches. Bounds as in `test_lost_messages.py`: the contact
presses at most 1.2 times as hard as in the same motion without faults, the force on the hand changes by no more than
the slew rate of the controller, and the display gives out at most 1 mJ, plus 10 mW after 0.5 s without force.
"""

import random
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from chain_for_runs import Chain, nothing
from lossy_touch import OVER, TAP, TICKS, TOUCH, Felt, feel, undisturbed

from palpate.launch.load.launchfile import find
from palpate.nodes.controller import PATIENCE, POWER, Haptic

ENERGY = 1e-3  # [J]
KINDS = ("loses", "stops", "restarts")
STAYS = ("device",)  # the simulated hand belongs to it


@dataclass
class Fault:
    """What happens to a node or an edge in some ticks.

    kind   one of KINDS
    where  the node; for `loses` the stream and its reader
    now    whether it lasts at this tick
    """

    kind: str
    where: tuple[str, str]
    now: Callable[[int, Felt], bool]
    words: str
    lasts: bool = False


def place(run: Chain, kind: str, random_: random.Random) -> tuple[str, str]:
    if kind == "loses":
        return random_.choice([(p.stream, slot.name) for slot in run.slots for p in slot.inputs if p.stream])
    return random_.choice([slot.name for slot in run.slots if slot.name not in STAYS]), ""


def together(run: Chain, random_: random.Random) -> list[Fault]:
    """Two or three faults that overlap."""
    faults, begin = [], random_.randint(20, TICKS - 200)
    length = random_.choice([10, 30, 60, 150])
    for _ in range(random_.choice([2, 2, 3])):
        kind = random_.choice(KINDS)
        a = begin + random_.randint(0, length)
        b = a + random_.choice([5, 15, 30, 60, 150])
        where = place(run, kind, random_)
        faults.append(Fault(kind, where, lambda tick, felt, a=a, b=b: a <= tick < b, f"{a}..{b}"))
    return faults


CAUSES: dict[str, Callable[[Felt, float], bool]] = {
    "fast": lambda felt, x: felt.speed > 0.02 + 0.3 * x,
    "approaches": lambda felt, x: felt.approach > 0.02 + 0.2 * x,
    "leaves": lambda felt, x: felt.approach < -0.02 - 0.2 * x,
    "presses": lambda felt, x: felt.force > 0.1 + 3.0 * x,
    "touches lightly": lambda felt, x: 0.0 < felt.force < 0.05 + 1.0 * x,
    "is held": lambda felt, x: felt.hand > 0.1 + 1.5 * x,
}
"""By the state of the last tick, with a threshold by x in 0..1."""


def caused(run: Chain, random_: random.Random) -> list[Fault]:
    """One or two faults that the motion causes: late by some ticks, for some ticks, and then not for some."""
    faults = []
    for _ in range(random_.choice([1, 1, 2])):
        kind, cause, x = random_.choice(KINDS), random_.choice(list(CAUSES)), random_.random() ** 2
        late, lasts = random_.choice([0, 0, 2, 8, 20]), random_.choice([1, 4, 15, 40])
        pauses = random_.choice([1, 5, 30, 300])
        due = [0, -1]  # the tick from which it may happen again, and the one at which it begins

        def now(tick: int, felt: Felt, cause=cause, x=x, late=late, lasts=lasts, pauses=pauses, due=due) -> bool:
            if tick == 0:
                due[:] = [0, -1]
            if due[1] < 0 and tick >= due[0] and CAUSES[cause](felt, x):
                due[1] = tick + late
            if due[1] >= 0 and tick >= due[1] + lasts:
                due[:] = [tick + pauses, -1]
            return 0 <= due[1] <= tick

        words = f"{cause} ({x:.2f}), {late} late, for {lasts}, again after {pauses}"
        faults.append(Fault(kind, place(run, kind, random_), now, words))
    return faults


def suffer(run: Chain, faults: list[Fault]) -> Felt:
    """One touch with these faults."""

    def each(tick: int, felt: Felt) -> None:
        for fault in faults:
            fault.lasts, before = fault.now(tick, felt), fault.lasts
            if fault.kind == "restarts" and fault.lasts != before:
                dead = any(f.lasts for f in faults if f.kind == "restarts" and f.where == fault.where)
                if fault.lasts:
                    run.die(fault.where[0])
                elif not dead:
                    run.revive(fault.where[0])

    def lost(stream: str, reader: str, tick: int) -> bool:
        return any(f.lasts and f.kind == "loses" and f.where == (stream, reader) for f in faults)

    run.halted = lambda node, tick: any(f.lasts and f.kind == "stops" and f.where[0] == node for f in faults)
    try:
        return feel(run, lost, each)
    finally:
        run.halted = lambda node, tick: False


def check(run: Chain, base: Felt, draw: Callable[[Chain, random.Random], list[Fault]], count: int, seed: int) -> None:
    random_ = random.Random(seed)
    for _ in range(count):
        faults = draw(run, random_)
        felt = suffer(run, faults)
        words = "; ".join(f"{f.kind} {' -> '.join(filter(None, f.where))} {f.words}" for f in faults)
        assert felt.change <= Haptic.slew * 1e-3, f"{words}: the force changes by {felt.change:.3f} N in a tick"
        given = ENERGY + POWER * max(felt.without - PATIENCE, 0.0)
        assert felt.energy >= -given, f"{words}: the hand gets {-1e3 * felt.energy:.3f} mJ"
        if felt.contact > OVER * base.contact:
            same = undisturbed(run, felt.places)
            assert felt.contact <= OVER * same, f"{words}: {felt.contact:.3f} N, the same motion {same:.3f} N"


@pytest.mark.parametrize("touch", [pytest.param(TOUCH, id="press"), pytest.param(TAP, id="tap")])
def test_simultaneous_and_motion_triggered_faults_do_no_harm(chain, touch):
    run = chain(find("kidney").but(overrides=touch))
    base = feel(run, nothing)
    for draw in (together, caused):
        check(run, base, draw, 4, seed=1)


def test_a_controller_restarted_during_a_press_starts_without_force(chain):
    """It knows neither the force nor the energy before; it used to jump to the full force, by 1.3 N in a tick."""
    run = chain(find("kidney").but(overrides=TOUCH))
    forces: list[float] = []

    def each(tick: int, felt: Felt) -> None:
        if tick in (250, 290):
            (run.die if tick == 250 else run.revive)("controller")
        forces.append(felt.hand)

    felt = feel(run, nothing, each)
    assert forces[250] > 1.0 and forces[290] == 0.0
    assert all(force <= Haptic.limit / Haptic.ramp * 1e-3 * ticks for ticks, force in enumerate(forces[290:391]))
    assert felt.energy >= -ENERGY


def test_force_that_the_device_did_not_apply_adds_no_energy_credit(chain):
    """The commands of 15 ms of a tap are lost: the device holds 0.2 N, the controller computes up to 4 N."""
    run = chain(find("kidney").but(overrides=TAP))
    controller = run._slot("controller").node
    seen: list[tuple[float, float]] = []

    def each(tick: int, felt: Felt) -> None:
        seen.append((1e3 * controller.own["before"], 1e3 * felt.taken))

    feel(run, lambda stream, reader, tick: (stream, reader) == ("statics", "device") and 22 <= tick < 37, each)
    assert max(observed - taken for observed, taken in seen[45:300]) < 1.0


@pytest.mark.long
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("draw", [together, caused])
@pytest.mark.parametrize(("body", "count"), [("MassSpring", 150), ("ReducedFE", 60), ("BeamBundle", 60)])
def test_many_simultaneous_and_motion_triggered_faults_do_no_harm(chain, body, count, draw):
    for seed, touch in enumerate((TOUCH, TAP)):
        run = chain(find("kidney").but(overrides=(*touch, f"tissue.use=deformation.{body}")))
        check(run, feel(run, nothing), draw, count, 50 + seed)
