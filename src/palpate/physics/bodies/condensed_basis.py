"""The static condensation of a finite-element organ to its surface, in memory and as a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.geometry.search.morton import morton_order
from palpate.physics.indices import check_indices


@dataclass(frozen=True)
class Basis:
    """Static condensation of an organ to its surface."""

    vertices: np.ndarray  # [m] (V,3) of the coarse surface, in the organ's frame
    triangles: np.ndarray  # [1] (T,3)
    compliance: np.ndarray  # [m/N] (3V,3V) float32, for a modulus of 1 Pa

    def save(self, path: Path, about: str = "") -> None:
        """Write the lower half, quantised to steps of the largest entry over 32767, with high and low bytes separate
        for compression; `about` describes the origin."""
        step = float(np.abs(self.compliance).max()) / 32767
        lower = np.rint(self.compliance[np.tril_indices(len(self.compliance))] / step).astype("<i2")
        with replacing(path, cached=True) as part, part.open("wb") as file:
            np.savez_compressed(
                file, vertices=self.vertices, triangles=self.triangles, step=np.float64(step),
                lower=np.ascontiguousarray(lower.view(np.uint8).reshape(-1, 2).T), about=np.array(about),
            )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> Basis:
        """Read a stored basis. ArchiveError: not a basis, or a damaged one."""
        try:
            archive = read_arrays(path)
            vertices = archive["vertices"]
            triangles = check_indices(archive["triangles"], len(vertices), "a triangle refers to the vertex")
            if vertices.ndim != 2 or triangles.ndim != 2 or vertices.shape[1] != 3 or triangles.shape[1] != 3:
                raise ValueError(f"vertices {vertices.shape} and triangles {triangles.shape}, expected (V, 3), (T, 3)")
            if archive["triangles"].dtype.kind not in "iu":
                raise ValueError(f"triangles of {archive['triangles'].dtype}, expected integers")
            size = 3 * len(vertices)
            lower = np.ascontiguousarray(archive["lower"].T).view("<i2").ravel()
            if lower.size != size * (size + 1) // 2:  # before the full matrix is allocated
                raise ValueError(f"{lower.size} compliances for {len(vertices)} vertices")
            full = np.zeros((size, size), dtype=np.float32)
            full[np.tril_indices(size)] = lower * np.float32(archive["step"])
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError) as error:
            raise ArchiveError(f"{path}: not a reduced basis: {error}. Rebuild it with `palpate build basis`") from None
        full += np.tril(full, -1).T
        return cls(vertices, archive["triangles"], full)


@dataclass(frozen=True)
class OrderedBasis(Basis):
    """A basis whose vertices are numbered along a Morton curve, for a surface in any order, as that of a file: those of
    a patch then lie close together in memory. In the order of a reduced file the 105 rows of C that a step reads take
    twice as many lines of the cache, and the step up to 15 % longer.

    listed  [m] (V,3) the vertices in the order of the file of the basis
    """

    listed: np.ndarray

    @classmethod
    def load(cls, path: Path) -> OrderedBasis:
        stored = Basis.load(path)
        order, size = morton_order(stored.vertices), len(stored.vertices)
        number = np.empty(size, np.int64)
        number[order] = np.arange(size)
        rows = (3 * order[:, None] + np.arange(3)).ravel()
        return cls(stored.vertices[order], number[stored.triangles], stored.compliance[np.ix_(rows, rows)],
                   stored.vertices)  # fmt: skip
