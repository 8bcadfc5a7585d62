"""Walls of a body that face each other across a thin gap, and carry pressure across it without friction."""

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.sparse.tangent import Pattern

TOGETHER = 512  # pairs whose blocks of the tangent are made at once


class Walls(ContactPair):
    """Springs between points on facing boundary faces, in the direction of their normals: the pressure

        p = k n.(u - u')

    on each point resists that the walls approach, u and u' the displacements of a point and of the one opposite; they
    slide freely. As walls that have come together and stay so, they also resist that the gap opens.

    nodes      (P,12) of each pair: the six of its face, and the six of the face opposite
    values     [1] (P,12) shape functions at the point, and those at the point opposite with a minus sign
    normals    [1] (P,3)
    stiffness  [N/m] (P,) of each pair: k [Pa/m] times its share of the area
    """

    def __init__(self, nodes: np.ndarray, values: np.ndarray, normals: np.ndarray, stiffness: np.ndarray) -> None:
        if not (stiffness > 0).all():
            raise ValueError(f"walls: found {stiffness.min()} N/m, expected positive numbers")
        self.faces, self.values, self.normals, self.stiffness = nodes, values, normals, stiffness

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        """The pattern does not couple the walls yet."""

    def couples(self) -> np.ndarray:
        return self.faces

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        nodes, values, normals = self.faces, self.values, self.normals
        opened = np.einsum("pa,pai,pi->p", values, displacement[nodes], normals)
        np.add.at(force, nodes, np.einsum("p,pa,pi->pai", self.stiffness * opened, values, normals))
        for begin in range(0, len(nodes) if tangent else 0, TOGETHER):
            some = slice(begin, begin + TOGETHER)
            v, n = values[some], normals[some]
            np.add.at(data, self._where[some], np.einsum("p,pa,pb,pi,pj->pabij", self.stiffness[some], v, v, n, n))

    def inputs(self) -> bytes:
        """All that its forces depend on."""
        return b"".join(part.tobytes() for part in (self.faces, self.values, self.normals, self.stiffness))
