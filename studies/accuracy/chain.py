"""A touch through the nodes that run in a graph: contact.Series, friction.LuGre, spread.Kernel and a body.

They are wired as in graphs/kidney.yaml (the body's law reaches the contact one tick later) and called as in a fused
run, without encoding their messages: what is priced is the steps of the nodes.
"""

import gc
import time
from collections.abc import Iterator
from typing import Any, TypeVar

import msgspec
import numpy as np

from palpate.messages import Contact, Friction, Load, Message, Proximity, Surface
from palpate.nodes.base import Node, SettingError
from palpate.nodes.base.contacts import press
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

Sent = TypeVar("Sent", bound=Message)
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
    inputs = list(_proximities(touch, approach, place, slip))
    seconds: list[np.ndarray] = []
    first: list[tuple[Contact, Friction | None, Load | None, Surface]] = []
    for turn in range(repeats):
        if turn:
            chain.start()
        heard, spent = chain.through(inputs, 1.0 / fidelity.rate, keep=turn == 0)
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


def _proximities(touch: BenchCase, approach: np.ndarray, place: np.ndarray, slip: np.ndarray) -> Iterator[Proximity]:
    """On the plane, or along the top of the kidney."""
    if touch.body == "kidney":
        feet, normals, ahead = along(place)
    else:
        feet, normals, ahead = (np.zeros((len(place), 3)) for _ in range(3))
        feet[:, 0], normals[:, 2], ahead[:, 0] = place, 1.0, 1.0
    told = (approach, feet, normals, slip[:, None] * ahead)
    for e, foot, normal, v in zip(*(one.tolist() for one in told), strict=True):
        yield Proximity(
            foot=tuple(foot), normal=tuple(normal), coordinates=(0.0, 0.0), element=0, gap=-e, approach=max(e, 0.0),
            slip=tuple(v),
        )  # fmt: skip


def _pressed(load: Load | None, areas: np.ndarray) -> tuple[float, float]:
    """Area [m²] that carries load, and the greatest pressure on it [Pa]."""
    if load is None or len(load.nodes) == 0:
        return 0.0, 0.0
    own = areas[load.nodes]
    return float(own.sum()), float((-load.forces[:, 2] / own).max())


class _Chain:
    """Contact, friction, spread and body."""

    def __init__(self, body: type[Node], fidelity: Fidelity, contact: dict[str, Any], touch: BenchCase) -> None:
        given = fidelity.settings
        surface = surface_of(touch) | {"vertices": VERTICES} | given.get("surface", {})
        own = given.get("body", {})
        if issubclass(body, OnSurface):
            own = {**surface, **own}
        try:
            self.body = body(**own)
            self.contact = Series(**contact)
            self.friction = LuGre(**SLIDING._asdict()) if touch.friction else None
            self.spread = Kernel(**surface, **given.get("spread", {}))
            self.nodes = [n for n in (self.contact, self.friction, self.spread, self.body) if n is not None]
            self.start()
        except SettingError as error:
            raise UnsupportedError(str(error)) from None
        self.mesh = self.spread.mesh() if self.body.wants("displacement") else None

    def start(self) -> None:
        """At rest, and compiled."""
        for node in self.nodes:
            node.start()

    def through(
        self, inputs: list[Proximity], dt: float, keep: bool
    ) -> tuple[list[tuple[Contact, Friction | None, Load | None, Surface]], np.ndarray]:
        """What was sent at each tick, if it is kept, and how long the tick took [s] (T,)."""
        contact, friction, spread, body = self.contact.step, self.friction, self.spread.step, self.body
        nothing = Load(nodes=NO_NODES, forces=NO_VECTORS, foot=inputs[0].foot, normal=inputs[0].normal)
        surface = press(body, nothing, dt=dt)
        spent = np.empty(len(inputs))
        heard: list[tuple[Contact, Friction | None, Load | None, Surface]] = []
        gc.collect()
        gc.disable()
        try:
            for k, proximity in enumerate(inputs):
                begun = time.perf_counter_ns()
                touched = contact(proximity, surface, dt=dt)
                rubbed = None if friction is None else friction.step(touched, proximity, dt=dt)
                load = spread(touched, rubbed, dt=dt)
                surface = press(body, load, dt=dt)
                spent[k] = time.perf_counter_ns() - begun
                if keep:
                    kept = _copied(load, "nodes", "forces"), _copied(surface, "nodes", "displacement")
                    heard.append((touched, rubbed, *kept))
        finally:
            gc.enable()
        return heard, 1e-9 * spent


def _copied(message: Sent, *arrays: str) -> Sent:
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
