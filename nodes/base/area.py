"""Settings of the area law of a scene, the growth of the contact with the force, for spread.Kernel and for bodies."""

from typing import Annotated, Any, Literal

import msgspec

from palpate.messages import Load, Vector
from palpate.nodes.base.effect import Agrees
from palpate.nodes.base.node import SettingError
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.physics.contact.area import FIXED, AreaLaw, ball, fingertip, of_table


class WithArea(OnThinnedSurface):
    """Settings of the patch under the finger and of its area law, the same in spread.Kernel and in the body."""

    radius: Annotated[float, "m", msgspec.Meta(gt=0), Agrees(Load)] = 8e-3
    """Of the patch, where `area` is fixed; in a body also of the patch of the terminal law before the first load, of
    that under each of several fingers, and of stiffness maps."""
    area: Annotated[Literal["fixed", "ball", "fingertip", "table"], "1", Agrees(Load)] = "fixed"
    """Radius of the contact as a function of the force: constant, of a rigid ball, of a fingertip, or the table
    `area_radii` at `area_forces` (docs/equations/spread.md)."""
    area_radius: Annotated[float, "m", msgspec.Meta(gt=0), Agrees(Load)] = 8e-3
    """Of the ball, or of curvature of the fingertip."""
    area_modulus: Annotated[float, "Pa", msgspec.Meta(gt=0), Agrees(Load)] = 23.8e3
    """E/(1 - nu²) of the tissue, for the ball and the fingertip."""
    area_forces: Annotated[Vector, "N", Agrees(Load)] = ()
    area_radii: Annotated[Vector, "m", Agrees(Load)] = ()

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.area_law()

    def area_law(self) -> AreaLaw:
        """The law; without forces if the patch is fixed. SettingError: the table is invalid."""
        if self.area == "fixed":
            return FIXED
        if self.area == "table":
            try:
                return of_table(self.area_forces, self.area_radii)
            except ValueError as error:
                raise SettingError(f"settings 'area_forces' and 'area_radii': {error}") from None
        return (ball if self.area == "ball" else fingertip)(self.area_radius, self.area_modulus)
