"""MCAP for Foxglove: the numbers of every stream as JSON, which PlotJuggler and the `mcap` command decode too, and a
scene for its 3-D panel."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from palpate.messages import Contact, Force, Message, Pose, Surface, fields
from palpate.messages.base import HEADER
from palpate.physics.archive import replacing
from palpate.records.export import scene
from palpate.records.export.palette import FINGER, NORMAL
from palpate.records.export.shape import FULL, LENGTH, Pace, Tell, colours, displaced, shapes
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

_CHUNK = 4 << 20  # [B] several surfaces, which are much alike, are compressed together
_Told = tuple[str, dict[str, Any], dict[str, Any]]


def write_foxglove(
    recording: Recording, target: Path, streams: tuple[str, ...], every: int | None = None, tell: Tell = lambda _: None
) -> list[Path]:
    """One file. Each stream is a channel `/STREAM` of JSON objects, arrays row by row. For the 3-D panel the body of a
    stream of Surface is drawn on `/STREAM/surface`, the part of it that never moves on `/STREAM/still`, a force of
    Contact or Force as an arrow at the foot point on `/STREAM/arrow`, and the place of a Pose as a frame on
    `/STREAM/frame`. `tell` gets what has no shape, and why.

    RecordingError: the target is the recording itself, or bytes that do not fit their type.
    """
    if target.exists() and target.samefile(recording.path):
        raise RecordingError(f"{target} is the recording itself; name another file with --out")
    kinds = {name: recording.streams[name].type for name in streams}
    drawn = _Scene(recording, kinds, every, tell)
    seen = dict.fromkeys(streams, 0)
    with replacing(target) as part, open(part, "wb") as file:
        out = _Channels(Writer(file, chunk_size=_CHUNK, compression=CompressionType.ZSTD))
        for name, kind in kinds.items():
            out.open(f"/{name}", f"palpate.{kind.__name__}", json_schema(kind))
        for name, tick, time, payload in recording.raw():
            if name not in kinds:
                continue
            seen[name] += 1
            chosen, shown = not (seen[name] - 1) % (every or 1), drawn.shows(name, time)
            if not (chosen or shown):
                continue
            message = recording.decoded(name, tick, payload, kinds[name])
            if chosen:
                out.add(f"/{name}", tick, time, as_plain(message, rows=False))
            for topic, kind_of, body in drawn.messages(name, message, shown):
                out.open(topic, kind_of["title"], kind_of)
                out.add(topic, tick, time, body)
        out.writer.finish()
    return [target]


class _Channels:
    """The channels of a file of JSON."""

    def __init__(self, writer: Writer) -> None:
        writer.start(profile="", library="palpate")
        self.writer = writer
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def open(self, topic: str, name: str, schema: dict[str, Any]) -> None:
        if topic in self._channels:
            return
        if name not in self._schemas:
            self._schemas[name] = self.writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        self._channels[topic] = self.writer.register_channel(topic, "json", self._schemas[name])

    def add(self, topic: str, tick: int, time: int, body: dict[str, Any]) -> None:
        self.writer.add_message(self._channels[topic], time, msgspec.json.encode(body), time, tick)


class _Scene:
    """What the 3-D panel is told. After a jump in time it reads the last message of each channel, so each message says
    all of its channel; what never moves has a channel of its own, to be sent once."""

    def __init__(self, recording: Recording, kinds: dict[str, type[Message]], every: int | None, tell: Tell) -> None:
        self.recording, self.every = recording, every
        self.kinds = kinds
        self._shapes = shapes(recording, list(kinds), tell)
        self._touch = next((name for name, kind in kinds.items() if kind is Contact), None)
        self._foot: np.ndarray | None = None
        drawn = [name for name, kind in kinds.items() if name in self._shapes or kind in (Contact, Force, Pose)]
        self._paces = {name: Pace(every) for name in drawn}
        self._parts = {name: self._split(name) for name in self._shapes}
        self._still = set(self._shapes)

    def shows(self, name: str, time: int) -> bool:
        """Whether the next message of a stream, of this time [ns], is drawn."""
        return name in self._paces and self._paces[name].shows(time)

    def messages(self, name: str, message: Message, shown: bool) -> Iterator[_Told]:
        """Topic, schema and body of what is drawn of a message."""
        if name == self._touch and isinstance(message, Contact):
            self._foot = np.array(message.foot)
        if not shown:
            return
        if name in self._shapes and isinstance(message, Surface):
            yield from self._body(name, message)
        elif isinstance(message, Pose):
            yield f"/{name}/frame", scene.FRAMES, scene.frames(message.time, name, np.array(message.position))
        elif isinstance(message, Contact | Force) and self._foot is not None:
            if isinstance(message, Contact):
                force, colour = message.force * np.array(message.normal), NORMAL
            else:
                force, colour = np.array(message.force), FINGER
            about = {"scale": f"{LENGTH * 1e3:g} mm for 1 N"}
            body = scene.arrow(message.time, name, self._foot, LENGTH * force, colour, about)
            yield f"/{name}/arrow", scene.SCENE, body

    def _body(self, name: str, message: Surface) -> Iterator[_Told]:
        rest = self._shapes[name][0]
        moved = displaced(self.recording, name, message, rest)
        where, far = rest + moved, np.linalg.norm(moved, axis=1)
        about = {"colour": f"displacement, from 0 to {FULL * 1e3:g} mm"}
        still, moving = self._parts[name]
        for part, vertices, triangles in (("still", *still), ("surface", *moving)):
            if len(triangles) and (part == "surface" or name in self._still):
                body = scene.surface(message.time, name, where[vertices], triangles, colours(far[vertices]), about)
                yield f"/{name}/{part}", scene.SCENE, body
        self._still.discard(name)

    def _split(self, name: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Vertices (v) and triangles (t,3) among them, of the part of a body that never moves by as much as can be
        written, and of the rest."""
        rest, triangles = self._shapes[name]
        moves, pace = np.zeros(len(rest), dtype=bool), Pace(self.every)
        for other, tick, time, payload in self.recording.raw():
            if other == name and pace.shows(time):
                message = self.recording.decoded(name, tick, payload, self.kinds[name])
                assert isinstance(message, Surface)
                moved = displaced(self.recording, name, message, rest)
                moves |= (np.abs(moved) > 0.5 * 10.0**-scene.DIGITS).any(axis=1)
        in_motion = moves[triangles].any(axis=1)
        return [_part(triangles[chosen]) for chosen in (~in_motion, in_motion)]


