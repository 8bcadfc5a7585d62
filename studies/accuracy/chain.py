"""A touch through the nodes that run in a graph: contact.Series, friction.LuGre, spread.Kernel and a body.

They are wired as in graphs/kidney.yaml (the body's law reaches the contact one tick later) and stepped as in a fused
run, without encoding their messages: what is priced is the steps of the nodes, none of which sleeps.
"""

import gc
import time
from collections.abc import Iterator
from typing import Any, TypeVar

import msgspec
import numpy as np

from palpate.engine.job import InputJob, NodeJob
from palpate.engine.schedule import nanoseconds
from palpate.engine.slot import NodeError, Output, Slot
from palpate.engine.tick import run_tick
from palpate.messages import Contact, Friction, Load, Message, Proximity, Surface
from palpate.nodes.base import Node, SettingError, inputs
from palpate.nodes.base.surface import OnSurface, complete
from palpate.nodes.contact import Series
from palpate.nodes.friction import LuGre  # type: ignore[attr-defined]
from palpate.nodes.spread import Kernel
from palpate.physics.entry_point import NO_NODES, NO_VECTORS
from palpate.studies.accuracy import UnsupportedError
from palpate.studies.accuracy.kidney import along
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, MethodOutcome
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.accuracy.truth import SLIDING, worked

M = TypeVar("M", bound=Message)
Sent = tuple[Any, Any, Any, Any]
"""Contact, Friction (None where nothing rubs), Load and Surface of one tick."""
VERTICES = 10000
"""Of the surface, unless a setting says otherwise."""
BALL: dict[str, Any] = {"finger_law": "power", "finger_power_stiffness": 1e12, "finger_power_exponent": 1.0,
                        "finger_damping": 0.0}  # fmt: skip
"""A finger that does not give."""
UP = (0.0, 0.0, 1.0)
LAW = frozenset({"stiffness", "exponent", "damping", "rest_indentation", "previous_indentation", "step", "relaxation"})
"""Fields of a body that the contact reads: its terminal law."""


def surface_of(touch: BenchCase) -> dict[str, Any]:
    """Settings of all nodes that work on the touched surface."""
    return {"surface": "kidney" if touch.body == "kidney" else "plane", "position": (0.0, 0.0, 0.0)}


def run(touch: BenchCase, body: type[Node], fidelity: Fidelity, contact: dict[str, Any], repeats: int) -> MethodOutcome:
    """The touch with this class of body; it is repeated for the times only.

    contact  settings of contact.Series

    UnsupportedError: the body has no basis, or does not take its settings. ArithmeticError: its force is not finite.
    """
    times = np.arange(round(touch.duration * fidelity.rate) + 1) / fidelity.rate
    approach, _, place, slip = touch.at(times)
    begun = time.perf_counter()
    chain = _Chain(body, fidelity, contact, touch)
    offline = time.perf_counter() - begun
    approaches = list(_proximities(touch, fidelity.rate, approach, place, slip))
    seconds: list[np.ndarray] = []
    first: list[Sent] = []
    for turn in range(repeats):
        if turn:
            chain.start()
        heard, spent = chain.through(approaches, keep=turn == 0)
        seconds.append(spent)
        first = first or heard
    force = np.array([c.force for c, *_ in first])
    if not np.isfinite(force).all():
        raise ArithmeticError(f"the force is not finite from {times[np.argmin(np.isfinite(force))]:.4f} s on")
    values = {"force": force}
    if touch.body != "plate":
        values["indentation"] = depth = np.array([c.indentation for c, *_ in first])
        if touch.finger == "ball":
            values["indentation"] = depth = depth + np.array([c.compression for c, *_ in first])
        values["energy"] = worked(force, depth)
    if touch.friction:
        values["friction"] = np.array([float(np.linalg.norm(f.force)) if f else 0.0 for _, f, *_ in first])
    mesh = chain.mesh
    shapes = []
    if mesh is not None and touch.body != "kidney":
        pressed = [_pressed(load, mesh.areas) for _, _, load, _ in first]
        values["area"], values["traction"] = np.array(pressed).T
        flat = mesh.vertices[:, :2]
        for k in np.linspace(0, len(times) - 1, LOOKS + 2).astype(int)[1:-1]:
            moved = np.zeros(len(flat))
            surface = complete(first[k][3], mesh.vertices)
            moved[surface.nodes] = -surface.displacement[:, 2]
            near = np.hypot(flat[:, 0] - place[k], flat[:, 1]) < NEAR
            shapes.append((float(times[k]), flat[near], moved[near]))
    return MethodOutcome(times, values, shapes, np.concatenate(seconds), held_bytes(chain.nodes), offline)


def _proximities(
    touch: BenchCase, rate: float, approach: np.ndarray, place: np.ndarray, slip: np.ndarray
) -> Iterator[Proximity]:
    """On the plane, or along the top of the kidney."""
    if touch.body == "kidney":
        feet, normals, ahead = along(place)
    else:
        feet, normals, ahead = (np.zeros((len(place), 3)) for _ in range(3))
        feet[:, 0], normals[:, 2], ahead[:, 0] = place, 1.0, 1.0
    told = (approach, feet, normals, slip[:, None] * ahead)
    for tick, (e, foot, normal, v) in enumerate(zip(*(one.tolist() for one in told), strict=True)):
        yield Proximity(
            tick=tick, time=nanoseconds(tick, rate), foot=tuple(foot), normal=tuple(normal), coordinates=(0.0, 0.0),
            element=0, gap=-e, approach=max(e, 0.0), slip=tuple(v),
        )  # fmt: skip


