"""A random search of pairs of organs that touch while a finger presses one of them (docs/equations/between.md).

Each case has two bodies of random kinds, shapes, stiffnesses, turns and gap. A finger moves along the normal of the
upper one, into it and back, without a device, while the lower one moves up and back with its foundation; with friction
it also slides. Every step is checked.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.messages import Contact, Proximity
from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes import deformation
from palpate.nodes.base.contacts import press_body
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.contact.backed import Backed
from palpate.nodes.contact.between import Between
from palpate.nodes.contact.side import Side
from palpate.nodes.spread import Kernel
from palpate.physics.geometry.mesh_closest import MeshClosestPoint

DT = 1e-3  # [s]
VERTICES = 2000
KINDS = "ReducedFE", "MassSpring", "BeamBundle", "Rigid"
SHAPES = "sphere", "kidney"
DEEPEST = 1e-4  # [m] overlap allowed
LIMIT = 1.2  # [1] change of the force per step over that on a rigid body


@dataclass(frozen=True)
class Case:
    """One pair. `upper`, `lower`: class and settings of each body, and its surface."""

    number: int
    upper: dict[str, Any]
    lower: dict[str, Any]
    gap: float  # [m]
    depth: float  # [m] of the finger's motion
    closing: float  # [m] of the lower body's motion
    duration: float  # [s] of the way in
    foot: np.ndarray  # [m] (3)
    normal: np.ndarray  # [1] (3)
    friction: float = 0.0  # [1] between the organs
    viscous: float = 0.0  # [s/m]
    slide: tuple[float, float] = (0.0, 0.0)  # [m] of the lower body's motion along x and y


@dataclass
class Course:
    """Results of a run, one per step."""

    contacts: list[Contact] = field(default_factory=list)
    between: list[OrganContact] = field(default_factory=list)
    excess: list[float] = field(default_factory=list)  # see `friction_excess`


@dataclass(frozen=True)
class Verdict:
    """What a case did: largest overlap [m], energy generated [J], largest change of the force per step over that on a
    rigid body [1], largest forces of finger and organs [N], whether exchanged bodies have other bits; faults."""

    case: Case
    overlap: float
    generated: float
    change: float
    finger: float
    organs: float
    faults: tuple[str, ...]


def body_of(rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """A random body: class and settings without its surface."""
    kind = str(rng.choice(KINDS))
    stiffness = float(10.0 ** rng.uniform(-0.7, 1.3))  # of 19 kPa and 257 N/m
    retardation = float(10.0 ** rng.uniform(-4, -1))
    if kind == "ReducedFE":
        model = str(rng.choice(["nonlinear", "linear"]))
        return kind, {"young": 19e3 * stiffness, "retardation": retardation, "model": model}
    if kind == "MassSpring":
        given = {"stiffness": 257.0 * stiffness, "exponent": 1.0, "damping": 0.0, "retardation": retardation}
        return kind, given
    if kind == "BeamBundle":
        return kind, {
            "layers": (3e-3, 17e-3), "moduli": (257.6e3 * stiffness, 64.4e3 * stiffness),
            "relaxations": (0.1 * retardation, retardation),
        }  # fmt: skip
    return kind, {}


def case(number: int, seed: int = 0) -> Case:
    """A random pair, the same for a number and seed."""
    rng = np.random.default_rng([seed, number])
    shapes = [str(rng.choice(SHAPES)) for _ in range(2)]
    x, y, z = rng.uniform(-np.pi, np.pi, 3).tolist()
    turn = (x, y, z)
    gap, tilt = float(rng.uniform(0.1e-3, 3e-3)), rng.uniform(-6e-3, 6e-3, 2)
    lower = surface_mesh(shapes[1], VERTICES, (0.0, 0.0, 0.0))
    height, search = 0.1, MeshClosestPoint(lower)
    for _ in range(60):
        upper = surface_mesh(shapes[0], VERTICES, (float(tilt[0]), float(tilt[1]), height), turn)
        near = min(float(search.find(upper.vertices)[3].min()), 1.0)
        if abs(near - gap) < 1e-6:
            break
        height -= 0.8 * (near - gap)
    surfaces = [
        {"surface": shapes[0], "vertices": VERTICES, "position": (float(tilt[0]), float(tilt[1]), height),
         "rotation": turn},
        {"surface": shapes[1], "vertices": VERTICES, "position": (0.0, 0.0, 0.0)},
    ]  # fmt: skip
    made = []
    for surface in surfaces:
        use, given = body_of(rng)
        made.append({"use": use, "settings": given if use == "Rigid" else given | surface, "surface": surface})
    top = np.flatnonzero(upper.normals[:, 2] > 0.5)
    foot = int(rng.choice(top))
    speed = 10.0 ** rng.uniform(-2, -0.5)
    depth = float(rng.uniform(2e-3, 8e-3))
    closing = gap + float(rng.uniform(-0.5e-3, 3e-3))
    above, below = made
    duration = max(depth, closing) / speed
    friction, viscous = float(rng.choice([0.0, 0.0, 0.05, 0.3, 1.0])), float(rng.choice([0.0, 0.0, 3.0]))
    x, y = (rng.uniform(0, 3e-3) * rng.standard_normal(2) if friction > 0.0 else np.zeros(2)).tolist()
    return Case(
        number, above, below, gap, depth, closing, duration, upper.vertices[foot], upper.normals[foot], friction,
        viscous if friction > 0.0 else 0.0, (x, y),
    )  # fmt: skip


def motion(case: Case, dt: float = DT) -> np.ndarray:
    """Share [1] of the way of both motions at each step of dt [s]: in, a hold, and out."""
    steps, rest = max(int(case.duration / dt), 3), round(0.02 / dt)
    way = 0.5 * (1.0 - np.cos(np.pi * np.arange(1, steps + 1) / steps))
    return np.concatenate([way, np.ones(rest), way[::-1], np.zeros(rest)])


def nodes_of(case: Case, exchanged: bool) -> tuple[Any, Any, Between, Side, Side, Kernel, Backed]:
    """The started nodes; with `exchanged` bodies the upper one is the second of the contact."""
    bodies = []
    for each, organs in ((case.upper, 1), (case.lower, 1)):
        more = {"organ_loads": organs} if each["use"] == "ReducedFE" else {}
        bodies.append(getattr(deformation, each["use"])(**each["settings"], **more))
    order = [case.lower, case.upper] if exchanged else [case.upper, case.lower]
    between = Between(bodies=json.dumps(order), friction=case.friction, viscous=case.viscous)
    sides = ("second", "first") if exchanged else ("first", "second")
    above = Side(side=sides[0], **case.upper["surface"])
    below = Side(side=sides[1], **case.lower["surface"])
    spread, contact = Kernel(**case.upper["surface"]), Backed(thickness=0.0)
    made = (*bodies, between, above, below, spread, contact)
    for node in made:
        node.start()
    return made


def support_at(way: np.ndarray) -> list[Support]:
    """The input for a foundation displaced by `way` [m] (3)."""
    x, y, z = map(float, way)
    return [Support(displacement=(x, y, z), velocity=(0.0, 0.0, 0.0))]


def finger_at(case: Case, tick: int, approach: float, dt: float = DT) -> Proximity:
    """The finger at its foot in a step of dt [s], into the undeformed body by `approach` [m]."""
    (nx, ny, nz), (x, y, z) = case.normal.tolist(), case.foot.tolist()
    return Proximity(
        foot=(x, y, z), normal=(nx, ny, nz), coordinates=(0.0, 0.0), element=0, gap=-float(approach),
        approach=max(float(approach), 0.0), slip=(0.0, 0.0, 0.0), separation=max(-float(approach), 0.0), tick=tick,
        time=round(tick * dt * 1e9),
    )  # fmt: skip


def forces_on_rigid(case: Case) -> np.ndarray:
    """Force [N] of the finger on a rigid body alone, at each step. It moves into the finger if the lower one rises."""
    body, spread, contact, surface = deformation.Rigid(), Kernel(**case.upper["surface"]), Backed(thickness=0.0), None
    for node in (body, spread, contact):
        node.start()
    forces = []
    for tick, share in enumerate(motion(case)):
        approach = case.depth * share - 1e-4 + max(case.closing, 0.0) * share * max(float(case.normal[2]), 0.0)
        touch = contact.step(finger_at(case, tick, approach), surface, [], dt=DT)
        forces.append(touch.force)
        surface = press_body(body, spread.step(touch, None, dt=DT), dt=DT)
    return np.array(forces)


def run(case: Case, exchanged: bool = False, dt: float = DT) -> Course:
    """Step the nodes in the order of a graph, by dt [s]."""
    upper, lower, between, above, below, spread, contact = nodes_of(case, exchanged)
    course, surface, felt = Course(), None, None
    for tick, share in enumerate(motion(case, dt)):
        way = float(share) * np.array([*case.slide, case.closing])
        carried = {("first" if exchanged else "second") + "_support": support_at(way)}
        touch = contact.step(finger_at(case, tick, case.depth * share - 1e-4, dt), surface, [felt], dt=dt)
        load = spread.step(touch, None, dt=dt)
        course.contacts.append(touch)
        loads = ([], [load]) if exchanged else ([load], [])
        organs = between.step(*loads, dt=dt, **carried)
        (push, felt), (counter, _) = above.step(organs, dt=dt), below.step(organs, dt=dt)
        surface = upper.step([load, push], dt=dt)
        lower.step([counter], dt=dt)
        course.between.append(organs)
        course.excess.append(friction_excess(case, between))
    return course


def friction_excess(case: Case, between: Between) -> float:
    """Largest excess [N] of the dry friction at a candidate over mu times its normal force, after a step.

    The film of fluid acts at each candidate with the part along its tangents of the mean velocity v of the patch,
    f_i = -c p_i (I - n_i n_i') v; on a curved patch v also has a part along the mean normal, with which a check of the
    sum of the forces would find friction that does not act.
    """
    held = between._held
    force, normal, pressed = held["rub.force"][0], held["one.normal"], held["pair.active.force"]
    if not len(force):  # the bodies slide freely
        return 0.0
    along = held["rub.speed"] - (normal * held["rub.speed"]).sum(axis=1, keepdims=True) * normal
    dry = force + case.viscous * pressed[:, None] * along
    rounding = 1e-9 * (pressed + np.linalg.norm(force, axis=1))
    return float((np.linalg.norm(dry, axis=1) - case.friction * pressed - rounding).max(initial=0.0))


def judge(case: Case) -> Verdict:
    """Run a case, and with exchanged bodies, and check it."""
    found, swapped = run(case), run(case, exchanged=True)
    forces = np.array([c.force for c in found.contacts])
    organs = np.array([b.force for b in found.between])
    bound = np.abs(np.diff(forces_on_rigid(case))).max()
    overlap = -min(b.gap for b in found.between)
    generated = found.between[-1].generated
    change = float(np.abs(np.diff(forces)).max() / max(bound, 1e-6))
    faults = []
    if not (np.isfinite(forces).all() and forces.min() >= 0.0 and np.isfinite(organs).all() and organs.min() >= 0.0):
        faults.append("a force that is not finite or pulls")
    if overlap > DEEPEST:
        faults.append("overlap")
    if generated > 1e-9 + 1e-6 * found.between[-1].dissipated:
        faults.append("energy generated")
    faults += _rubs(case, found)
    if change > LIMIT:
        faults.append("change of the force per step")
    if not np.array_equal(forces, [c.force for c in swapped.contacts]):
        faults.append("other bits with exchanged bodies")
    return Verdict(case, max(overlap, 0.0), generated, change, float(forces.max()), float(organs.max()), tuple(faults))


def _rubs(case: Case, course: Course) -> list[str]:
    """Faults of the friction: above its limit, or energy that it returns beyond what its bristles store."""
    faults = []
    if max(course.excess) > 0.0:
        faults.append("friction above its limit")
    if case.friction > 0.0 and np.diff([b.dissipated for b in course.between], prepend=0.0).min() < -1e-12:
        faults.append("energy returned by friction")
    return faults


def search(count: int, seed: int = 0, first: int = 0) -> Iterator[Verdict]:
    """The verdicts of `count` random pairs."""
    for number in range(first, first + count):
        yield judge(case(number, seed))
