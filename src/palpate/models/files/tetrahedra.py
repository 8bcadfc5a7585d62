"""Tetrahedra and their regions in a mesh as meshio reads it."""

from typing import Any

import numpy as np

from palpate.physics.errors import MeshError
from palpate.physics.indices import check_indices

REGION_FIELDS = ("gmsh:physical", "region", "medit:ref", "CellEntityIds")
"""Names of cell fields that contain the region of each element; the first that exists is used."""


def tetrahedra(path: str, mesh: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Points (N,3), cells (E,4 or 10) and region (E,) of a mesh; the kind of its cells, and the names of its
    regions. MeshError: no tetrahedra, a wrong index, sets that
    overlap or are incomplete."""
    blocks = [k for k, block in enumerate(mesh.cells) if block.type in ("tetra", "tetra10")]
    kinds = {mesh.cells[k].type for k in blocks}
    if len(kinds) != 1:
        others = sorted({block.type for block in mesh.cells})
        raise MeshError(f"{path}: found cells {', '.join(others) or 'none'}; expected tetra or tetra10, one of them")
    points = np.asarray(mesh.points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: found points of shape {points.shape}, expected (N, 3)")
    try:
        given = np.concatenate([mesh.cells[k].data for k in blocks])
        cells = check_indices(given, len(points), "an element refers to the point")
    except ValueError as error:
        raise MeshError(f"{path}: {error}") from None
    region, names = _regions(path, mesh, blocks)
    return {"points": points, "cells": cells, "region": region}, {"kind": kinds.pop(), "names": names}


def _regions(path: str, mesh: Any, blocks: list[int]) -> tuple[np.ndarray, dict[str, int]]:
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