def _pressed(load: Load | None, areas: np.ndarray) -> tuple[float, float]:
    """Area [m²] that carries load, and the greatest pressure on it [Pa]."""
    if load is None or len(load.nodes) == 0:
        return 0.0, 0.0
    own = areas[load.nodes]
    return float(own.sum()), float((-load.forces[:, 2] / own).max())


class _Awake(Slot):
    sleeps = False


class _Chain:
    """Contact, friction, spread and body, whose steps `engine.tick` runs."""

    def __init__(self, body: type[Node], fidelity: Fidelity, contact: dict[str, Any], touch: BenchCase) -> None:
        given = fidelity.settings
        surface = surface_of(touch) | {"vertices": VERTICES} | given.get("surface", {})
        own = given.get("body", {})
        if issubclass(body, OnSurface):
            own = {**surface, **own}
        self.rate, self.at = fidelity.rate, 0
        self.near = Output("near", Proximity, False)
        try:
            nodes = {
                "contact": Series(**contact),
                "friction": LuGre(**SLIDING._asdict()) if touch.friction else None,
                "spread": (spread := Kernel(**surface, **given.get("spread", {}))),
                "body": (pressed := body(**own)),
            }
            self.slots = [_slot(name, node, touch.friction) for name, node in nodes.items() if node is not None]
            self.start()
        except SettingError as error:
            raise UnsupportedError(str(error)) from None
        self.nodes = [slot.node for slot in self.slots]
        outputs = {slot.name: slot.outputs[0] for slot in self.slots}
        for slot in self.slots:
            slot.wire(outputs | {"near": self.near})
        self.outputs = [outputs.get(name) for name in nodes]
        self.mesh = spread.mesh() if pressed.wants("displacement") else None

    def start(self) -> None:
        """At rest, and compiled."""
        for slot in self.slots:
            try:
                slot.begin()
            except NodeError as fault:
                raise fault.cause if isinstance(fault.cause, Exception) else fault from None

    def through(self, approaches: list[Proximity], keep: bool) -> tuple[list[Sent], np.ndarray]:
        """What was sent at each tick, if it is kept, and how long the steps of the nodes took [s] (T,)."""
        nothing = Load(nodes=NO_NODES, forces=NO_VECTORS, foot=approaches[0].foot, normal=approaches[0].normal)
        self.slots[-1].step(-1, nanoseconds(-1, self.rate), [nothing], 1.0 / self.rate)
        spent = np.empty(len(approaches))
        heard: list[Sent] = []
        gc.collect()
        gc.disable()
        try:
            for tick, self.near.last in enumerate(approaches):
                begun, self.at = self._spent(), self.near.last.time
                run_tick(self.slots, tick, self)
                spent[tick] = self._spent() - begun
                if keep:
                    sent: list[Any] = [output.last if output else None for output in self.outputs]
                    touched, rubbed, load, surface = sent
                    kept = _copied(load, "nodes", "forces"), _copied(surface, "nodes", "displacement")
                    heard.append((touched, rubbed, *kept))
        finally:
            gc.enable()
        return heard, 1e-9 * spent

    def _spent(self) -> int:
        return sum(slot.health.step.total for slot in self.slots)

    def gather(self, slot: Slot, tick: int) -> None:
        """Nothing comes from elsewhere: each node has its inputs, or none."""
        raise NodeError(slot.name, f"tick {tick}", "an input is missing")

    def sent(self, slot: Slot, tick: int) -> None:
        """Answers stay in the outputs."""


def _slot(name: str, node: Node, friction: bool) -> Slot:
    """A node of the chain with its senders; the body's law reaches the contact one tick later."""
    senders = {Proximity: "near", Contact: "contact", Friction: "friction", Load: "spread", Surface: "body"}
    wires = [
        InputJob(port.name, senders[port.type], senders[port.type], loop=port.type is Surface)
        for port in inputs(type(node))
        if port.type in senders and (friction or port.type is not Friction)
    ]
    return _Awake(NodeJob(name, "", {}, 1, tuple(wires), (name,)), node, ())


def _copied(message: M, *arrays: str) -> M:
    """With arrays of its own, apart from the buffers of the node that sent it."""
    return msgspec.structs.replace(message, **{name: np.array(getattr(message, name)) for name in arrays})


def held_bytes(roots: list[Any]) -> int:
    """Bytes of the arrays that can be reached from these objects; classes, functions and modules are not entered."""
    seen: set[int] = set()
    todo, total = list(roots), 0
    while todo:
        one = todo.pop()
        if id(one) in seen or isinstance(one, type) or callable(one) or type(one).__name__ == "module":
            continue
        seen.add(id(one))
        if isinstance(one, np.ndarray):
            base = one
            while isinstance(base.base, np.ndarray):
                base = base.base
            if base is one or id(base) not in seen:
                seen.add(id(base))
                total += base.nbytes
            continue
        if not isinstance(one, str | bytes | int | float | bool | None):
            todo.extend(gc.get_referents(one))
    return total
