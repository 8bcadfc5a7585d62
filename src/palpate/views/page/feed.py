"""Makes the frames of a run for the page: the newest surface, and all messages of small streams since the last frame.

ZeroMQ conflates surfaces: only the newest is read for each frame. Small streams are read in bursts. All contacts are
decoded, for the curves, and of other streams the last message before a frame. The run drops messages that the page does
not read in time, so the page cannot slow the run.
"""

import contextlib
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
import zmq

from palpate.launch.run.wire.bus import HEALTH, split
from palpate.launch.run.wire.discover import Running, subscriber
from palpate.messages import (
    Contact,
    Force,
    ForceBand,
    Friction,
    Health,
    Load,
    Message,
    MessageError,
    Pins,
    Pointed,
    Pose,
    Proximity,
    Spikes,
    Surface,
    Vector3,
    unpack,
)
from palpate.messages.tissue import Support
from palpate.messages.vibration import Vibration
from palpate.physics.geometry.mesh import Mesh
from palpate.views.carried import STILL, Carried
from palpate.views.page.steered import Touched

NO_VERTICES = np.zeros((0, 3))
EVERY = (Contact, Vibration, Health)  # of these all messages are decoded; of the others the last one before a frame
KEPT = 20_000  # limit of buffered messages of a finger: 2 s of nine streams at 1 kHz
DRAINED = 400_000
"""Limit of messages read for a frame: more than a run buffers for a slow reader (100 000), so that a page which was
delayed shows the present with its next frame instead of remaining behind."""
Last = dict[type[Message], Message]
Curve = dict[str, list[float]]
"""Times [s], forces [N] and indentations [m] of a contact, `t`, `f`, `s`, and samples of its `vibration` [N]."""

VERSION = 1  # version of the records for external renderers (docs/renderers.md)
RATE = 60.0  # [1/s] frame rate while a renderer listens
MESH = struct.Struct("<4sHHIIfI")
"""Magic, version, fingers, vertices, triangles, thickness of the fingertip [m], 0."""
FRAME = struct.Struct("<4sHHIId")  # Magic, version, fingers, moved vertices, late ticks, time [s]
FINGER = struct.Struct("<12f3fI")
"""Tip, foot [m], normal [1], force on the hand [N] (3 each), normal force [N], indentation, compression [m], state."""
TOUCHES, TIP, FORCE, FRICTION, STICKS = (1 << bit for bit in range(5))
"""Bits of the state: in contact; tip, force and friction are known; the contact sticks."""
ZERO = (0.0, 0.0, 0.0)


class FrameSource:
    """Provides the frames of a page.

    files         HTML and script of the page
    command       the command that prints its address
    status, keep  status text, and whether the recording of the current run is kept. Status None: frames only on request
    figures       error and time of each body (`measuring`); None: not measured
    panel         texts and questions of an experiment, shown over the picture. None: no panel
    mesh, frame   the newest ones, packed for the page (see `feed`)
    rate          [1/s] highest rate of frames
    on_news       called, from any thread, when one of these changes
    """

    files = ("index.html", "page.js")
    command = "palpate run --view"
    status: str | None = None
    keep = False
    figures: dict[str, Any] | None = None
    panel: dict[str, Any] | None = None
    mesh = frame = b""
    rate = 30.0

    def __init__(self) -> None:
        self.on_news: Callable[[], object] = lambda: None

    def open(self) -> None:
        """Called when the server is open."""

    def close(self) -> None:
        """Called when the server has closed."""

    def begin(self) -> list[bytes]:
        """Messages to a page when it opens."""
        return []

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        """Execute a request of a page; returns the answers. PalpateError, MsgspecError: the request is invalid."""
        return []

    def leave(self, page: object) -> None:
        """Called when a page is closed."""


