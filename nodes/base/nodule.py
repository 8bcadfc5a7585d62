"""Settings of a nodule in the scene's tissue, for every body that supports one."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.exact import einsum
from palpate.messages import Vector3
from palpate.nodes.base.area import WithArea
from palpate.nodes.base.effect import Switch
from palpate.nodes.base.node import SettingError
from palpate.nodes.base.surface import rotation_matrix
from palpate.physics.archive import ArchiveError
from palpate.physics.kept import keep_results
from palpate.physics.materials.nodule import (
    FINE,
    SHARPER,
    nodule_centre,
    region_shares,
    stiffening,
    stiffness_map,
)
from palpate.physics.segmentation.region import Region, read_region


@keep_results
def _shares(vertices: np.ndarray, normals: np.ndarray, region: Region, reach: float) -> np.ndarray:
    """Shares of the energy in the voxels of a label, kept because all lanes of an ensemble have the same."""
    points, volume = region.points(FINE * reach)
    return region_shares(vertices, normals, points, np.full(len(points), volume), reach)


class WithNodule(WithArea):
    """Settings of a body with a hard (or soft) sphere below its surface (docs/equations/shape-display.md)."""

    nodule_radius: Annotated[float, "m", msgspec.Meta(ge=0, le=1), Switch("nodule")] = 0.0
    """Radius of the sphere; 0: no nodule."""
    nodule_position: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    """Point of the surface, in the world frame, below which the nodule is."""
    nodule_depth: Annotated[float, "m", msgspec.Meta(ge=0, le=1)] = 6.0e-3  # Of its centre below the surface
    nodule_ratio: Annotated[float, "1", msgspec.Meta(gt=0, le=1e6)] = 10.0
    """Modulus of the nodule over that of the tissue; below 1 for a cyst."""
    nodule_reach: Annotated[Annotated[float, msgspec.Meta(gt=0, le=1)] | None, "m"] = None
    """For bodies that are defined only by their surface: radius over which the load of the map is spread. null: 0.75
    times `radius` of the patch, over which they average the map."""
    nodule_shape: Annotated[str, "1"] = ""
    """File of the voxels of a label, in the frame of the surface, which replace the sphere: `--label liver+vessel`."""

    def hardness(self) -> np.ndarray:
        """Factor [1] (V) on the stiffness of each surface vertex; 1 everywhere without a nodule."""
        mesh = self.mesh()
        if self.nodule_radius == 0.0:
            return np.ones(len(mesh.vertices))
        reach = SHARPER * self.radius if self.nodule_reach is None else self.nodule_reach
        if self.nodule_shape:
            return stiffening(_shares(*self.in_frame_of_surface(), self.region(), reach), self.nodule_ratio)
        return stiffness_map(mesh.vertices, mesh.normals, self.centre(), self.nodule_radius, self.nodule_ratio, reach)

    def in_frame_of_surface(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [m] and normals [1] (V,3) of the surface in its frame, in which files of voxels are."""
        mesh, turn = self.mesh(), rotation_matrix(self.rotation)
        places = mesh.vertices - np.asarray(self.position, float)
        return einsum("vk,kj->vj", places, turn), einsum("vk,kj->vj", mesh.normals, turn)

    def region(self) -> Region:
        """The voxels of `nodule_shape`. SettingError: the file cannot be read."""
        try:
            return read_region(self.nodule_shape)
        except ArchiveError as error:
            raise SettingError(f"setting 'nodule_shape': {error}") from None

    def centre(self) -> np.ndarray:
        """Centre of the nodule [m] (3), in the world frame."""
        mesh = self.mesh()
        return nodule_centre(mesh.vertices, mesh.normals, self.nodule_position, self.nodule_depth)
