"""The nodule of an organ, from a label inside of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.launch.load.labelled.table import ratio_of
from palpate.physics.errors import MeshError

if TYPE_CHECKING:
    from palpate.physics.geometry.mesh import Mesh
    from palpate.physics.segmentation.inclusion import Inclusion


class Nodule(NamedTuple):
    """A sphere or region in an organ, the label of the organ, and the file."""

    sphere: Inclusion
    organ: str
    file: str

    def settings(self, mesh: Mesh, rotation: np.ndarray, moved: np.ndarray) -> tuple[dict[str, Any], tuple[str, ...]]:
        """Settings of a body with this nodule, by the names of `nodes.base.nodule`, and notes.

        mesh      the organ's surface, where it lies in the world [m]
        rotation, moved  from the coordinates of the file to the world: (3,3), and then (3) [m]

        MeshError: the sphere's centre is outside of the organ.
        """
        centre = rotation @ np.array(self.sphere.centre) + moved
        nearest = int(np.argmin(np.sum((mesh.vertices - centre) ** 2, axis=1)))
        normal = mesh.normals[nearest]
        depth = float((mesh.vertices[nearest] - centre) @ normal)
        what = f"{self.file}: the label {self.sphere.name} in {self.organ}"
        if depth <= 0.0 and not self.sphere.shape:
            raise MeshError(
                f"{what}: its centre is {-1e3 * depth:.3g} mm outside of the organ's surface, expected inside"
            )
        found = {
            "nodule_position": (centre + depth * normal).tolist(),
            "nodule_depth": max(depth, 0.0),
            "nodule_radius": self.sphere.radius,
        }
        size = f"a nodule of radius {1e3 * self.sphere.radius:.3g} mm, {1e3 * depth:.3g} mm deep"
        if self.sphere.shape:
            found["nodule_shape"] = self.sphere.shape
            size = f"a region of {4e6 / 3 * np.pi * self.sphere.radius**3:.3g} cm³ in its largest part"
        ratio = ratio_of(self.sphere.name, self.organ)
        if ratio is None:
            hard = "its modulus is not known; set nodule_ratio of the body"
        else:
            found["nodule_ratio"] = ratio.value
            hard = f"{ratio.value:g} times as stiff as the organ ({ratio.source}); nodule_ratio of the body changes it"
        return found, (f"{what} is {size}, {hard}", *(f"{what}: {note}" for note in self.sphere.notes))
