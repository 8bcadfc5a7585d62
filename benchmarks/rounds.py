"""Energy that the bodies generate over closed paths of a finger on the kidney, measured by the ledger.

    python benchmarks/rounds.py [--turns 5]

The finger follows a prescribed path, without device, friction or damping except that of the body. It presses at one
point, slides at constant approach, lifts at another point and returns through the air; or it moves in circles. Printed:
the work put in per turn, the energy that the body has generated in total and relative to the work put in, the residual
of the energy balance, and the greatest energy that the hand received, with the force of the contact and with that of a
passive controller (`controller.Haptic`, `passivity`).
"""

from __future__ import annotations

import argparse

import numpy as np

from palpate.launch.testing import FakeBus
from palpate.messages import Force, Pose
from palpate.nodes.collision import Mesh
from palpate.nodes.contact import Series
from palpate.nodes.controller import Haptic
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE
from palpate.nodes.ledger import Energy
from palpate.nodes.spread import Kernel
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

PLACE = {"surface": "kidney", "vertices": 10000, "position": (0.0, 0.0, 0.0)}
BODIES = {
    "MassSpring, c = 0": lambda: MassSpring(damping=0.0, **PLACE),
    "MassSpring": lambda: MassSpring(**PLACE),
    "ReducedFE, tau = 0": lambda: ReducedFE(retardation=0.0, **PLACE),
    "ReducedFE": lambda: ReducedFE(**PLACE),
    "ReducedFE, linear, tau = 0": lambda: ReducedFE(model="linear", retardation=0.0, **PLACE),
    "BeamBundle": lambda: BeamBundle(**PLACE),
}
THICKNESS = 4e-3
SOFT, STIFF = np.array([-0.0432, -0.0027, 0.0145]), np.array([0.0275, -0.0076, 0.0195])
SOFT_4, STIFF_4 = np.array([-0.0424, -0.0175, 0.013]), np.array([0.0069, 0.0025, 0.021])


def slide(a: np.ndarray, b: np.ndarray, approach: float, steps: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Points near the surface (k,3) and approaches [m] (k): press at a, slide, lift at b, return through the air."""
    line, ramp, air = np.linspace(a, b, 500), np.linspace(0.0, approach, steps), np.full(50, -5e-3)
    points = np.concatenate([np.repeat(a[None], steps, 0), line, np.repeat(b[None], steps, 0), np.linspace(b, a, 50)])
    return points, np.concatenate([ramp, np.full(500, approach), ramp[::-1], air])


def circle(radius: float, approach: float, turn: float) -> tuple[np.ndarray, np.ndarray]:
    """A circle on top of the kidney at constant approach; `turn`: 1 or -1, the direction."""
    angle = turn * np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(len(angle), 0.021)], axis=1)
    return points, np.full(len(angle), approach)


ROUNDS = {
    "slide soft to stiff, 10 mm": slide(SOFT, STIFF, 10e-3),
    "slide stiff to soft, 10 mm": slide(STIFF, SOFT, 10e-3),
    "slide soft to stiff, 4 mm": slide(SOFT_4, STIFF_4, 4e-3),
    "slide stiff to soft, 4 mm": slide(STIFF_4, SOFT_4, 4e-3),
    "circle of 12 mm, 10 mm deep": circle(12e-3, 10e-3, 1.0),
    "the same, reversed": circle(12e-3, 10e-3, -1.0),
}


class Display:
    """Energy [J] that the hand receives from a force that is constant over each step: `given`; its maximum: `most`."""

    def __init__(self) -> None:
        self.given = self.most = 0.0
        self.place, self.force = None, np.zeros(3)

    def to(self, place: np.ndarray, force) -> None:
        """Move to a position [m] (3); `force` [N] (3) acts until the next call."""
        if self.place is not None:
            self.given += float(self.force @ (place - self.place))
            self.most = max(self.most, self.given)
        self.place, self.force = place, np.asarray(force)


class TouchedBody:
    """A body, a finger that moves along a path on it, and the ledger of their energy."""

    def __init__(self, body) -> None:
        self.near = FakeBus(Mesh(thickness=THICKNESS, **PLACE))
        self.contact, self.spread = FakeBus(Series(finger_damping=0.0)), FakeBus(Kernel(**PLACE))
        self.body, self.ledger = FakeBus(body), FakeBus(Energy(bound=0.0))
        self.controller = FakeBus(Haptic(resolution=0.0))
        self.bare, self.kept = Display(), Display()
        self.surface = None
        self.put = self.unexplained = 0.0

    def to(self, place: np.ndarray) -> None:
        """Move the finger to a position [m] (3)."""
        before = place if self.bare.place is None else self.bare.place
        pose = Pose(position=tuple(place.tolist()), velocity=tuple(((place - before) / 1e-3).tolist()), dt=1e-3)
        (near,) = self.near.publish(pose)
        held = [self.surface] if self.surface is not None else []
        contact = self.contact.publish(*held, near)[-1]
        (load,) = self.spread.publish(contact)
        (self.surface,) = self.body.publish(load)
        n, a = np.array(contact.normal), np.array(contact.lateral_force)
        force = Force(force=tuple((contact.force * n + a).tolist()), state="contact", energy=0.0)
        balance = self.ledger.publish(pose, contact, self.surface, force)[-1]
        self.put += max(balance.work, 0.0)
        self.bare.to(place, force.force)
        self.kept.to(place, self.controller.publish(contact, pose)[-1].force)
        self.unexplained = balance.unexplained


def measure(body, points: np.ndarray, approaches: np.ndarray, turns: int) -> TouchedBody:
    """The touch after `turns` closed paths."""
    touch = TouchedBody(body)
    foot, normal, *_ = MeshClosestPoint(body.mesh()).find(points)
    places = foot + (THICKNESS - approaches)[:, None] * normal
    before = max(approaches[0], 0.0)
    for e in np.linspace(-1e-3, before, 100):  # approach the start of the path
        touch.to(foot[0] + (THICKNESS - e) * normal[0])
    for _ in range(turns):
        for place in places:
            touch.to(place)
    for e in np.linspace(approaches[-1], -1e-3, 100):
        touch.to(foot[-1] + (THICKNESS - e) * normal[-1])
    return touch


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--turns", type=int, default=5)
    turns = parser.parse_args().turns
    titles = f"body | path, {turns} times | put in per turn [mJ] | generated [mJ] | of work put in | unexplained [mJ]"
    print(f"| {titles} | to the hand, contact force [mJ] | with the controller [mJ] |")
    print("|---|---|---|---|---|---|---|---|")
    for name, body in BODIES.items():
        for kind, path in ROUNDS.items():
            touch = measure(body(), *path, turns)
            made, put = touch.ledger.node.generated_energy("tissue"), touch.put
            note = "" if touch.surface.stored else " (does not report its stored energy)"
            row = f"{1e3 * put / turns:.3f} | {1e3 * made:.3f}{note} | {100.0 * made / put:.1f} %"
            given = f"{1e3 * touch.bare.most:.3f} | {1e3 * touch.kept.most:.3f}"
            print(f"| {name} | {kind} | {row} | {1e3 * touch.unexplained:.4f} | {given} |", flush=True)


if __name__ == "__main__":
    main()
