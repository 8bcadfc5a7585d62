"""The receptors of a finger, for every node that needs their places."""

from pathlib import Path
from typing import Annotated, Any

import msgspec

from palpate.compiler.records import floats, integers
from palpate.messages import MessageError, Subsurface
from palpate.nodes.base import Agrees, CompiledNode, SettingError
from palpate.nodes.base.kernels import ieee_kernel
from palpate.physics.afferents import population
from palpate.physics.afferents.calibrated import CONSTANTS
from palpate.physics.afferents.published import DENSITIES, DEPTHS, TYPES

NO_STRESS = 3  # fault, next to those of `population.place`: the stress is empty


@ieee_kernel
def find_receptors(own, stress):
    """Set `own.corners` and `own.weights`, which interpolate the stress at the receptors, at the first message and when
    its points change; False, and `own.fault`: the stress does not fit."""
    count = len(floats(stress.stress))
    if count == 0 or count != len(floats(stress.points)):
        own.fault = NO_STRESS
        return False
    if own.points != count:
        wrong, own.bad = population.place(
            floats(stress.points), floats(own.at), integers(own.corners), floats(own.weights)
        )
        if wrong:
            own.fault = wrong
            return False
        own.points = count
    return True


class WithReceptors(CompiledNode):
    """Settings of a node that needs the receptors; all these nodes of a finger need the same values."""

    reach: Annotated[float, "m", msgspec.Meta(gt=0, le=0.1)] = 8e-3  # Of the disc; within the grid of tactile.Stress
    densities: Annotated[tuple[float, float, float], "1/m^2"] = DENSITIES  # Of SA1, RA1 and PC
    depths: Annotated[tuple[float, float, float], "m"] = DEPTHS  # Of their receptors
    units: Annotated[str, "1"] = ""  # CSV file with type, x, y, depth [m], in place of densities
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, lt=0.5), Agrees(Subsurface)] = 0.45  # Of the skin

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        for name, least in (("densities", 0.0), ("depths", 1e-5)):
            self.three(name, least)

    def three(self, name: str, least: float) -> None:
        """SettingError: a setting of the three types has a number below `least` or one that is not finite."""
        if not all(least <= each < float("inf") for each in getattr(self, name)):
            raise SettingError(
                f"setting {name!r}: found {getattr(self, name)}, expected three numbers, of {', '.join(TYPES)}, from "
                f"{least:g} on"
            )

    def receptors(self, seed: int, trial: int = 0, constants: str = "published") -> population.Population:
        """The receptors, kept for `explain`. SettingError: the file or the densities are invalid."""
        fits = CONSTANTS[constants]
        try:
            if self.units:
                self.population = population.read(Path(self.units), self.depths, seed, trial, fits)
            else:
                self.population = population.scatter(self.densities, self.reach, self.depths, seed, trial, fits)
            return self.population
        except (OSError, ValueError) as error:
            raise SettingError(f"setting {'units' if self.units else 'densities'!r}: {error}") from None

    def explain(self, fault: int, *messages: Any) -> Exception:
        """Why the stress does not fit the receptors."""
        points = messages[0].points
        if fault == population.OUTSIDE:
            bad = int(self.own["bad"])
            x, y, z = 1e3 * self.population.at[bad]
            low, high = 1e3 * points.min(axis=0), 1e3 * points.max(axis=0)
            return MessageError(
                f"{type(self).__name__}: {TYPES[self.population.kind[bad]]} receptor {bad} at x {x:.3g}, y {y:.3g} mm, "
                f"{z:.3g} mm deep: the stress is known for x {low[0]:.3g} to {high[0]:.3g}, y {low[1]:.3g} to "
                f"{high[1]:.3g} mm, {low[2]:.3g} to {high[2]:.3g} mm deep. Give tactile.Stress a 'reach' and 'depths' "
                "that cover all receptors"
            )
        if fault == population.NO_GRID:
            return MessageError(
                f"{type(self).__name__}: {len(points)} points of stress: expected a square grid at each depth, depth "
                "by depth and x by x, as tactile.Stress sends it, with 'reach' of at least one 'spacing'; or one point "
                f"at each of its {len(self.population.kind)} receptors, as tactile.Relief sends it"
            )
        return MessageError(f"{type(self).__name__}: the stress of {messages[0].source or 'its input'} is empty")
