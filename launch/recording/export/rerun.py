"""A recording for the Rerun viewer: deforming surfaces, force arrows and all numbers over the graph's clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from palpate.launch.loading.extras import install
from palpate.launch.pictures.style import DEFORMATION
from palpate.launch.recording.export.vtk import displaced, rest_shape
from palpate.launch.recording.reader import Recording, RecordingError
from palpate.messages import Contact, Force, Surface, fields

RATE = 30.0
"""[Hz] of surfaces at most, unless it is said otherwise: each carries all of its vertices."""
LENGTH = 0.012
"""[m/N] of an arrow."""
SCALE = np.array([list(bytes.fromhex(colour[1:])) for colour in DEFORMATION], dtype=float)
"""[1] (c,3) Colours from rest to the largest displacement, those of the pictures."""


def write_rerun(recording: Recording, path: Path, streams: tuple[str, ...], every: int = 1) -> list[Path]:
    """One .rrd file. A stream of Surface becomes a mesh `STREAM/surface`, every number of every stream a curve
    `STREAM/FIELD` with its unit, vectors one curve for each part, and a force of Contact or Force an arrow at the foot
    point. The timeline `time` [s] is the graph's clock, `tick` counts.

    RecordingError: nothing that fits, or rerun-sdk is missing.
    """
    try:
        import rerun
    except ImportError:
        raise RecordingError(f"Rerun needs the package rerun-sdk: {install('rerun')}") from None
    out = rerun.RecordingStream("palpate", recording_id=recording.path.stem)
    path.parent.mkdir(parents=True, exist_ok=True)
    out.save(str(path))
    foot = next((n for n in streams if recording.streams[n].type is Contact), None)
    for name in streams:
        if issubclass(recording.streams[name].type, Surface):
            _surface(rerun, out, recording, name, every)
        else:
            _numbers(rerun, out, recording, name, every)
        if foot is not None and recording.streams[name].type in (Contact, Force):
            _arrows(rerun, out, recording, name, foot, every)
    out.flush()
    out.disconnect()
    return [path]


def _clock(rerun: Any, ticks: np.ndarray, times: np.ndarray) -> list[Any]:
    return [rerun.TimeColumn("time", duration=times), rerun.TimeColumn("tick", sequence=ticks)]


def _numbers(rerun: Any, out: Any, recording: Recording, name: str, every: int) -> None:
    columns = {key: column[::every] for key, column in recording.columns(name).items()}
    clock = _clock(rerun, columns["tick"], columns["time"])
    for field in fields(recording.streams[name].type):
        values = columns.get(field.name)
        if values is None or not len(values) or values.dtype.kind not in "biuf":
            continue
        rows = values.reshape(len(values), -1).astype(float)
        for part in range(rows.shape[1]):
            entity = f"{name}/{field.name}" + (f"/{part}" if rows.shape[1] > 1 else "")
            out.log(entity, rerun.SeriesLines(names=field.label), static=True)
            out.send_columns(entity, clock, rerun.Scalars.columns(scalars=rows[:, part]))


def _surface(rerun: Any, out: Any, recording: Recording, name: str, every: int) -> None:
    vertices, triangles = rest_shape(recording, name)
    last = -1.0
    for index, message in enumerate(recording.messages(name)):
        time = message.time * 1e-9
        if not isinstance(message, Surface) or index % every or (every == 1 and time - last < 1.0 / RATE - 1e-9):
            continue
        last = time
        moved = displaced(recording, name, message, vertices)
        far = np.linalg.norm(moved, axis=1)
        out.set_time("time", duration=time)
        out.set_time("tick", sequence=message.tick)
        out.log(f"{name}/surface", rerun.Mesh3D(
            vertex_positions=vertices + moved, triangle_indices=triangles, vertex_colors=_colours(far),
        ))  # fmt: skip


def _colours(far: np.ndarray) -> np.ndarray:
    """Of displacements [m] (k): full at 10 mm."""
    at = np.clip(far / 0.01, 0.0, 1.0) * (len(SCALE) - 1)
    return np.stack([np.interp(at, np.arange(len(SCALE)), part) for part in SCALE.T], axis=1).astype(np.uint8)


def _arrows(rerun: Any, out: Any, recording: Recording, name: str, foot: str, every: int) -> None:
    """At the foot point of the last contact before."""
    touch, own = recording.columns(foot), recording.columns(name)
    force = own["force"] if own["force"].ndim == 2 else own["force"][:, None] * own["normal"]
    at = np.clip(np.searchsorted(touch["time"], own["time"], side="right") - 1, 0, None)
    clock = _clock(rerun, own["tick"][::every], own["time"][::every])
    columns = rerun.Arrows3D.columns(
        origins=touch["foot"][at][::every].astype(np.float32), vectors=(LENGTH * force)[::every].astype(np.float32)
    )
    out.send_columns(f"{name}/arrow", clock, columns)
