"""What exported scenes are made of: bodies at rest and displaced, the instants that are shown, colours, arrows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.messages import Surface
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import complete
from palpate.records.export.palette import DEFORMATION
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

Tell = Callable[[str], object]
RATE = 30.0  # [Hz] of what a scene shows at most, unless it is said otherwise: each surface carries all of its vertices
LENGTH = 0.012  # [m/N] of an arrow
FULL = 0.01  # [m] displacement of the last colour
_SCALE = np.array([list(bytes.fromhex(colour[1:])) for colour in DEFORMATION], dtype=float)


class Pace:
    """Which messages of one stream a scene shows: each n-th, or for None no more than `RATE` in a second."""

    def __init__(self, every: int | None) -> None:
        self.every, self._count, self._last = every, -1, -1.0

    def shows(self, time: int) -> bool:
        """Whether the next message, of this time [ns], is shown."""
        self._count += 1
        if self.every is not None:
            return not self._count % self.every
        if time * 1e-9 - self._last < 1.0 / RATE - 1e-9:
            return False
        self._last = time * 1e-9
        return True


def shapes(recording: Recording, streams: Sequence[str], tell: Tell) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Vertices [m] and triangles of the bodies that send these streams, as far as they have a mesh; `tell` gets a line
    for each stream of surfaces without."""
    found = {}
    for name in streams:
        if issubclass(recording.streams[name].type, Surface):
            try:
                found[name] = rest_shape(recording, name)
            except RecordingError as error:
                tell(f"no shape of {name!r}, only its numbers: {str(error).removeprefix(f'{recording.path}: ')}")
    return found


def rest_shape(recording: Recording, stream: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] and triangles of the body that sends a stream. RecordingError: it has none, or none can be made."""
    producer = recording.streams[stream].producer
    try:
        node: Any = plan_of(recording).make(producer)
        if not hasattr(node, "mesh"):
            raise RecordingError(f"{recording.path}: node {producer!r} ({type(node).__name__}) has no mesh to draw")
        mesh = node.mesh()
    except (SettingError, OSError) as error:
        raise RecordingError(f"{recording.path}: the mesh of node {producer!r} cannot be made here: {error}") from None
    return np.array(mesh.vertices, dtype=float), np.array(mesh.triangles)


def displaced(recording: Recording, stream: str, message: Surface, rest: np.ndarray) -> np.ndarray:
    """Displacement [m] (V,3) of all vertices. RecordingError: the mesh at rest has fewer than were recorded."""
    message, moved = complete(message, rest), np.zeros_like(rest)
    if len(message.nodes) and int(message.nodes.max()) >= len(moved):
        raise RecordingError(
            f"{recording.path}: stream {stream!r} moves vertex {int(message.nodes.max())}, but the mesh of its "
            f"node has {len(moved)}: it is not the one that was recorded. `--to parquet` needs no mesh."
        )
    moved[message.nodes] = message.displacement
    return moved


def colours(far: np.ndarray) -> np.ndarray:
    """Red, green, blue from 0 to 255 (k,3) of displacements [m] (k): those of the pictures, the last at `FULL`."""
    at = np.clip(far / FULL, 0.0, 1.0) * (len(_SCALE) - 1)
    return np.stack([np.interp(at, np.arange(len(_SCALE)), part) for part in _SCALE.T], axis=1).astype(np.uint8)