class StreamReader:
    """Reads the streams of a run; `frame` makes the next frame."""

    def __init__(self, run: Running, touched: Touched) -> None:
        self.touched = touched
        self.kinds = {HEALTH: Health} | kinds_of(touched)
        self.newest: dict[str, Message] = {}
        self.late: dict[str, int] = {}
        self.cost: dict[str, float] = {}  # [s] of a tick, for each node
        self.context = zmq.Context()
        large = [stream for stream, kind in self.kinds.items() if kind in (Surface, Load, Spikes)]
        small = [stream for stream in self.kinds if stream not in large]
        limit = KEPT * len(touched.fingers)
        self.large = [subscriber(self.context, run, [stream], limit, newest=True) for stream in large]
        self.small = subscriber(self.context, run, small, limit)

    def close(self) -> None:
        self.context.destroy(linger=0)

    def frame(self) -> bytes | None:
        """The next frame; None without new messages."""
        touched = self.touched
        curves: list[Curve] = [{"t": [], "f": [], "s": []} for _ in touched.fingers]
        last: dict[str, bytes] = {}
        news = False
        for socket in (self.small, *self.large):
            for _ in range(DRAINED):
                try:
                    stream, payload = split(socket.recv(zmq.NOBLOCK))
                    if self.kinds[stream] in EVERY:
                        self._take(stream, payload, curves)
                        news = True
                    else:
                        last[stream] = payload
                except zmq.Again:
                    break
                except (MessageError, KeyError, ValueError):
                    continue
        for stream, payload in last.items():
            with contextlib.suppress(MessageError, ValueError):
                self._take(stream, payload, curves)
                news = True
        head = {"kind": "frame", "late": max(self.late.values(), default=0), "cost": sum(self.cost.values())}
        if not news:
            return None
        return picture(head, self.newest, touched, curves)

    def _take(self, stream: str, payload: bytes, curves: Sequence[Curve]) -> None:
        """Decode a message. MessageError, ValueError: it is damaged."""
        message, touched = unpack(payload, self.kinds[stream]), self.touched
        if isinstance(message, Health):
            if message.source in touched.place.groups[0].nodes:
                self.late[message.source] = message.late + message.lost
                self.cost[message.source] = message.median
            return
        self.newest[stream] = message
        if isinstance(message, Contact | Vibration):
            for finger, curve in zip(touched.fingers, curves, strict=True):
                if isinstance(message, Vibration):
                    if finger.get(Vibration) == stream:
                        curve.setdefault("vibration", []).extend(message.lateral.round(6).tolist())
                elif finger[Contact] == stream:
                    curve["t"].append(message.time * 1e-9)
                    curve["f"].append(message.force)
                    curve["s"].append(message.indentation)


def picture(
    head: dict[str, Any], newest: Mapping[str, Message], touched: Touched, curves: Sequence[Curve] = ()
) -> bytes | None:
    """The frame of the newest messages by stream; None if a finger has no contact message yet. The proximity of a
    finger is that with the smallest gap. The head has the last messages of the first finger, with its curve; those of
    the other fingers are in `others`."""
    every: list[Last] = []
    for finger, organs, motions in zip(touched.fingers, touched.near, touched.supports, strict=True):
        last: Last = {kind: newest[stream] for kind, stream in finger.items() if stream in newest}
        pairs = zip(organs, motions, strict=True)
        close = [(one, motion) for stream, motion in pairs if isinstance(one := newest.get(stream), Proximity)]
        if close:
            last[Proximity], motion = min(close, key=lambda pair: pair[0].gap)
            last |= {Support: newest[motion]} if motion in newest else {}
        every.append(last)
    if any(Contact not in last for last in every):
        return None
    shapes = {stream: one for stream, one in newest.items() if isinstance(one, Surface)}
    bodies = touched.bodies
    loads = {stream: one for stream, one in newest.items() if stream in bodies.loads and isinstance(one, Load)}
    first, *others = (
        now(last, touched.thickness) | curve for last, curve in zip(every, curves or [{}] * len(every), strict=True)
    )
    moved = bodies.carried(newest)
    ways = [(start, end, by.way, *([by.turn] if by.turn else [])) for start, end, by in moved]
    head = head | first | {"others": others} | bodies.pressed_area(loads) | ({"carried": ways} if ways else {})
    return frame(head, bodies.surface(shapes))


