"""Pictures of a recording from the side, at the times of frames, as a feature of a data set."""

import io
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from palpate.engine.plan import Plan
from palpate.messages import Surface
from palpate.physics.errors import ArgumentError
from palpate.physics.extras import require_extra
from palpate.records.lerobot.features import Feature
from palpate.records.lerobot.frames import HALF
from palpate.records.reader import Recording
from palpate.records.side_view import SIZE, side_view

KEY = "observation.images.side"
FEATURE = Feature((*SIZE, 3), ("height", "width", "channels"), ("pixel", "pixel", "1"), "image")
EVERY = 4  # pixels, down and across, from which one goes into the statistics


class Pictures(NamedTuple):
    """Pictures of episodes of equal length, as LeRobot stores them, and what its statistics are computed from.

    encoded  PNG files, one for each frame of all episodes
    thinned  [1] (episodes, frames, ..., 3) every 4th pixel down and across, from 0 to 1
    """

    encoded: list[bytes]
    thinned: np.ndarray


def draw_pictures(
    recording: Recording, plan: Plan, times: np.ndarray, fingers: Sequence[np.ndarray], touches: Sequence[np.ndarray]
) -> Pictures:
    """The pictures of one episode.

    times    of the frames [s] (n)
    fingers  positions [m] (n,3) of each fingertip's bone edge
    touches  place [m], displacement [m] and force [N] (n,9) of each contact; its force acts on the nearest finger

    ArgumentError: pillow is missing.
    """
    with require_extra("a data set of LeRobot with pictures", "export", ArgumentError):
        from PIL import Image
    encoded, thinned = [], []
    begins = [positions[0].tolist() for positions in fingers]
    for number, shapes in enumerate(_shapes(recording, plan, times)):
        places = [positions[number] for positions in fingers]
        forces = [np.zeros(3) for _ in places]
        for touch in touches:
            away = [float(np.sum((place - touch[number, :3]) ** 2)) for place in places]
            forces[int(np.argmin(away))] += touch[number, 6:]
        drawn = [(p.tolist(), f.tolist()) for p, f in zip(places, forces, strict=True)]
        picture = side_view(shapes, drawn, begins)
        file = io.BytesIO()
        Image.fromarray(picture).save(file, "PNG")
        encoded.append(file.getvalue())
        thinned.append(picture[::EVERY, ::EVERY])
    return Pictures(encoded, np.array(thinned, np.float32)[None] / np.float32(255.0))


def _shapes(recording: Recording, plan: Plan, times: np.ndarray) -> Iterator[list[np.ndarray]]:
    """The vertices [m] (V,3) of each deformed surface at these times; a surface is at rest before its first message."""
    meshes, moved = [], []
    for name in plan.order:
        spec: Any = plan.graph.nodes[name]
        for stream, kind in spec.streams.items():
            if kind is Surface and stream in recording.streams and hasattr(spec.cls, "mesh"):
                meshes.append(np.array(spec.cls(**spec.settings).mesh().vertices))
                moved.append(_newest(recording, stream, times))
    for surfaces in zip(*moved, strict=True) if moved else ([] for _ in times):
        shapes = [vertices.copy() for vertices in meshes]
        for shape, found in zip(shapes, surfaces, strict=True):
            if found is not None:
                shape[found.nodes] += found.displacement
        yield shapes


def _newest(recording: Recording, stream: str, times: np.ndarray) -> Iterator[Surface | None]:
    """The newest message of a stream at each time [s], rising; None: before the first."""
    rows = recording.raw({stream})
    newest, coming = None, next(rows, None)
    for time in times:
        while coming is not None and coming[2] <= 1e9 * (time + HALF):
            newest, coming = coming, next(rows, None)
        yield None if newest is None else recording.decode(stream, newest[1], newest[3], Surface)
