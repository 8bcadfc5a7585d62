"""A series of surfaces for ParaView: PolyData with displacement per recorded instant; a .pvd has the times."""

from pathlib import Path

import numpy as np

from palpate.messages import Surface
from palpate.physics.extras import missing
from palpate.records.export.shape import Pace, displaced, rest_shape
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def write_vtk(recording: Recording, folder: Path, streams: tuple[str, ...], every: int | None = None) -> list[Path]:
    """Per stream of `Surface`: PolyData files (.vtp, compressed) with point data `displacement` [m], and a .pvd that
    gives ParaView the times: 30 surfaces a second, or each n-th message. While nothing moves, instants share one file.
    The rest shape is the mesh of the node that sends the stream.

    RecordingError: no stream of `Surface`, its node has no mesh, or pyvista is missing.
    """
    try:
        import pyvista as pv
    except ImportError as error:
        raise RecordingError(missing("VTK", error.name, "view")) from None
    chosen = [name for name in streams if issubclass(recording.streams[name].type, Surface)]
    if not chosen:
        raise RecordingError(f"{recording.path}: none of its streams ({', '.join(streams)}) holds a deformed surface")
    folder.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    for name in chosen:
        rest = rest_shape(recording, name)
        rest_points = rest[0].astype(np.float32)
        faces = np.hstack([np.full((len(rest[1]), 1), 3), rest[1]]).ravel()
        pace, before = Pace(every), None
        times: list[tuple[float, str]] = []
        for message in recording.messages(name):
            if not isinstance(message, Surface) or not pace.shows(message.time):
                continue
            moved = displaced(recording, name, message, rest[0])
            if before is None or not np.array_equal(moved, before):
                before = moved
                surface = pv.PolyData(rest_points + moved.astype(np.float32), faces)
                surface.point_data["displacement"] = moved
                path = folder / f"{name}-{len(times):06d}.vtp"
                surface.save(path)
                paths.append(path)
            times.append((message.time / 1e9, paths[-1].name))
        paths.append(_series(folder, name, times))
    return paths


def _series(folder: Path, name: str, times: list[tuple[float, str]]) -> Path:
    """The file by which ParaView knows the times."""
    lines = [f'    <DataSet timestep="{time!r}" part="0" file="{file}"/>' for time, file in times]
    kind = 'type="Collection" version="0.1" byte_order="LittleEndian"'
    head = f'<?xml version="1.0"?>\n<VTKFile {kind}>\n  <Collection>\n'
    path = folder / f"{name}.pvd"
    path.write_text(head + "\n".join(lines) + "\n  </Collection>\n</VTKFile>\n")
    return path
