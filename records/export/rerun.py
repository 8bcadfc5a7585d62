"""A recording for the Rerun viewer: deforming surfaces, force arrows and all numbers over the graph's clock."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.messages import Contact, Force, Surface, fields
from palpate.physics.archive import replacing
from palpate.physics.extras import missing
from palpate.records.export.shape import LENGTH, Pace, Tell, colours, displaced, shapes
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

Shape = tuple[np.ndarray, np.ndarray]  # vertices and triangles of a body at rest


def write_rerun(
    recording: Recording, path: Path, streams: tuple[str, ...], every: int | None = None, tell: Tell = lambda _: None
) -> list[Path]:
    """One .rrd file. The body of a stream of Surface becomes a mesh `STREAM/surface`, every number of every stream a
    curve `STREAM/FIELD` with its unit, vectors one curve for each part, and a force of Contact or Force an arrow at the
    foot point. The timeline `time` [s] is the graph's clock, `tick` counts. `tell` gets what has no shape, and why.

    RecordingError: nothing that fits, or rerun-sdk is missing.
    """
    try:
        import rerun
    except ImportError as error:
        raise RecordingError(missing("Rerun", error.name, "rerun")) from None
    out = rerun.RecordingStream("palpate", recording_id=recording.path.stem)
    with replacing(path) as part:
        out.save(str(part))
        for name, shape in shapes(recording, streams, tell).items():
            _surface(rerun, out, recording, name, every, shape)
        foot = next((n for n in streams if recording.streams[n].type is Contact), None)
        for name in streams:
            _numbers(rerun, out, recording, name, every)
            if foot is not None and recording.streams[name].type in (Contact, Force):
                _arrows(rerun, out, recording, name, foot, every)
        out.flush()
        out.disconnect()
    return [path]


def _clock(rerun: Any, ticks: np.ndarray, times: np.ndarray) -> list[Any]:
    return [rerun.TimeColumn("time", duration=times), rerun.TimeColumn("tick", sequence=ticks)]


def _numbers(rerun: Any, out: Any, recording: Recording, name: str, every: int | None) -> None:
    columns = {key: column[:: every or 1] for key, column in recording.columns(name).items()}
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


def _surface(rerun: Any, out: Any, recording: Recording, name: str, every: int | None, shape: Shape) -> None:
    vertices, triangles = shape
    pace = Pace(every)
    for message in recording.messages(name):
        if not isinstance(message, Surface) or not pace.shows(message.time):
            continue
        moved = displaced(recording, name, message, vertices)
        far = np.linalg.norm(moved, axis=1)
        out.set_time("time", duration=message.time * 1e-9)
        out.set_time("tick", sequence=message.tick)
        out.log(f"{name}/surface", rerun.Mesh3D(
            vertex_positions=vertices + moved, triangle_indices=triangles, vertex_colors=colours(far),
        ))  # fmt: skip


def _arrows(rerun: Any, out: Any, recording: Recording, name: str, foot: str, every: int | None) -> None:
    """At the foot point of the last contact before."""
    touch, own = recording.columns(foot), recording.columns(name)
    if not len(touch["time"]) or not len(own["time"]):
        return
    force = own["force"] if own["force"].ndim == 2 else own["force"][:, None] * own["normal"]
    at = np.clip(np.searchsorted(touch["time"], own["time"], side="right") - 1, 0, None)
    clock = _clock(rerun, own["tick"][:: every or 1], own["time"][:: every or 1])
    columns = rerun.Arrows3D.columns(
        origins=touch["foot"][at][:: every or 1].astype(np.float32),
        vectors=(LENGTH * force)[:: every or 1].astype(np.float32),
    )
    out.send_columns(f"{name}/arrow", clock, columns)
