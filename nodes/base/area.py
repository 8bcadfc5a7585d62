"""The area law of a scene: how the contact grows with the force, for the node that spreads it and for the body."""

from typing import Annotated, Any, Literal

import msgspec

from palpate.messages import Vector
from palpate.nodes.base.node import SettingError
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.physics.contact.area import FIXED, AreaLaw, ball, fingertip, of_table


class WithArea(OnThinnedSurface):
    """Settings of a node that knows the contact area: give spread.Kernel and the body the same ones."""

    area: Annotated[Literal["fixed", "ball", "fingertip", "table"], "1"] = "fixed"
    """How the radius of the contact follows the force: not at all, as under a rigid ball, as under a fingertip, or as
    `area_radii` at `area_forces` (docs/equations/spread.md)."""
    area_radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3  # Of the ball, or of curvature of the fingertip
    area_modulus: Annotated[float, "Pa", msgspec.Meta(gt=0)] = 23.8e3
    """E/(1 - nu²) of the tissue, for the ball and the fingertip."""
    area_forces: Annotated[Vector, "N"] = ()
    area_radii: Annotated[Vector, "m"] = ()

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.area_law()

    def area_law(self) -> AreaLaw:
        """The law; without forces if the patch is fixed. SettingError: the table is not a law."""
        if self.area == "fixed":
            return FIXED
        if self.area == "table":
            try:
                return of_table(self.area_forces, self.area_radii)
            except ValueError as error:
                raise SettingError(f"settings 'area_forces' and 'area_radii': {error}") from None
        return (ball if self.area == "ball" else fingertip)(self.area_radius, self.area_modulus)
