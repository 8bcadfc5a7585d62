"""Meshes of tetrahedra from files of Gmsh, VTK, Abaqus and others, and VTK files of results (meshio, extra `mesh`)."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.models.fe.element.mesh import MeshError, TetMesh, quadratic
from palpate.physics.extras import missing

REGION_FIELDS = ("gmsh:physical", "region", "medit:ref", "CellEntityIds")
"""Names of cell fields that contain the region of each element; the first that exists is used."""


def read_mesh(path: str | Path, unit: float = 1.0) -> tuple[TetMesh, dict[str, int]]:
    """The tetrahedra of a file as quadratic ones, and the number of each named region, for materials as in
    {names["skin"]: ...}.

    Regions: physical groups of Gmsh (.msh), element sets of Abaqus (.inp), the cell field `region` of VTK (.vtu, .vtk),
    as `write_vtu` writes it; else all elements have region 0. Other elements (faces, lines) are ignored.

    unit  [m] of the file's coordinates: 1e-3 for millimetres

    MeshError: a missing file, not a mesh, no tetrahedra, sets that overlap or are incomplete; meshio is missing.
    """
    try:
        import meshio
    except ModuleNotFoundError as error:
        raise MeshError(missing(f"{path}", error.name, "mesh")) from None
    if not Path(path).is_file():
        raise MeshError(f"{path}: the file does not exist")
    try:
        mesh = meshio.read(path)
    except (Exception, SystemExit) as error:  # meshio calls sys.exit for some damaged files
        raise MeshError(f"{path}: cannot be read as a mesh: {error}") from None
    blocks = [k for k, block in enumerate(mesh.cells) if block.type in ("tetra", "tetra10")]
    kinds = {mesh.cells[k].type for k in blocks}
    if len(kinds) != 1:
        others = sorted({block.type for block in mesh.cells})
        raise MeshError(f"{path}: found cells {', '.join(others) or 'none'}; expected tetra or tetra10, one of them")
    points = np.asarray(mesh.points, dtype=np.float64) * unit
    cells = np.concatenate([mesh.cells[k].data for k in blocks]).astype(np.int64)
    region, names = _regions(path, mesh, blocks)
    used, cells = np.unique(cells, return_inverse=True)
    points, cells = points[used], cells.reshape(len(region), -1)
    if kinds == {"tetra"}:
        return quadratic(points, cells, region), names
    return TetMesh(points, cells, region), names


def _regions(path: str | Path, mesh: Any, blocks: list[int]) -> tuple[np.ndarray, dict[str, int]]:
    count = [len(mesh.cells[k].data) for k in blocks]
    for field in REGION_FIELDS:
        if field in mesh.cell_data:
            region = np.concatenate([np.asarray(mesh.cell_data[field][k]).ravel() for k in blocks])
            if not np.array_equal(region, np.round(region)):
                raise MeshError(f"{path}: cell field {field!r}: expected integers, the numbers of regions")
            tags = {name: int(tag[0]) for name, tag in mesh.field_data.items() if int(tag[1]) == 3}
            return region.astype(np.int64), tags
    region = np.full(sum(count), -1, dtype=np.int64)
    names: dict[str, int] = {}
    start = np.concatenate([[0], np.cumsum(count)])
    for name, parts in mesh.cell_sets.items():
        found = [start[n] + np.asarray(parts[k], dtype=np.int64) for n, k in enumerate(blocks) if parts[k] is not None]
        inside = np.concatenate(found) if found else np.zeros(0, dtype=np.int64)
        if not len(inside) or name.startswith("gmsh:"):
            continue
        if (region[inside] >= 0).any():
            if len(inside) == len(region) or ((region[inside] >= 0).all() and len(np.unique(region[inside])) > 1):
                continue  # a union of sets, such as all elements
            raise MeshError(f"{path}: element set {name!r} overlaps another; expected sets that share no element")
        names[name] = len(names)
        region[inside] = names[name]
    if not names:
        return np.zeros(len(region), dtype=np.int64), {}
    if (region < 0).any():
        raise MeshError(f"{path}: {int((region < 0).sum())} elements are in none of the sets {', '.join(names)}")
    return region, names


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
