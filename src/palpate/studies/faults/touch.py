"""What the hand feels in a touch by the rules of the real clock, and in the same motion without faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.messages import Message, Pose
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.falcon_statics import force_kernel
from palpate.studies.faults.chain import Chain

Place = tuple[float, float, float]


@dataclass
class Felt:
    """The touch on the hand: largest contact force [N], largest change of the force in a tick [N], smallest absorbed
    energy [J], time with less than half of the contact's force [s]; and at the last tick the absorbed energy [J], the
    contact force and the force on the hand [N], the speed and its component towards the tissue [m/s].

    worst   the tick of the largest contact force
    sent    the tick of the last one
    places  [m] of the hand at each tick
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


def feel(run: Chain, ticks: int, each: Callable[[int, Felt], None] = lambda tick, felt: None) -> Felt:
    """One touch of a simulated Falcon, with the faults of the chain; `each` is called before each tick."""
    felt, energy, before = Felt(), 0.0, np.zeros(3)

    def sent(stream: str, message: Message) -> None:
        if stream == "contact":
            felt.force, felt.sent = message.force, run.tick  # type: ignore[attr-defined]
            if not felt.force <= felt.contact:  # also NaN
                felt.contact, felt.worst = felt.force, run.tick

    run.begin()
    run.sent = sent
    node, geometry, dt = run.device.node, FALCON.geometry, 1.0 / run.rate
    own = node.own  # type: ignore[attr-defined]
    place = own["motion"]["position"].copy()
    for k in range(ticks):
        each(k, felt)
        run.run(1)
        force = np.array(force_kernel(geometry, *own["applied"], *place)[1:])
        step = own["motion"]["position"] - place
        energy -= force @ step
        felt.hand, felt.speed = float(np.linalg.norm(force)), float(np.linalg.norm(step)) / dt
        felt.approach = -float(step[2]) / dt
        felt.without += dt * (felt.hand < 0.5 * felt.force)
        place = own["motion"]["position"].copy()
        felt.change = max(felt.change, float(np.linalg.norm(force - before)))
        felt.energy, felt.taken = min(felt.energy, energy), energy
        x, y, z = place + np.array(node.origin)  # type: ignore[attr-defined]
        felt.places.append((float(x), float(y), float(z)))
        before = force
    return felt


def same_motion(run: Chain, places: Sequence[Place]) -> tuple[float, float]:
    """The largest and the last contact force [N] of the same motion without faults."""
    forces = [0.0]

    def sent(stream: str, message: Message) -> None:
        if stream == "contact":
            forces.append(message.force)  # type: ignore[attr-defined]

    run.begin()
    run.sent = sent
    run.play(
        Pose(position=here, velocity=_velocity(here, before, run.rate), dt=1.0 / run.rate)
        for here, before in zip(places, [places[0], *places], strict=False)
    )
    return max(forces), forces[-1]


def _velocity(here: Place, before: Place, rate: float) -> Place:
    """[m/s] between two places [m] of subsequent ticks."""
    return (here[0] - before[0]) * rate, (here[1] - before[1]) * rate, (here[2] - before[2]) * rate