def kinds_of(touched: Touched) -> dict[str, type[Message]]:
    """The message type of each stream that the page shows."""
    kinds = {stream: kind for finger in touched.fingers for kind, stream in finger.items()}
    kinds |= {stream: Proximity for organs in touched.near for stream in organs}
    kinds |= {stream: Support for stream in touched.bodies.supports if stream}
    return kinds | dict.fromkeys(touched.bodies.streams, Surface) | dict.fromkeys(touched.bodies.loads, Load)


def frame(head: dict[str, Any], surface: Surface | None) -> bytes:
    """A packed frame: head, nodes, displacements and pressures of the surface. The head has for each node whether it
    slides, if the body sends that."""
    if surface is None:
        return pack_message(head, np.zeros(0, "<u4"), np.zeros(0, "<f4"), np.zeros(0, "<f4"))
    if len(surface.slipped) and len(surface.slipped) == len(surface.nodes):
        head = head | {"slipped": surface.slipped.tolist()}
    pressure = surface.pressure if len(surface.pressure) == len(surface.nodes) else ()
    return pack_message(head, np.asarray(surface.nodes, "<u4"), np.asarray(surface.displacement, "<f4").ravel(),
                  np.asarray(pressure, "<f4"))  # fmt: skip


def _in_world(organ: Carried, vector: Vector3) -> Vector3 | list[float]:
    """A vector of the frame of an organ."""
    turned: list[float] = organ.vectors(np.array(vector)).tolist()
    return turned if organ.turn else vector


def now(last: Last, thickness: float) -> dict[str, Any]:
    """The last message of each type as plain data for the page; thickness [m] of the fingertip."""
    contact, near, pose = last[Contact], last.get(Proximity), last.get(Pose)
    assert isinstance(contact, Contact)
    support = last.get(Support)
    organ = Carried.by(support) if isinstance(support, Support) else STILL
    head: dict[str, Any] = {"time": contact.time * 1e-9, "normal": _in_world(organ, contact.normal)}
    head["foot"] = organ.points(np.array(contact.foot)).tolist() if organ != STILL else contact.foot
    head |= {"load": contact.force, "depth": contact.indentation, "squeeze": contact.compression}
    if isinstance(near, Proximity) and isinstance(pose, Pose):
        distance = thickness - contact.compression
        head["up"] = _in_world(organ, near.normal)
        head["tip"] = [p - distance * n for p, n in zip(pose.position, head["up"], strict=True)]
    if isinstance(friction := last.get(Friction), Friction):
        head |= {"stick": friction.stick, "drag": sum(f * f for f in friction.force) ** 0.5}
    if isinstance(force := last.get(Force), Force):
        head |= {"force": _in_world(organ, force.force), "state": force.state, "energy": force.energy}
    if isinstance(band := last.get(ForceBand), ForceBand):
        head |= {"band": [band.quantiles[0], band.quantiles[-1]] if band.quantiles else None, "mean": band.mean}
    if isinstance(vibration := last.get(Vibration), Vibration):
        head |= {"sampling": vibration.sampling}
    if isinstance(pointed := last.get(Pointed), Pointed):
        head |= {"sample": pointed.sample}
    if isinstance(pins := last.get(Pins), Pins):
        head |= {"pins": pins.heights.tolist()}
    if isinstance(spikes := last.get(Spikes), Spikes):
        head |= {"rates": spikes.rate.tolist(), "mean_rates": spikes.mean}
    return head


def mesh_frame(touched: Touched, about: dict[str, Any]) -> bytes:
    """The undeformed surface and the constants of a run."""
    return surface_frame(
        touched.bodies.mesh,
        {
            "body": touched.use,
            "thickness": touched.thickness,
            "begins": touched.begins,
            "receptors": touched.receptors,
            "fingers": [finger[Contact] for finger in touched.fingers],
            "sounds": any(Vibration in finger for finger in touched.fingers),
            **about,
        },
    )


