"""Replaces the devices of a graph by hands that follow the page's pointers, and selects what the page shows."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import yaml

from palpate.compiler.cores import usable_cores
from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.launch.load.files import Override
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
    Spikes,
    Surface,
    Torque,
    Vector3,
)
from palpate.messages.vibration import Vibration
from palpate.nodes.base import SettingError
from palpate.nodes.device.mailbox import Outbox
from palpate.nodes.device.mouse import FARTHEST
from palpate.physics.geometry.mesh import Mesh
from palpate.views.errors import PageError
from palpate.views.shown import Bodies, Finger, fingers, links_of_plan, moves_of_plan

Receptors = dict[str, list[float]]
SHOWN = (Pose, Proximity, Contact, Friction, Force, ForceBand, Pins, Spikes, Pointed, Load, Surface)
POINTER = "palpate-pointer"
THICKNESS = 4e-3  # [m] default thickness of a fingertip
Shown = dict[type[Message], str]
Count = Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
Metres = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]
Sample = tuple[Count, tuple[Metres, Metres, Metres], Count]  # number, position [m, world] and buttons


@dataclass(frozen=True)
class Touched:
    """The part of a graph that a page shows.

    body, use  name and class of the node that sends the first surface
    bodies     all shown bodies, that one first
    place      placement; the first group has the nodes that run at every tick
    fingers    stream of each shown message type, for each finger
    near       streams of Proximity, one for each organ, for each finger
    supports   of each of them, the stream of the motion in whose frame it is, or ""
    thickness  [m] of the fingertip, from skin to bone edge
    begins     [m] (3) initial position of each finger's bone edge
    receptors  `x` and `y` [mm] and type of each afferent whose spikes are sent
    """

    body: str
    use: str
    bodies: Bodies
    place: Placement
    fingers: list[Shown]
    near: list[list[str]]
    supports: list[list[str]]
    thickness: float
    begins: list[Vector3]
    receptors: Receptors


def steer_launch(launch: LaunchFile, folder: Path) -> tuple[LaunchFile, list[Path]]:
    """The run with the page's hands instead of its devices, and the sockets of the pointer samples, one per finger.

    folder  a private folder for the graph and the sockets

    PageError: the graph does not have one device for each finger.
    """
    planned = launch.plan()
    graph = planned.graph
    devices = [name for name, spec in graph.nodes.items() if DeviceState in spec.streams.values()]
    found = fingers(*links_of_plan(planned))
    held_by = [streams_of(finger, (DeviceState, Torque, Force, Contact)) for finger in found]
    held = {finger.get(DeviceState, "").partition(".")[0]: finger for finger in held_by}
    if not devices or set(held) != set(devices):
        raise PageError(
            f"{launch.graph.stem}: nodes that send DeviceState: found {', '.join(devices) or 'none'}, expected one for "
            f"each of {len(found)} fingers. Try: palpate touch kidney"
        )
    nodes: dict[str, Any] = {}
    sockets = []
    for number, (name, finger) in enumerate(held.items(), 1):
        spec, pointer = graph.nodes[name], POINTER if number == 1 else f"{POINTER}-{number}"
        begin = list(spec.settings.get("begin", (0.0, 0.0, 0.116)))
        sockets.append(folder / f"pointer-{number}")
        answers = {"torque": Torque} if Torque in finger else {"force": Force} if Force in finger else {}
        wires = {port: finger[kind] for port, kind in answers.items()}
        nodes[pointer] = {"use": "device.Pointer", "socket": str(sockets[-1]), "begin": begin}
        nodes[name] = {"use": "device.Mouse", "in": {"pointer": pointer, **wires}, "begin": begin}
        for key in ("hand_stiffness", "hand_damping", "mass", "origin"):
            if key in spec.settings:
                nodes[name][key] = spec.settings[key]
    data: dict[str, Any] = {"extends": str(launch.graph.absolute()), "nodes": nodes}
    file = folder / f"{launch.graph.stem}.yaml"
    file.write_text(yaml.safe_dump(data))
    # Overrides of a device, or of the hand as of --organ, are already in its settings; no other node reads them.
    overrides = tuple(
        o for o in launch.overrides
        if _node(o) not in held and (isinstance(o, str) or o.keys[:2] != ("scene", "hand"))
    )  # fmt: skip
    return LaunchFile(graph=file, scene=launch.scene, clock="real", overrides=overrides), sockets


def _node(override: str | Override) -> str:
    """The node that an override changes, or the first part of its name."""
    return override.partition("=")[0].partition(".")[0].strip() if isinstance(override, str) else override.keys[0]


def touched_part(planned: Plan) -> Touched:
    """The part of a plan that a page shows and steers. PageError: no body with a mesh, or no pose of the finger."""
    return _part_shown(planned, (Surface, Pose, Proximity, Contact), _place(planned), kinds=(*SHOWN, Vibration))


def watched_part(planned: Plan, recorded: Sequence[Finger] = ()) -> Touched:
    """The part of a plan that a page shows without steering it, or of its recording with these streams of each finger.
    PageError: no body with a mesh, or no contact."""
    needed = () if recorded else (Surface, Contact)
    return _part_shown(planned, needed, Placement([ProcessGroup("loop", planned.order)]), recorded)


def streams_of(finger: Finger, kinds: Iterable[type[Message]] = SHOWN) -> Shown:
    """The streams of a finger for these message types, by default those that a page shows."""
    return {kind: finger[full_name(kind)] for kind in kinds if full_name(kind) in finger}


def _part_shown(
    planned: Plan,
    needed: tuple[type[Message], ...],
    place: Placement,
    recorded: Sequence[Finger] = (),
    kinds: Iterable[type[Message]] = SHOWN,
) -> Touched:
    nodes, found = planned.graph.nodes, recorded or fingers(*links_of_plan(planned))
    shown = [streams_of(finger, kinds) for finger in found]
    senders = {stream: name for name in planned.order for stream in nodes[name].streams}
    streams = shown[0]
    for kind in needed:
        if any(kind not in finger for finger in shown):
            raise PageError(f"{planned.graph.path.stem}: no node sends {kind.__name__}; a page needs a body, its "
                            "contact and the finger. Try: palpate touch kidney")  # fmt: skip
    body = senders[streams[Surface]]
    collision = planned.make(senders[streams[Proximity]]) if Proximity in streams else None
    thickness = getattr(collision, "thickness", THICKNESS)
    return Touched(
        body=body,
        use=planned.graph.nodes[body].use,
        bodies=shapes(planned),
        place=place,
        fingers=shown,
        near=[finger.near for finger in found],
        supports=[finger.supports for finger in found],
        thickness=float(thickness),
        begins=[nodes[senders[f[Pointed]]].settings["begin"] for f in shown if Pointed in f],
        receptors=_receptors(planned, senders[streams[Spikes]]) if Spikes in streams else {},
    )


def shapes(planned: Plan) -> Bodies:
    """The bodies of a plan that have a mesh. PageError: the first one has none."""

    def mesh(node: str) -> Mesh:
        try:
            return planned.make(node).mesh()  # type: ignore[attr-defined, no-any-return]
        except (AttributeError, SettingError, ValueError, OSError) as error:
            use = planned.graph.nodes[node].use
            raise PageError(f"node {node!r} ({use}) has no mesh to show: {error}") from None

    return Bodies.of(*links_of_plan(planned), mesh, moves_of_plan(planned))


def _receptors(planned: Plan, node: str) -> Receptors:
    """Positions and types of the receptors of a node of afferents; empty if the node cannot be made."""
    try:
        made = planned.make(node).make_population()  # type: ignore[attr-defined]
    except (AttributeError, SettingError):
        return {}
    return {"x": (1e3 * made.at[:, 0]).tolist(), "y": (1e3 * made.at[:, 1]).tolist(), "kind": made.kind.tolist()}


def _place(planned: Plan) -> Placement:
    """Nodes that run at every tick share one process on a dedicated core with priority over the browser; the others use
    the other cores."""
    cores = usable_cores()
    slow = [name for name in planned.order if planned.graph.nodes[name].every > 1]
    loop = ProcessGroup("loop", [name for name in planned.order if name not in slow], core=(cores[-1],), priority=80)
    return Placement([loop, *([ProcessGroup("rest", slow, core=tuple(cores[:-1] or cores))] if slow else [])])


class Pointers:
    """Sends the samples of the pages' pointers to the hands of a run; the page that sent the last one steers.

    sockets  one for each finger
    begins   [m] (3) start of each finger, to which it returns when the steering page closes
    """

    def __init__(self, sockets: Sequence[Path], begins: Sequence[Vector3]) -> None:
        self.sockets, self.begins = sockets, begins
        self._outlet = Outbox()
        self._steering: object = None

    def steer(self, page: object, finger: int, sample: Sample) -> None:
        """Forward a sample of a page. PageError: unknown finger."""
        if finger >= len(self.sockets):
            raise PageError(f"finger: found {finger}, expected less than {len(self.sockets)}")
        self._steering = page
        self._send(finger, sample)

    def leave(self, page: object) -> None:
        """A page closes: if it steered, its hands return to their start."""
        if self._steering is page:
            self._steering = None
            for finger, begin in enumerate(self.begins):
                self._send(finger, (0, begin, 0))

    def close(self) -> None:
        self._outlet.close()

    def _send(self, finger: int, sample: Sample) -> None:
        """Send a sample; it is lost while no run is active."""
        self._outlet.send(self.sockets[finger], msgspec.msgpack.encode(sample))
