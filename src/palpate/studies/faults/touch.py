"""What the hand feels in a touch by the rules of the real clock, and in the same motion without faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.messages import Message, Pose
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.falcon_statics import force_kernel
from palpate.studies.faults.chain import Chain, Hand

Place = tuple[float, float, float]


@dataclass
class Felt:
    """The touch on the hand: largest contact force [N], largest change of the force in a tick [N], smallest absorbed
    energy [J], time with less than half of the contact's force [s]; and at the last tick the absorbed energy [J], the
    contact force and the force on the hand [N], the speed and its component towards the tissue [m/s].

    worst   the tick of the largest contact force
    sent    the tick of the last one
    places  [m] of the hand at each tick
    others  the same of further hands
    """

    contact: float = 0.0
    change: float = 0.0
    energy: float = 0.0
    without: float = 0.0
    taken: float = 0.0
    force: float = 0.0
    hand: float = 0.0
    speed: float = 0.0
    approach: float = 0.0
    worst: int = 0
    sent: int = 0
    places: list[Place] = field(default_factory=list)
    others: list[Felt] = field(default_factory=list)

    @property
    def hands(self) -> list[Felt]:
        """Of all hands."""
        return [self, *self.others]


def feel(run: Chain, ticks: int, each: Callable[[int, Felt], None] = lambda tick, felt: None) -> Felt:
    """One touch of simulated Falcons, with the faults of the chain; `each` is called before each tick with what the
    first hand feels."""
    hands = [_Feeling(hand, Felt()) for hand in run.hands]
    first = hands[0].felt
    first.others = [hand.felt for hand in hands[1:]]
    of = {hand.contact: hand.felt for hand in hands}

    def sent(stream: str, message: Message) -> None:
        if stream in of:
            felt = of[stream]
            felt.force, felt.sent = message.force, run.tick  # type: ignore[attr-defined]
            if not felt.force <= felt.contact:  # also NaN
                felt.contact, felt.worst = felt.force, run.tick

    run.begin()
    run.sent = sent
    for hand in hands:
        hand.begin()
    for k in range(ticks):
        each(k, first)
        run.run(1)
        for hand in hands:
            hand.look(1.0 / run.rate)
    return first


class _Feeling:
    """What a hand feels; `look` after each tick."""

    def __init__(self, hand: Hand, felt: Felt) -> None:
        self.node: Any = hand.device.node
        self.contact, self.felt = hand.contact, felt

    def begin(self) -> None:
        self.place, self.before = self.node.own["motion"]["position"].copy(), np.zeros(3)

    def look(self, dt: float) -> None:
        felt, own, place = self.felt, self.node.own, self.place
        force = np.array(force_kernel(FALCON.geometry, *own["applied"], *place)[1:])
        step = own["motion"]["position"] - place
        felt.taken -= force @ step
        felt.hand, felt.speed = float(np.linalg.norm(force)), float(np.linalg.norm(step)) / dt
        felt.approach = -float(step[2]) / dt
        felt.without += dt * (felt.hand < 0.5 * felt.force)
        self.place = place = own["motion"]["position"].copy()
        felt.change = max(felt.change, float(np.linalg.norm(force - self.before)))
        felt.energy = min(felt.energy, felt.taken)
        x, y, z = place + np.array(self.node.origin)
        felt.places.append((float(x), float(y), float(z)))
        self.before = force


def same_motion(run: Chain, *places: Sequence[Place]) -> tuple[float, float]:
    """The largest and the last contact force [N] of the first hand in the same motion without faults.

    places  of each hand
    """
    return same_motions(run, *places)[0]


def same_motions(run: Chain, *places: Sequence[Place]) -> list[tuple[float, float]]:
    """As `same_motion`, of each hand."""
    streams = [hand.contact for hand in run.hands]
    forces: dict[str, list[float]] = {stream: [0.0] for stream in streams}

    def sent(stream: str, message: Message) -> None:
        if stream in forces:
            forces[stream].append(message.force)  # type: ignore[attr-defined]

    run.begin()
    run.sent = sent
    run.play(zip(*(_poses(each, run.rate) for each in places), strict=True))
    return [(max(forces[stream]), forces[stream][-1]) for stream in streams]


def _poses(places: Sequence[Place], rate: float) -> list[Pose]:
    return [
        Pose(position=here, velocity=_velocity(here, before, rate), dt=1.0 / rate)
        for here, before in zip(places, [places[0], *places], strict=False)
    ]


def _velocity(here: Place, before: Place, rate: float) -> Place:
    """[m/s] between two places [m] of subsequent ticks."""
    return (here[0] - before[0]) * rate, (here[1] - before[1]) * rate, (here[2] - before[2]) * rate