def surface_frame(mesh: Mesh, about: dict[str, Any]) -> bytes:
    return pack_message({"kind": "mesh", **about}, np.asarray(mesh.triangles, "<u4").ravel(),
                  np.asarray(mesh.vertices, "<f4").ravel(), np.asarray(mesh.normals, "<f4").ravel())  # fmt: skip


def pack_message(head: dict[str, Any], indices: np.ndarray, first: np.ndarray, second: np.ndarray) -> bytes:
    """One binary message to the page: length of the head, the head in JSON padded to four bytes, then the arrays. NaN
    becomes null."""
    head = head | {"sizes": [len(indices), len(first), len(second)]}
    text = msgspec.json.encode(head)
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + indices.tobytes() + first.tobytes() + second.tobytes()


def binary(data: bytes, vertices: np.ndarray = NO_VERTICES) -> bytes:
    """The record for external renderers, without JSON, of a mesh or frame of the page (`pack_message`).

    vertices  [m] (V,3) of the mesh, for frames in which a body rotates
    """
    head, indices, values = _parts(data)
    if head["kind"] == "mesh":
        counts = len(head.get("fingers", (0,))), len(values) // 12, len(indices) // 12
        return MESH.pack(b"PLPM", VERSION, *counts, head.get("thickness", 0.0), 0) + values + indices
    indices, values = _with_motion(head, indices, values, vertices)
    fingers = [head, *head["others"]]
    begin = FRAME.pack(b"PLPF", VERSION, len(fingers), len(indices) // 4, head["late"], head["time"])
    return b"".join((begin, *map(_finger, fingers), indices, values))


def vertices_of(mesh: bytes) -> np.ndarray:
    """The vertices [m] (V,3) of a mesh of the page."""
    return np.frombuffer(_parts(mesh)[2], "<f4").reshape(-1, 3).astype(float)


def _parts(data: bytes) -> tuple[dict[str, Any], bytes, bytes]:
    """Head and the first two arrays of a message to the page."""
    (length,) = struct.unpack_from("<I", data)
    head = msgspec.json.decode(data[4 : 4 + length])
    first, second, _ = (4 * size for size in head["sizes"])
    return head, data[4 + length : 4 + length + first], data[4 + length + first : 4 + length + first + second]


def _with_motion(head: dict[str, Any], indices: bytes, values: bytes, vertices: np.ndarray) -> tuple[bytes, bytes]:
    """Vertices and displacements in the world, with all vertices of the bodies that moved."""
    if not head.get("carried"):
        return indices, values
    nodes, moved = np.frombuffer(indices, "<u4"), np.frombuffer(values, "<f4").reshape(-1, 3)
    every = np.unique(np.concatenate([nodes, *(np.arange(first, end) for first, end, *_ in head["carried"])]))
    field = np.zeros((len(every), 3))
    field[np.searchsorted(every, nodes)] = moved
    for first, end, way, *turn in head["carried"]:
        here = (every >= first) & (every < end)
        if turn:
            rest = vertices[every[here]]
            field[here] = Carried(way, tuple(turn[0])).points(rest + field[here]) - rest
        else:
            field[here] += way
    return every.astype("<u4").tobytes(), field.astype("<f4").tobytes()


def _finger(head: dict[str, Any]) -> bytes:
    state = TOUCHES * (head["load"] > 0.0) + TIP * ("tip" in head) + FORCE * ("force" in head)
    state += FRICTION * ("stick" in head) + STICKS * bool(head.get("stick"))
    places = head.get("tip", head["foot"]), head["foot"], head["normal"], head.get("force", ZERO)
    numbers = head["load"], head["depth"], head["squeeze"]
    return FINGER.pack(*(number for place in places for number in place), *numbers, state)
