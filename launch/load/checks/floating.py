"""The surface of an organ that fingers move (support.Foundation), and the laws of these fingers, from which follows its
stable step."""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from palpate.engine.faults import Faults
from palpate.engine.graph import NodeSpec
from palpate.launch.load.contact_paths import MESH
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Contacts, Friction, Load, Surface
from palpate.messages.contact import SIDES, OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.base import inputs, outputs

NO_STICK, NO_TWIST = (0.0, 0.0, 0.0, 0.0), (0.0, 0.0)
RINGS = 1000  # of the mean radii of a patch


def place_fingers(nodes: dict[str, NodeSpec], wires: Iterable[Wire], faults: Faults) -> None:
    """Set `shape` of each foundation, the surface of its body, and `tips`, `sticks` and `twists`, the laws of the
    fingertips at its contacts, of their friction, and how their patches resist twist.

    A fault for a body without a mesh, for each contact or friction whose stiffness is unknown, and for a foundation
    that does not run in each tick.
    """
    wires = [wire for wire in wires if wire.producer in nodes and wire.consumer in nodes]
    for name, spec in nodes.items():
        if not (Support in outputs(spec.cls) and any(issubclass(port.type, Surface) for port in inputs(spec.cls))):
            continue
        if spec.every != 1:
            faults.add(
                f"has `every: {spec.every}`, so that the organ would jump under the fingers by its motion in "
                f"{spec.every} steps, and need {spec.every**2} times the added inertia to be stable",
                "`every: 1`: a step takes 2 µs.",
                spec.place, node=name,
            )  # fmt: skip
        spec.settings["shape"] = next((_shape(w.producer, nodes, wires, faults) for w in _of(name, Surface, wires)), "")
        tips = [_tip(_solver(w.producer, wires), nodes, faults) for w in _of(name, Contact, wires)]
        sticks = [_stick(w.producer, nodes, faults) for w in _of(name, Friction, wires)]
        twists = [
            _twist(touch.producer, rub.producer, nodes, wires)
            for touch, rub in zip(_of(name, Contact, wires), _of(name, Friction, wires), strict=False)
        ]
        spec.settings["tips"] = tuple(tips)
        spec.settings["sticks"] = (*sticks, *[NO_STICK] * (len(tips) - len(sticks)))
        spec.settings["twists"] = (*twists, *[NO_TWIST] * (len(tips) - len(twists)))
        body = next((w.producer for w in _of(name, Surface, wires)), "")
        spec.settings["sides"] = tuple(_side(w.producer, body, nodes, wires) for w in _of(name, OrganContact, wires))


def _of(name: str, kind: type, wires: list[Wire]) -> list[Wire]:
    return [w for w in wires if w.consumer == name and issubclass(w.port.type, kind)]


def _side(between: str, body: str, nodes: dict[str, NodeSpec], wires: list[Wire]) -> int:
    """The place of a body in a contact of organs: 0 the first, 1 the second."""
    loads = {w.producer for w in _of(body, Load, wires)}
    sides = (w.consumer for w in wires if w.producer == between and w.consumer in loads)
    return next((SIDES.index(nodes[side].settings["side"]) for side in sides), 0)


def _shape(body: str, nodes: dict[str, NodeSpec], wires: list[Wire], faults: Faults) -> str:
    """The settings of the surface of a body, or of one that its loads name, as JSON."""
    named = [body, *(w.producer for w in _of(body, Load, wires))]
    given: dict[str, Any] = next((nodes[name].settings for name in named if "surface" in nodes[name].settings), {})
    if not given:
        text = f"is a {nodes[body].use} without a mesh, whose inertia on a foundation is unknown"
        faults.add(text, "deformation.ReducedFE, or loads by spread.Kernel.", nodes[body].place, node=body)
        return ""
    return json.dumps({key: given[key] for key in MESH if key in given}, sort_keys=True)


def _solver(contact: str, wires: list[Wire]) -> str:
    """The node that solves a contact: itself, or the joint that it is a share of."""
    return next((w.producer for w in _of(contact, Contacts, wires)), contact)


def _tip(name: str, nodes: dict[str, NodeSpec], faults: Faults) -> tuple[float, ...]:
    spec = nodes[name]
    if not hasattr(spec.cls, "finger_form"):
        faults.add(
            f"presses an organ on a foundation, whose step needs the stiffness of a {spec.use}, which is unknown",
            "contact.Series, Joint or Backed.", spec.place, node=name,
        )  # fmt: skip
        return (0.0,) * 5
    made: Any = spec.cls(**spec.settings)
    return tuple(map(float, made.finger_form()))


def _stick(name: str, nodes: dict[str, NodeSpec], faults: Faults) -> tuple[float, ...]:
    """Spring [N/m] and damper [N s/m] of a friction without load, and their rise per newton."""
    spec = nodes[name]
    law: Any = getattr(spec.cls, "law", None)
    if not hasattr(law, "stick"):
        faults.add(
            f"rubs an organ on a foundation, whose step needs `stick` of the law of {spec.use}",
            "friction.LuGre, ElastoPlastic or Coulomb.", spec.place, node=name,
        )  # fmt: skip
        return NO_STICK
    made = law(**{field: spec.settings[field] for field in law._fields})
    free, pressed = made.stick(0.0), made.stick(1.0)
    return (*free, *(one - none for one, none in zip(pressed, free, strict=True)))


def _twist(contact: str, friction: str, nodes: dict[str, NodeSpec], wires: list[Wire]) -> tuple[float, ...]:
    """Greatest moment per newton [m] and mean square radius [m²] of the patch of a finger; 0 for a point."""
    spreads = [w.consumer for w in wires if w.producer == contact and Load in outputs(nodes[w.consumer].cls)]
    patch, rough = next((nodes[name].settings for name in spreads), {}), nodes[friction].settings
    if not ("radius" in patch and "kernel" in patch):
        return NO_TWIST
    from palpate.physics.bodies.floating.twisting import mean_radii  # only now: it imports the compiler
    from palpate.physics.contact.spread import kernel_values

    mean, square = mean_radii(kernel_values(patch["kernel"], (np.arange(RINGS) + 0.5) / RINGS), patch["radius"])
    return float(rough.get("mu", rough.get("mu_slide", 0.0))) * mean, square
