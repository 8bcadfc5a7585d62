"""A series of surfaces for ParaView: PolyData with displacement per recorded instant, with .pvd and .vtp.series."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from palpate.launch.loading.extras import install
from palpate.launch.recording.export.shape import displaced, rest_shape
from palpate.launch.recording.reader import Recording, RecordingError
from palpate.messages import Surface

MOST = 2000
"""Files at most, unless it is said otherwise: a run of minutes would fill a disk."""


def write_vtk(recording: Recording, folder: Path, streams: tuple[str, ...], every: int = 1) -> list[Path]:
    """Per stream of `Surface`: a PolyData file (.vtp) per instant with point data `displacement` [m], and a .pvd that
    gives ParaView the times. The rest shape is the mesh of the node that sends the stream.

    RecordingError: no stream of `Surface`, its node has no mesh, or pyvista is missing.
    """
    try:
        import pyvista as pv
    except ImportError:
        raise RecordingError(f"VTK needs the package pyvista: {install('view')}") from None
    chosen = [name for name in streams if issubclass(recording.streams[name].type, Surface)]
    if not chosen:
        raise RecordingError(f"{recording.path}: none of its streams ({', '.join(streams)}) holds a deformed surface")
    folder.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name in chosen:
        rest = rest_shape(recording, name)
        faces = np.hstack([np.full((len(rest[1]), 1), 3), rest[1]]).ravel()
        step = max(every, -(-sum(1 for _ in recording.messages(name)) // MOST)) if every == 1 else every
        times: list[tuple[float, str]] = []
        for index, message in enumerate(recording.messages(name)):
            if index % step or not isinstance(message, Surface):
                continue
            moved = displaced(recording, name, message, rest[0])
            surface = pv.PolyData(rest[0] + moved, faces)
            surface.point_data["displacement"] = moved
            surface.point_data["displacement magnitude"] = np.linalg.norm(moved, axis=1)
            surface.field_data["tick"] = np.array([message.tick])
            surface.field_data["TimeValue"] = np.array([message.time * 1e-9])
            path = folder / f"{name}-{len(times):06d}.vtp"
            surface.save(path)
            paths.append(path)
            times.append((message.time * 1e-9, path.name))
        paths += _series(folder, name, times)
    return paths


def _series(folder: Path, name: str, times: list[tuple[float, str]]) -> list[Path]:
    """The two files by which ParaView knows the times."""
    lines = [f'    <DataSet timestep="{time!r}" part="0" file="{file}"/>' for time, file in times]
    head = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n  <Collection>\n'
    )
    pvd = folder / f"{name}.pvd"
    pvd.write_text(head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n")
    series = folder / f"{name}.vtp.series"
    files = [{"name": file, "time": time} for time, file in times]
    series.write_text(json.dumps({"file-series-version": "1.0", "files": files}, indent=1))
    return [pvd, series]
