"""Computes a test case with the nodes of a graph: contact.Series, friction.LuGre, spread.Kernel and a body.

They are wired as in graphs/kidney.yaml: the law of the body reaches the contact one tick later. As in a fused run, they
are one segment of compiled nodes, one call per tick (engine/segment.py). The step time is the processor time of that
call. No node sleeps, and no message is encoded. A body in Python runs after the segment of the other nodes.
"""

import gc
import time
from typing import Any, TypeVar

import msgspec
import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats
from palpate.engine.job import InputJob, NodeJob
from palpate.engine.schedule import nanoseconds
from palpate.engine.segment import CompiledSegment, segments
from palpate.engine.slot import NodeError, Slot
from palpate.engine.tick import run_tick
from palpate.messages import Contact, Friction, Load, Message, Proximity, Surface
from palpate.nodes.base import TABLE, CompiledNode, Node, Out, SettingError, inputs
from palpate.nodes.base.surface import OnSurface, complete
from palpate.nodes.contact import Series
from palpate.nodes.friction import LuGre  # type: ignore[attr-defined]
from palpate.nodes.spread import Kernel
from palpate.studies.accuracy import UnsupportedError
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.kidney import along
from palpate.studies.accuracy.outcome import LOOKS, NEAR, Fidelity, MethodOutcome
from palpate.studies.accuracy.reference import SLIDING, compute_work

M = TypeVar("M", bound=Message)
Sent = tuple[Any, Any, Any, Any]
"""Contact, Friction (None without friction), Load and Surface of one tick."""
VERTICES = 10000  # Default number of surface vertices
BALL: dict[str, Any] = {"finger_law": "power", "finger_power_stiffness": 1e12, "finger_power_exponent": 1.0,
                        "finger_damping": 0.0}  # fmt: skip
"""A rigid finger."""
LAW = frozenset({"stiffness", "exponent", "damping", "rest_indentation", "previous_indentation", "step", "relaxation"})
"""Fields of Surface that the contact reads: the terminal law."""


def surface_of(touch: BenchCase) -> dict[str, Any]:
    """Settings of all nodes on the touched surface."""
    names = {"kidney": "kidney", "organs": "sphere"}
    return {"surface": names.get(touch.body, "plane"), "position": (0.0, 0.0, 0.0)}


def run(touch: BenchCase, body: type[Node], fidelity: Fidelity, contact: dict[str, Any], repeats: int) -> MethodOutcome:
    """Compute a test case with this class of body.

    One pass collects the messages; `repeats` more passes measure the times, because reading the messages would empty
    the caches of the processor.

    contact  settings of contact.Series

    UnsupportedError: the body lacks a basis or rejects its settings. ArithmeticError: the force is not finite.
    """
    # Build and start the nodes, then run all passes.
    times = np.arange(round(touch.duration * fidelity.rate) + 1) / fidelity.rate
    place = touch.at(times)[2]
    begun = time.perf_counter()
    chain = _Chain(body, fidelity, contact, touch, times)
    offline = time.perf_counter() - begun
    first, _ = chain.through(len(times), keep=True)
    seconds = []
    for _ in range(repeats):
        chain.start()
        seconds.append(chain.through(len(times), keep=False)[1])
    force = np.array([c.force for c, *_ in first])
    if not np.isfinite(force).all():
        raise ArithmeticError(f"the force is not finite from {times[np.argmin(np.isfinite(force))]:.4f} s on")
    # Collect the compared quantities from the messages of the first pass.
    values = {"force": force}
    if touch.body != "plate":
        values["indentation"] = depth = np.array([c.indentation for c, *_ in first])
        if touch.finger == "ball":
            values["indentation"] = depth = depth + np.array([c.compression for c, *_ in first])
        values["energy"] = compute_work(force, depth)
    if touch.friction:
        values["friction"] = np.array([float(np.linalg.norm(f.force)) if f else 0.0 for _, f, *_ in first])
    # Area, traction and shape of the surface, if the body computes it; on the kidney they are not compared.
    mesh = chain.mesh
    shapes = []
    if mesh is not None and touch.body != "kidney":
        pressed = [_loaded_area(load, mesh.areas) for _, _, load, _ in first]
        values["area"], values["traction"] = np.array(pressed).T
        flat = mesh.vertices[:, :2]
        for k in np.linspace(0, len(times) - 1, LOOKS + 2).astype(int)[1:-1]:
            moved = np.zeros(len(flat))
            surface = complete(first[k][3], mesh.vertices)
            moved[surface.nodes] = -surface.displacement[:, 2]
            near = np.hypot(flat[:, 0] - place[k], flat[:, 1]) < NEAR
            shapes.append((float(times[k]), flat[near], moved[near]))
    return MethodOutcome(times, values, shapes, np.concatenate(seconds), held_bytes(chain.nodes), offline)


def sent_messages(touch: BenchCase, body: type[Node], rate: float, settings: dict[str, Any]) -> list[Sent]:
    """The messages of each tick of a test case with this class of body and its settings, steps at `rate` [Hz]."""
    times = np.arange(round(touch.duration * rate) + 1) / rate
    fidelity = Fidelity("", rate, {"body": settings})
    return _Chain(body, fidelity, {}, touch, times).through(len(times), keep=True)[0]


def _motion(touch: BenchCase, times: np.ndarray) -> np.ndarray:
    """Gap [m], foot point [m], normal and slip [m/s] (T,10) on the plane or along the top of the kidney."""
    approach, _, place, slip = touch.at(times)
    if touch.body == "kidney":
        feet, normals, ahead = along(place)
    else:
        feet, normals, ahead = (np.zeros((len(place), 3)) for _ in range(3))
        feet[:, 0], normals[:, 2], ahead[:, 0] = place, 1.0, 1.0
    return np.ascontiguousarray(np.hstack([-approach[:, None], feet, normals, slip[:, None] * ahead]))


