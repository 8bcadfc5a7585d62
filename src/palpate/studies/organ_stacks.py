"""A random search of rows of organs on foundations that hit each other (docs/equations/moving-organs.md).

Two to four balls in a row, of 1 g to 30 kg with ratios up to 1000, soft or rigid, on foundations of 10 N/m to 1 MN/m or
free, attached or loose; the first hits the others. Every step is checked: the energy of organs, foundations and weights
is at most that at the start; no organ is deeper in another than `DEEPEST`; free organs keep their momentum; exchanged
bodies have the same bits.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.contact.coupled import Coupled
from palpate.nodes.support import OrganFoundation
from palpate.physics.bodies.floating.foundation import mechanical_energy
from palpate.studies.organ_pairs import DEEPEST

RADIUS = 21e-3  # [m] of the balls; 1 % of it is more than DEEPEST
GAINED = 1e-9  # [1] energy over that at the start
LOST = 1e-9  # [1] of the momentum of free organs
FREE = {"stiffness": 1e-12, "damping": 0.0}
STEPS = 400


class Row:
    """Balls in a row, each on a foundation (its settings), fixed (None) or moved (a list of supports).

    history  of each step the messages of all contacts, and the supports
    """

    def __init__(
        self, bodies: list[dict[str, Any]], foundations: list[Any], friction: float = 0.0, exchanged: bool = False
    ) -> None:
        pairs = [(i, i + 1) for i in range(len(bodies) - 1)]
        if exchanged:
            pairs = [(j, i) for i, j in pairs]
        island: list[dict[str, Any]] = [
            {
                "settings": {"bodies": json.dumps([bodies[k] for k in pair]), "friction": friction, "cells": 100},
                "loads": [[], []], "bodies": pair, "supports": pair,
            }
            for pair in pairs
        ]  # fmt: skip
        text = json.dumps(island)
        self.contacts = [Coupled(island=text, place=k, **each["settings"]) for k, each in enumerate(island)]
        self.pairs, self.sent, self.history = pairs, [None] * len(bodies), list[tuple[list[OrganContact], list[Any]]]()
        self.foundations = []
        for k, given in enumerate(foundations):
            if isinstance(given, dict):
                sides = tuple(pair.index(k) for pair in pairs if k in pair)
                given = OrganFoundation(shape=json.dumps(bodies[k]["surface"]), sides=sides, **given)
            self.foundations.append(given)
        for node in (*self.contacts, *self.moving()):
            node.start()

    def moving(self) -> list[OrganFoundation]:
        """The foundations of the organs that forces move."""
        return [each for each in self.foundations if isinstance(each, OrganFoundation)]

    def run(self, count: int, dt: float = 1e-3) -> list[OrganContact]:
        """Some steps; returns the last messages of the contacts."""
        answers: list[OrganContact] = []
        for tick in range(count):
            supports: list[Support | None] = [
                given[min(tick, len(given) - 1)] if isinstance(given, list) else sent
                for given, sent in zip(self.foundations, self.sent, strict=True)
            ]
            answers = [contact.step([], [], [], supports, dt=dt) for contact in self.contacts]
            for place, given in enumerate(self.foundations):
                if isinstance(given, OrganFoundation):
                    felt = [each for each, pair in zip(answers, self.pairs, strict=True) if place in pair]
                    self.sent[place] = given.step(felt, None, dt=dt)
            self.history.append((answers, list(self.sent)))
        return answers

    def total_energy(self) -> float:
        """Of organs, foundations and weights [J]."""
        return sum(
            mechanical_energy(each.own["constants"], tuple(each.own["axis"]), each.own["motion"])
            for each in self.moving()
        )

    def momenta(self) -> tuple[np.ndarray, np.ndarray]:
        """Momentum [N s], and angular momentum [N m s] about the origin; the rotations are small."""
        linear, angular = np.zeros(3), np.zeros(3)
        for each in self.moving():
            motion, mass = each.own["motion"], each.mass
            linear = linear + mass * motion["speed"]
            angular = angular + mass * np.cross(each.own["centre"] + motion["at"], motion["speed"])
            angular = angular + each.own["constants"]["inertia"] * motion["rate"]
        return linear, angular


def ball(height: float, aside: float = 0.0) -> dict[str, Any]:
    return {"surface": "sphere", "vertices": 1000, "position": (aside, 0.0, height)}


def body(
    surface: dict[str, Any], stiffness: float = 300.0, retardation: float = 0.0, rigid: bool = False
) -> dict[str, Any]:
    """The body of a ball: springs of `stiffness` [N/m] under a finger, or rigid."""
    soft = {"stiffness": stiffness, "exponent": 1.0, "damping": 0.0, "retardation": retardation} | surface
    return {"use": "Rigid" if rigid else "MassSpring", "settings": {} if rigid else soft, "surface": surface}


@dataclass(frozen=True)
class Stack:
    """One row of organs. speed [m/s] of the first; free: no foundation bears."""

    number: int
    bodies: list[dict[str, Any]]
    foundations: list[Any]
    friction: float
    rate: int  # [Hz]
    speed: tuple[float, float, float]
    free: bool

    def words(self) -> str:
        """Masses and kinds of the organs."""
        kinds = ("rigid" if each["use"] == "Rigid" else "soft" for each in self.bodies)
        masses = (f"{1e3 * each['mass']:.3g} g" if each else "fixed" for each in self.foundations)
        return ", ".join(f"{kind} {mass}" for kind, mass in zip(kinds, masses, strict=True))


@dataclass(frozen=True)
class StackVerdict:
    """Largest overlap [m]; largest energy over that at the start [1]; momentum lost over that at the start [1], 0 if
    foundations bear; largest force [N]; faults."""

    stack: Stack
    overlap: float
    energy: float
    lost: float
    force: float
    faults: tuple[str, ...]


def draw_stack(number: int, seed: int = 0) -> Stack:
    """A random row, the same for a number and seed."""
    rng = np.random.default_rng([seed, number, 81])
    count, middle, free = int(rng.choice([2, 3, 3, 4])), 10.0 ** rng.uniform(-1.5, 0.0), bool(rng.random() < 0.25)
    aside = rng.uniform(-8e-3, 8e-3)
    heights = [np.sqrt((2 * RADIUS) ** 2 - aside**2) + 1e-3, 0.0, -43e-3, -86e-3][:count]
    bodies, foundations = list[dict[str, Any]](), list[Any]()
    for k, height in enumerate(heights):
        past = float(rng.choice([0.0, 10.0 ** rng.uniform(-4, -1)]))
        bodies.append(
            body(ball(height, aside if k == 0 else 0.0), 10.0 ** rng.uniform(1.5, 5), past, bool(rng.random() < 0.3))
        )
        given: dict[str, Any] = {"mass": max(1e-3, middle * 10.0 ** rng.uniform(-1.5, 1.5))}
        bears = {
            "stiffness": 10.0 ** rng.uniform(1, 6), "damping": float(rng.choice([0.0, 10.0 ** rng.uniform(-2, 2)])),
            "attached": bool(rng.integers(2)), "friction": float(rng.choice([0.0, 0.3])),
        }  # fmt: skip
        fixed = k > 0 and rng.random() < 0.15 and not free
        foundations.append(None if fixed else given | (FREE if free else bears))
    speed = (float(rng.uniform(-0.2, 0.2)), 0.0, -float(rng.uniform(0.05, 1.0)))
    return Stack(
        number, bodies, foundations, float(rng.choice([0.0, 0.3, 1.0])), int(rng.choice([250, 1000, 1000, 10000])),
        speed, free,
    )  # fmt: skip


def run_stack(stack: Stack, exchanged: bool = False) -> tuple[Row, list[float]]:
    """The row after all steps, and its energy [J] before the first and after each."""
    row = Row(stack.bodies, stack.foundations, stack.friction, exchanged)
    row.moving()[0].own["motion"]["speed"] = stack.speed
    energies = [row.total_energy()]
    for _ in range(int(min(max(0.12 * stack.rate, 50), STEPS))):
        row.run(1, 1.0 / stack.rate)
        energies.append(row.total_energy())
    return row, energies


def judge_stack(stack: Stack) -> StackVerdict:
    """Run a row, and with exchanged bodies, and check it."""
    row, energies = run_stack(stack)
    swapped, _ = run_stack(stack, exchanged=True)
    forces = np.array([[each.force for each in answers] for answers, _ in row.history])
    overlap = -min(each.gap for answers, _ in row.history for each in answers)
    energy, lost, faults = max(energies) / energies[0], 0.0, []
    if stack.free:
        start = stack.foundations[0]["mass"] * np.array(stack.speed)
        lost = float(np.linalg.norm(row.momenta()[0] - start) / np.linalg.norm(start))
    if not (np.isfinite(forces).all() and forces.min() >= 0.0 and np.isfinite(energies).all()):
        faults.append("a force that is not finite or pulls")
    if overlap > DEEPEST:
        faults.append("overlap")
    if energy > 1.0 + GAINED:
        faults.append("energy gained")
    if lost > LOST:
        faults.append("momentum lost")
    others = [[each.force for each in answers] for answers, _ in swapped.history]
    if not np.array_equal(forces, others):
        faults.append("other bits with exchanged bodies")
    return StackVerdict(stack, max(overlap, 0.0), energy, lost, float(forces.max()), tuple(faults))


def search_stacks(count: int, seed: int = 0, first: int = 0) -> Iterator[StackVerdict]:
    """The verdicts of `count` random rows."""
    for number in range(first, first + count):
        yield judge_stack(draw_stack(number, seed))
