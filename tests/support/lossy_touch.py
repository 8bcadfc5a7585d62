"""Touches of the kidney that lose messages: the force on the hand, and that of the same motion without losses."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from chain_for_runs import Chain, Lost

from palpate.launch.testing import FakeBus
from palpate.messages import Message, Pose
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.falcon_statics import force_kernel

TICKS = 900
PATH = (
    "[{to: [0, 0, 0.0935], time: 0.2}, {hold: 0.15}, {to: [0.02, 0, 0.0925], time: 0.25, shape: linear},"
    "{to: [0, 0, 0.0955], time: 0.1}, {to: [0, 0, 0.113], time: 0.15}]"
)
TOUCH = ("scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]", f"scene.hand.path={PATH}")
OVER = 1.2  # [1]
TAP = (
    "scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.0425, shape: linear}, {hold: 0.3},"
    "{to: [0, 0, 0.110], time: 0.05, shape: linear}, {to: [0, 0, 0.095], time: 0.0425, shape: linear}, {hold: 0.2}]",
)  # fmt: skip
"""0.4 m/s."""
SLIDE = (
    "scene.surface.vertices=600", "scene.hand.begin=[-0.02, 0, 0.112]",
    "scene.hand.path=[{to: [-0.02, 0, 0.096], time: 0.12}, {hold: 0.08}, {to: [0.02, 0.004, 0.095], time: 0.15},"
    "{to: [-0.02, -0.004, 0.095], time: 0.1, shape: linear}, {hold: 0.1}, {to: [0.01, 0, 0.0945], time: 0.12},"
    "{to: [0.01, 0, 0.113], time: 0.15}]",
)  # fmt: skip
"""Along the kidney and back, at up to 0.5 m/s."""


@dataclass
class Felt:
    """The touch on the hand: largest contact force [N], largest change of the force in a tick [N], smallest absorbed
    energy [J], time with less than half of the contact's force [s]; and at the last tick the absorbed energy [J], the
    contact force and the force on the hand [N], the speed and its component towards the tissue [m/s]."""

    contact: float = 0.0
    change: float = 0.0
    energy: float = 0.0
    without: float = 0.0
    taken: float = 0.0
    force: float = 0.0
    hand: float = 0.0
    speed: float = 0.0
    approach: float = 0.0
    places: list[tuple[float, float, float]] = field(default_factory=list)


def feel(run: Chain, lost: Lost, each: Callable[[int, Felt], None] = lambda tick, felt: None) -> Felt:
    """One touch with these losses; `each` is called before each tick."""
    felt, energy, before = Felt(), 0.0, np.zeros(3)

    def sent(stream: str, message: Message) -> None:
        if stream == "contact":
            felt.force = message.force
            felt.contact = max(felt.contact, felt.force)

    run.begin()
    run.lost, run.sent = lost, sent
    node, geometry = run.device.node, FALCON.geometry
    place = node.own["motion"]["position"].copy()
    for k in range(TICKS):
        each(k, felt)
        run.run(1)
        force = np.array(force_kernel(geometry, *node.own["applied"], *place)[1:])
        step = node.own["motion"]["position"] - place
        energy -= force @ step
        felt.hand, felt.speed = float(np.linalg.norm(force)), 1e3 * float(np.linalg.norm(step))
        felt.approach = -1e3 * float(step[2])
        felt.without += 1e-3 * (felt.hand < 0.5 * felt.force)
        place = node.own["motion"]["position"].copy()
        felt.change = max(felt.change, float(np.linalg.norm(force - before)))
        felt.energy, felt.taken = min(felt.energy, energy), energy
        felt.places.append(tuple((place + np.array(node.origin)).tolist()))
        before = force
    return felt


def undisturbed(run: Chain, places: list[tuple[float, float, float]]) -> float:
    """Largest contact force [N] of the same motion without losses."""
    nodes = {slot.name: FakeBus(type(slot.node)(**slot.job.settings)) for slot in run.slots}
    surface, most, before = None, 0.0, places[0]
    for place in places:
        velocity = tuple((a - b) * 1e3 for a, b in zip(place, before, strict=True))
        (proximity,) = nodes["collision"].publish(Pose(position=place, velocity=velocity, dt=1e-3))
        if surface is not None:
            nodes["contact"].hold("body", surface)
        (contact,) = nodes["contact"].publish(proximity)
        nodes["friction"].hold("proximity", proximity)
        (friction,) = nodes["friction"].publish(contact)
        nodes["spread"].hold("friction", friction)
        (load,) = nodes["spread"].publish(contact)
        (surface,) = nodes["tissue"].publish(load)
        most, before = max(most, contact.force), place
    return most
