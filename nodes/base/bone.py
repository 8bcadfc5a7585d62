"""Rigid bone at an organ, for every body that is defined by its surface."""

from typing import Annotated

import numpy as np

from palpate.nodes.base.node import SettingError
from palpate.nodes.base.nodule import WithNodule
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

        return factor * bone_map(*self.in_frame_of_surface(), self.bone(), self.radius)

    def bone(self) -> Region:
        """The voxels of `bone_shape`. SettingError: the file cannot be read."""
        try:
            return read_region(self.bone_shape)
        except ArchiveError as error:
            raise SettingError(f"setting 'bone_shape': {error}") from None
