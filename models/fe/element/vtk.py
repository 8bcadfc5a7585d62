"""Results as VTK files for ParaView and pyvista."""

import base64
from pathlib import Path

import numpy as np

from palpate.models.fe.element.mesh import TetMesh

QUADRATIC_TETRA = 24


def write_vtu(
    path: Path, mesh: TetMesh, points: dict[str, np.ndarray] | None = None, cells: dict[str, np.ndarray] | None = None
) -> None:
    """Write a mesh with fields on its nodes (N,...) and elements (E,...) as a .vtu file."""
    count = len(mesh.elements)
    fields = {
        "Points": [("Points", mesh.points)],
        "Cells": [
            ("connectivity", mesh.elements.ravel()),
            ("offsets", 10 * np.arange(1, count + 1)),
            ("types", np.full(count, QUADRATIC_TETRA, dtype=np.uint8)),
        ],
        "PointData": list((points or {}).items()),
        "CellData": [("region", mesh.region), *(cells or {}).items()],
    }
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<UnstructuredGrid><Piece NumberOfPoints="{len(mesh.points)}" NumberOfCells="{count}">',
    ]
    for group, arrays in fields.items():
        lines.append(f"<{group}>")
        lines += [_array(name, values) for name, values in arrays]
        lines.append(f"</{group}>")
    lines.append("</Piece></UnstructuredGrid></VTKFile>")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines))


def _array(name: str, values: np.ndarray) -> str:
    values = np.ascontiguousarray(values)
    kind = {"f": "Float64", "i": "Int64", "u": "UInt8", "b": "UInt8"}[values.dtype.kind]
    data = values.astype({"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}[kind]).tobytes()
    text = base64.b64encode(np.array([len(data)], dtype="<u8").tobytes() + data).decode()
    parts = values.size // max(len(values), 1)
    return f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="binary">{text}</DataArray>'
