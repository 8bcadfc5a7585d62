"""The bone next to an organ, from labels of a segmentation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from palpate.launch.load.labelled.table import is_bone
from palpate.physics.segmentation.endings import ON

if TYPE_CHECKING:
    import numpy as np

    from palpate.physics.geometry.mesh import Mesh
    from palpate.physics.segmentation.backing import Bone

SHOWN = 3  # labels of a note


class RigidBone(NamedTuple):
    """Voxels of bone, the label of the organ, and the file."""

    bone: Bone
    organ: str
    file: str

    def settings(self, mesh: Mesh, rotation: np.ndarray, moved: np.ndarray) -> tuple[dict[str, Any], tuple[str, ...]]:
        """As of `labelled.nodule.Nodule`: the settings of a body with this bone, and notes."""
        where = f"{1e3 * self.bone.distance:.2g} mm from {self.organ}"
        return {"bone_shape": self.bone.shape}, (
            f"{self.file}: {self.bone.name}, {where}, is rigid and fixed in space",
        )


def bones_nearby(near: Sequence[tuple[str, float]], file: str, label: object) -> tuple[str, ...]:
    """A note that names the labels of bone next to an organ, and how they support it; none: no note."""
    found = [(name, away) for name, away in near if is_bone(name)][:SHOWN]
    if not found:
        return ()
    names = ", ".join(f"{name} ({1e3 * away:.2g} mm)" for name, away in found)
    number = found[0][0].partition(" ")[0]
    text = f"next to the organ lies bone without effect: {names}; it is rigid with --label {label}{ON}{number}"
    return (f"{file}: {text}",)