class _MotionRows(CompiledNode):
    """Sends one row of `_motion` per tick."""

    paced = True
    State = {"tick": int, "rows": TABLE}

    def __init__(self, rows: np.ndarray) -> None:
        super().__init__()
        self._rows = rows

    def start(self) -> None:
        super().start()
        self.hold("rows", self._rows)

    @kernel
    def compute(own, out: Out[Proximity], dt):
        row = floats(own.rows)[own.tick]
        own.tick += 1
        out.gap = row[0]
        out.approach = max(-row[0], 0.0)
        for i in range(3):
            out.foot[i], out.normal[i], out.slip[i] = row[1 + i], row[4 + i], row[7 + i]


def _loaded_area(load: Load | None, areas: np.ndarray) -> tuple[float, float]:
    """Loaded area [m²] and maximum pressure [Pa]."""
    if load is None or len(load.nodes) == 0:
        return 0.0, 0.0
    loaded = areas[load.nodes]
    return float(loaded.sum()), float((-load.forces[:, 2] / loaded).max())


class Awake(Slot):
    """Steps at each tick, also where nothing changed, so that each tick costs a whole step."""

    sleeps = False


class _Chain:
    """The nodes of a test case: motion, contact, friction, spread and body."""

    def __init__(
        self, body: type[Node], fidelity: Fidelity, contact: dict[str, Any], touch: BenchCase, times: np.ndarray
    ) -> None:
        given = fidelity.settings
        surface = surface_of(touch) | {"vertices": VERTICES} | given.get("surface", {})
        body_settings = (surface if issubclass(body, OnSurface) else {}) | given.get("body", {})
        area = {name: value for name, value in body_settings.items() if name.startswith("area")}
        self.rate, self.at = fidelity.rate, 0
        try:
            nodes = {
                "near": _MotionRows(_motion(touch, times)),
                "contact": Series(**contact | given.get("contact", {})),
                "friction": LuGre(**SLIDING._asdict()) if touch.friction else None,
                "spread": (spread := Kernel(**surface | area | given.get("spread", {}))),
                "body": (pressed := body(**body_settings)),
            }
            self.slots = [_slot(name, node, touch.friction) for name, node in nodes.items() if node is not None]
            self.start()
        except SettingError as error:
            raise UnsupportedError(str(error)) from None
        self.nodes = [slot.node for slot in self.slots]
        outputs = {slot.name: slot.outputs[0] for slot in self.slots}
        for slot in self.slots:
            slot.wire(outputs)
        self.parts = segments(
            self.slots, lambda part: CompiledSegment(part, self.rate, False, lambda *_: 0.0, lambda *_: None)
        )
        self.outputs = [outputs.get(name) for name in nodes if name != "near"]
        self.mesh = spread.mesh() if pressed.wants("displacement") else None

    def start(self) -> None:
        """Start or reset all nodes."""
        for slot in self.slots:
            try:
                slot.begin()
            except NodeError as fault:
                raise fault.cause if isinstance(fault.cause, Exception) else fault from None

    def through(self, ticks: int, keep: bool) -> tuple[list[Sent], np.ndarray]:
        """Run all ticks; returns the messages of each tick (`keep`) and the processor times of the ticks [s] (T,)."""
        whole = self.parts[0] if len(self.parts) == 1 else None
        spent = np.empty(ticks)
        messages: list[Sent] = []
        gc.collect()
        gc.disable()
        try:
            for tick in range(ticks):
                self.at = nanoseconds(tick, self.rate)
                begun = time.thread_time_ns()
                if isinstance(whole, CompiledSegment):
                    whole.advance(tick)
                else:
                    run_tick(self.parts, tick, self)
                spent[tick] = time.thread_time_ns() - begun
                if keep:
                    sent: list[Any] = [output.last if output else None for output in self.outputs]
                    contact, friction, load, surface = sent
                    copies = _copy_message(load, "nodes", "forces"), _copy_message(surface, "nodes", "displacement")
                    messages.append((contact, friction, *copies))
        finally:
            gc.enable()
        return messages, 1e-9 * spent

    def gather(self, slot: Slot, tick: int) -> list[Message | None]:
        """Messages of nodes in other parts; None in the first tick of a loop."""
        needs = [(port, -1 if port.dead or port.inside else port.need(tick)) for port in slot.inputs]
        return [port.of(need) if need >= 0 else None for port, need in needs]

    def take_outputs(self, slot: Slot, tick: int) -> None:
        """The messages stay in the outputs of the slots."""


def _slot(name: str, node: Node, friction: bool) -> Slot:
    """A node with its inputs; the law of the body reaches the contact one tick later."""
    senders = {Proximity: "near", Contact: "contact", Friction: "friction", Load: "spread", Surface: "body"}
    wires = [
        InputJob(port.name, senders[port.type], senders[port.type], loop=port.type is Surface)
        for port in inputs(type(node))
        if port.type in senders and (friction or port.type is not Friction)
    ]
    return Awake(NodeJob(name, "", {}, 1, tuple(wires), (name,)), node, ())


def _copy_message(message: M, *arrays: str) -> M:
    """The message with copies of these arrays, whose buffers its sender reuses."""
    return msgspec.structs.replace(message, **{name: np.array(getattr(message, name)) for name in arrays})


def held_bytes(roots: list[Any]) -> int:
    """Total size [byte] of all arrays reachable from these objects, except through classes, functions and modules."""
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