def _part(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    vertices, places = np.unique(triangles, return_inverse=True)
    return vertices, places.reshape(-1, 3)


def as_plain(message: Message, rows: bool = True) -> dict[str, Any]:
    """A message as numbers, texts and lists; arrays with rows as lists of lists, or row by row."""
    plain: dict[str, Any] = {"tick": message.tick, "time": message.time, "source": message.source, "used": message.used}
    for field in fields(type(message)):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            value = (value if rows else value.ravel()).tolist()
        plain[field.name] = value
    return plain


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """JSON schema of `as_plain` without rows, as Foxglove refuses lists of lists; the unit stands in each field's
    title, as `force [N]`, and the shape of arrays with rows in their description."""
    plain: dict[Any, str] = {int: "integer", bool: "boolean", str: "string", float: "number"}
    properties: dict[str, Any] = {
        "tick": {"type": "integer"},
        "time": {"type": "integer", "title": "time [ns]"},
        "source": {"type": "string"},
        "used": {"type": "array", "items": {"type": "integer"}},
    }
    assert tuple(properties) == HEADER
    for field in fields(kind):
        if field.dtype is None and not field.shape:
            schema: dict[str, Any] = {"type": plain.get(field.type, "string")}
        else:
            whole = field.dtype is not None and field.dtype.kind in "iu"
            schema = {"type": "array", "items": {"type": "integer" if whole else "number"}}
            if len(field.shape) > 1:
                schema["description"] = f"({', '.join(map(str, field.shape))}) row by row"
        properties[field.name] = {**schema, "title": field.label}
    about = (kind.__doc__ or "").partition("\n")[0]
    return {"title": kind.__name__, "description": about, "type": "object", "properties": properties}
