"""A graph whose hand follows the page's pointer, and what of it the page shows."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import Placement, ProcessGroup
from palpate.messages import (
    Contact,
    DeviceState,
    Force,
    ForceBand,
    Friction,
    Load,
    Message,
    Pins,
    Pointed,
    Pose,
    Proximity,
    Surface,
    Torque,
)
from palpate.nodes.base import SettingError
from palpate.physics.geometry.mesh import Mesh
from palpate.views.page import PageError

SHOWN = (Pose, Proximity, Contact, Friction, Force, ForceBand, Pins, Pointed, Load, Surface)
POINTER = "palpate-pointer"


@dataclass(frozen=True)
class Touched:
    """What the page has to know of a graph.

    body       name of the node that sends the surface, and the class that it has
    mesh       its undeformed mesh
    place      where its nodes run; the first group has those of every tick
    streams    name of the stream of each message type that is shown
    thickness  [m] of the fingertip before the bone edge
    begin      [m] (3) where the bone edge is at the start
    """

    body: str
    use: str
    mesh: Mesh
    place: Placement
    streams: dict[type[Message], str]
    thickness: float
    begin: tuple[float, float, float]


def steered(launch: LaunchFile, folder: Path) -> tuple[LaunchFile, Path]:
    """The run with the page's hand in place of its device, and the socket where the pointer's samples go.

    folder  a private one, for the graph and the socket

    PageError: no device that a hand could hold.
    """
    graph = launch.load()
    devices = [name for name, spec in graph.nodes.items() if DeviceState in spec.streams.values()]
    if len(devices) != 1:
        raise PageError(
            f"{launch.graph.stem}: nodes that send DeviceState: found {', '.join(devices) or 'none'}, expected one. "
            "Try: palpate touch kidney"
        )
    spec = graph.nodes[devices[0]]
    feeds = {kind: stream for node in graph.nodes.values() for stream, kind in node.streams.items()}
    wires = {port: feeds[kind] for port, kind in _ports(feeds).items()}
    begin = list(spec.settings.get("begin", (0.0, 0.0, 0.116)))
    socket = folder / "pointer"
    nodes: dict[str, Any] = {
        POINTER: {"use": "device.Pointer", "socket": str(socket), "begin": begin},
        spec.name: {"use": "device.Mouse", "in": {"pointer": POINTER, **wires}, "begin": begin},
    }
    for name in ("hand_stiffness", "hand_damping", "mass", "origin"):
        if name in spec.settings:
            nodes[spec.name][name] = spec.settings[name]
    data: dict[str, Any] = {"extends": str(launch.graph.absolute()), "nodes": nodes}
    if launch.scene is not None:
        data["scene"] = launch.scene if isinstance(launch.scene, dict) else str(Path(launch.scene).absolute())
    file = folder / f"{launch.graph.stem}.yaml"
    file.write_text(yaml.safe_dump(data))
    return LaunchFile(graph=file, clock="real", overrides=launch.overrides), socket


def _ports(feeds: dict[type[Message], str]) -> dict[str, type[Message]]:
    """Which input of the hand the graph's answer goes to: torques where it has them, else the force."""
    return {"torque": Torque} if Torque in feeds else {"force": Force} if Force in feeds else {}


def touched(planned: Plan) -> Touched:
    """What the page shows of a plan that its pointer steers. PageError: no body with a mesh, or nobody tells where the
    finger is."""
    begin = tuple(planned.graph.nodes[POINTER].settings["begin"])
    return _shown(planned, (Surface, Pose, Proximity, Contact), _place(planned), begin)


def watched(planned: Plan) -> Touched:
    """What a page shows of a plan that it does not steer. PageError: no body with a mesh, or no contact."""
    return _shown(planned, (Surface, Contact), Placement([ProcessGroup("loop", planned.order)]), (0.0, 0.0, 0.0))


def _shown(planned: Plan, needed: tuple[type[Message], ...], place: Placement, begin: tuple[float, ...]) -> Touched:
    streams: dict[type[Message], str] = {}
    senders = {}
    for name in planned.order:
        for stream, kind in planned.graph.nodes[name].streams.items():
            streams.setdefault(kind, stream)
            senders[stream] = name
    for kind in needed:
        if kind not in streams:
            raise PageError(f"{planned.graph.path.stem}: no node sends {kind.__name__}; a page needs a body, its "
                            "contact and the finger. Try: palpate touch kidney")  # fmt: skip
    body = senders[streams[Surface]]
    mesh, thickness = shape(planned, body, senders[streams[Proximity]] if Proximity in streams else body)
    return Touched(
        body=body,
        use=planned.graph.nodes[body].use,
        mesh=mesh,
        place=place,
        streams={kind: streams[kind] for kind in SHOWN if kind in streams},
        thickness=thickness,
        begin=(begin[0], begin[1], begin[2]),
    )


def shape(planned: Plan, body: str, collision: str) -> tuple[Mesh, float]:
    """The undeformed mesh of a body, and the thickness [m] of the fingertip. PageError: it has none."""
    node = planned.make(body)
    try:
        mesh = node.mesh()  # type: ignore[attr-defined]
    except (AttributeError, SettingError, ValueError, OSError) as error:
        raise PageError(f"node {body!r} ({planned.graph.nodes[body].use}) has no mesh to show: {error}") from None
    return mesh, float(getattr(planned.make(collision), "thickness", 4e-3))


def _place(planned: Plan) -> Placement:
    """What runs at every tick in one process on a core of its own, above the browser's: plain calls between the nodes,
    and nothing that draws can take their time. The rest is left to the other cores."""
    cores = sorted(os.sched_getaffinity(0))
    slow = [name for name in planned.order if planned.graph.nodes[name].every > 1]
    loop = ProcessGroup("loop", [name for name in planned.order if name not in slow], core=(cores[-1],), priority=80)
    return Placement([loop, *([ProcessGroup("rest", slow, core=tuple(cores[:-1] or cores))] if slow else [])])
