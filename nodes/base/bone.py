"""Rigid bone at an organ, for every body that is defined by its surface."""

from typing import Annotated

import numpy as np

from palpate.compiler.exact import einsum
from palpate.nodes.base.node import SettingError
from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import rotation_matrix
from palpate.physics.archive import ArchiveError
from palpate.physics.segmentation.region import Region, read_region


class WithBone(WithNodule):
    """Settings of a body with bone next to it (docs/equations/shape-display.md)."""

    bone_shape: Annotated[str, "1"] = ""
    """File of the voxels of bone next to the organ, in the frame of the surface: `--label liver/rib_left_9`."""

    def hardness(self) -> np.ndarray:
        factor = super().hardness()
        if not self.bone_shape:
            return factor
        from palpate.physics.materials.bone import bone_map  # scipy.ndimage, which few graphs need

        mesh, turn = self.mesh(), rotation_matrix(self.rotation)
        places = mesh.vertices - np.asarray(self.position, float)
        vertices, normals = (einsum("vk,kj->vj", each, turn) for each in (places, mesh.normals))
        return factor * bone_map(vertices, normals, self.bone(), self.radius)

    def bone(self) -> Region:
        """The voxels of `bone_shape`. SettingError: the file cannot be read."""
        try:
            return read_region(self.bone_shape)
        except ArchiveError as error:
            raise SettingError(f"setting 'bone_shape': {error}") from None
