"""The separate pieces of a triangle mesh: which belong together, which encloses which."""

import numpy as np
import scipy  # loads its submodules when they are used

from palpate.compiler.exact import arctan2, einsum
from palpate.physics.geometry.refined.edge_list import edges_of


def pieces(triangles: np.ndarray, vertices: int) -> np.ndarray:
    """Number of the connected piece of each triangle (T,); pieces that share an edge are one."""
    _, of, two = edges_of(triangles, vertices)
    size = len(of)
    first = two[of, 0].ravel()  # of the triangles of each edge
    links = scipy.sparse.coo_array((np.ones(3 * size, bool), (np.arange(3 * size) // 3, first)), shape=(size, size))
    _, label = scipy.sparse.csgraph.connected_components(links.tocsr(), directed=False)
    return np.asarray(np.unique(label, return_inverse=True)[1].ravel())


def winding(points: np.ndarray, triangles: np.ndarray, at: np.ndarray) -> float:
    """Winding number of a closed surface about a point (3): 1 or -1 inside, by its orientation, and 0 outside.

    The sum of the solid angles of the triangles over 4 pi (A. van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30
    (1983) 125).
    """
    a, b, c = (points[triangles[:, i]] - at for i in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    dots = (einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    ab, bc, ca = dots
    triple = einsum("ij,ij->i", a, np.cross(b, c))
    return float(arctan2(triple, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2.0 * np.pi))


def parents(points: np.ndarray, triangles: np.ndarray, piece: np.ndarray) -> np.ndarray:
    """The smallest closed piece that encloses each piece (P,), -1: none. Pieces do not cross.

    points (V,3); triangles (T,3), each piece oriented consistently; piece (T,) of each triangle
    """
    count = int(piece.max()) + 1
    order = np.argsort(piece, kind="stable")
    parts = np.split(triangles[order], np.searchsorted(piece[order], np.arange(1, count)))
    low = np.array([points[part].min(axis=(0, 1)) for part in parts])
    high = np.array([points[part].max(axis=(0, 1)) for part in parts])
    size = np.prod(high - low, axis=1)
    found = np.full(count, -1)
    for inner in range(count):
        around = (low <= low[inner]).all(axis=1) & (high >= high[inner]).all(axis=1) & (size > size[inner])
        for outer in sorted(np.flatnonzero(around), key=size.__getitem__):
            if abs(winding(points, parts[outer], points[parts[inner][0, 0]])) > 0.5:
                found[inner] = outer
                break
    return found
