"""The features of a data set: names, shapes and units, and how they follow from the streams of a graph.

All vectors are in the world frame, in SI units. In `values`, a field of a stream is an array (episodes, rows, ...).
"""

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from palpate.engine.graph import Edge, Graph
from palpate.messages import Contact, DeviceState, Friction, Message, Pose
from palpate.messages.contact import Wrench
from palpate.messages.tactile import TaxelForces
from palpate.nodes.device.hand import SimulatedOperator
from palpate.nodes.device.path import ends_of, points_of, shapes_of
from palpate.physics.device.grip import path_point

AXES = ("x", "y", "z")
TOUCH = ("point", "displacement", "force")
TOUCHED = tuple(f"{part}.{axis}" for part in TOUCH for axis in AXES)  # elements of a sample of touch
Values = Mapping[tuple[str, str], np.ndarray]
"""By stream and field: (episodes, rows, ...)."""


class Feature(NamedTuple):
    """A feature of each frame: its shape, the names of the elements of its last axis, or of the axes of a picture,
    their units, and the type by its name in LeRobot."""

    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    kind: str = "float32"


@dataclass(frozen=True)
class Window:
    """A feature that has several samples in each frame.

    key     name of the feature
    fields  (stream, field) that it needs
    of      its value (episodes, samples, ..., c) from these fields (episodes, samples, ...)
    names, units  of its last axis
    """

    key: str
    fields: tuple[tuple[str, str], ...]
    of: Callable[[Sequence[np.ndarray]], np.ndarray]
    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True)
class Sources:
    """The streams of a graph that become features.

    poses    streams of fingertips' poses
    hands    name of the node that moves each of them, "" if its motion is not scripted
    windows  features with several samples in each frame
    """

    poses: tuple[str, ...]
    hands: tuple[str, ...]
    windows: tuple[Window, ...]

    @property
    def fields(self) -> list[tuple[str, str]]:
        """All streams and fields that are read."""
        found = [(pose, name) for pose in self.poses for name in ("position", "velocity")]
        return list(dict.fromkeys([*found, *(field for window in self.windows for field in window.fields)]))

    def vectors(self) -> dict[str, Feature]:
        """`observation.state` and `action`."""
        state = [(f"{pose}.{kind}.{axis}", unit) for pose in self.poses
                 for kind, unit in (("position", "m"), ("velocity", "m/s")) for axis in AXES]  # fmt: skip
        action = tuple(f"{pose}.target.{axis}" for pose in self.poses for axis in AXES)
        names, units = zip(*state, strict=True)
        return {
            "observation.state": Feature((len(names),), names, units),
            "action": Feature((len(action),), action, ("m",) * len(action)),
        }


def find_sources(graph: Graph, edges: Mapping[str, Sequence[Edge]], running: Container[str]) -> Sources:
    """The streams of these running nodes that become features; `edges`: connected inputs of each node."""
    nodes = [node for node in graph.nodes.values() if node.name in running]
    kinds = {stream: kind for node in nodes for stream, kind in node.streams.items()}
    sender = {stream: node.name for node in graph.nodes.values() for stream in node.streams}

    def read(stream: str, kind: type[Message]) -> list[str]:
        return [edge.stream for edge in edges[sender[stream]] if kinds.get(edge.stream) is kind]

    def of(kind: type[Message]) -> list[str]:
        return [stream for stream, each in kinds.items() if each is kind]

    rubs = {contact: stream for stream in of(Friction) for contact in read(stream, Contact)}
    poses = of(Pose)
    hands = [sender[device[0]] if (device := read(pose, DeviceState)) else "" for pose in poses]
    scripted = [name if name and issubclass(graph.nodes[name].cls, SimulatedOperator) else "" for name in hands]
    windows = [_touch(contact, rubs.get(contact)) for contact in of(Contact)]
    windows += [_wrench(stream) for stream in of(Wrench)] + [_taxels(stream) for stream in of(TaxelForces)]
    return Sources(tuple(poses), tuple(scripted), tuple(windows))


def _touch(contact: str, friction: str | None) -> Window:
    """The point of contact: its place on the undeformed surface, its displacement along the normal, -s2 n, and the
    force on the finger, f_n n - f_t + a, as in `palpate.gym`."""
    fields = [(contact, name) for name in ("foot", "normal", "indentation", "force", "lateral_force")]

    def of(found: Sequence[np.ndarray]) -> np.ndarray:
        point, normal, indentation, pressing, lateral = found[:5]
        force = pressing[..., None] * normal + lateral
        if len(found) > 5:
            force = force - found[5]
        return np.concatenate([point, -indentation[..., None] * normal, force], axis=-1)

    rubbing = [(friction, "force")] if friction else []
    return Window(f"observation.touch.{contact}", (*fields, *rubbing), of, TOUCHED, ("m",) * 6 + ("N",) * 3)


def _wrench(stream: str) -> Window:
    names = tuple(f"{part}.{axis}" for part in ("force", "torque") for axis in AXES)
    return Window(
        f"observation.wrench.{stream}",
        ((stream, "force"), (stream, "torque")),
        lambda found: np.concatenate(found, -1),
        names,
        ("N",) * 3 + ("N m",) * 3,
    )


def _taxels(stream: str) -> Window:
    """The forces of the taxels, (..., n, 3)."""
    names = ("shear.x", "shear.y", "normal")
    return Window(f"observation.taxels.{stream}", ((stream, "forces"),), lambda found: found[0], names, ("N",) * 3)


def target_of(settings: Mapping[str, Any], kind: type[SimulatedOperator], time: np.ndarray) -> np.ndarray:
    """The commanded position [m] (n,3) of a scripted hand at these times [s] (n), world frame."""
    hand = kind(**settings)
    path = points_of(hand.begin, hand.path), ends_of(hand.path) / hand.speed_factor, shapes_of(hand.path)
    points, ends, shapes = path
    return np.array([path_point(moment, ends, points, shapes)[1:] for moment in time])
