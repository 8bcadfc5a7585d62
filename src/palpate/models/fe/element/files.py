"""Meshes of tetrahedra from files of Gmsh, VTK, Abaqus and others, and VTK files of results (meshio, extra `mesh`)."""

from pathlib import Path

import numpy as np

from palpate.models.fe.element.mesh import TetMesh, quadratic
from palpate.models.files.apart import read_apart


def read_mesh(path: str | Path, unit: float = 1.0) -> tuple[TetMesh, dict[str, int]]:
    """The tetrahedra of a file as quadratic ones, and the number of each named region, for materials as in
    {names["skin"]: ...}.

    Regions: physical groups of Gmsh (.msh), element sets of Abaqus (.inp), the cell field `region` of VTK (.vtu, .vtk),
    as `write_vtu` writes it; else all elements have region 0. Other elements (faces, lines) are ignored.

    unit  [m] of the file's coordinates: 1e-3 for millimetres

    The file is read in a separate process (`models.files.apart`), whose memory and time are limited by its length.

    MeshError: a missing file, not a mesh, no tetrahedra, sets that overlap or are incomplete; meshio is missing.
    """
    arrays, about = read_apart(path)
    points, cells, region = arrays["points"] * unit, arrays["cells"], arrays["region"]
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = points[used], cells.reshape(len(region), -1)
    if about["kind"] == "tetra":
        return quadratic(points, cells, region), about["names"]
    return TetMesh(points, cells, region), about["names"]


def write_vtu(
    path: Path, mesh: TetMesh, points: dict[str, np.ndarray] | None = None, cells: dict[str, np.ndarray] | None = None
) -> None:
    """Write a mesh with fields on its nodes (N,...) and elements (E,...) as a .vtu file, for ParaView and pyvista.

    ModuleNotFoundError: meshio (extra `mesh`) is missing.
    """
    import meshio

    fields = {"region": mesh.region, **(cells or {})}
    path.parent.mkdir(parents=True, exist_ok=True)
    meshio.Mesh(
        mesh.points, [("tetra10", mesh.elements)], point_data=points, cell_data={n: [f] for n, f in fields.items()}
    ).write(path)
