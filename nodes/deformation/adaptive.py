"""The sampled body that keeps to an error (docs/effects.md)."""

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from palpate.messages import Load, Surface
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.basis_store import SHIPPED, cache
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.physics.archive import ArchiveError
from palpate.physics.bodies.fidelity_bases import FidelityBases
from palpate.physics.bodies.fidelity_levels import FidelityLevels
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody


class Adaptive(ReducedFE):
    """The sampled body with adaptive fidelity: at each tick as many modes as a given error requires.

    The error is that against all of its modes; what these miss of the full model is told with the basis. It is
    claimed in each message, and may be above what was asked for while a finer body takes over, and where `most`
    leaves that out.
    """

    model: Annotated[Literal["sampled"], "1"] = "sampled"
    surface: Annotated[str, "1"] = "fingertip"
    young: Annotated[float, "Pa", msgspec.Meta(ge=10, le=1e9)] = 160.0
    error: Annotated[float, "1", msgspec.Meta(ge=1e-4, le=1)] = 0.1
    """Relative error of the indentation that is allowed."""
    most: Annotated[int, "1", msgspec.Meta(ge=4, le=200)] = 200
    """Modes of the finest body that is taken, whatever the error: this keeps a deadline on any clock."""
    deadline: Annotated[float, "s", msgspec.Meta(ge=0, le=10)] = 0.0
    """Longest time between two steps; one that comes later, as it may on the real clock, leaves the finest body in use
    out for a second at least. 0: none."""

    def _made(self, count: int = 1) -> FidelityLevels:
        basis, given = self._placed()
        assert isinstance(basis, SampledBasis)  # its model is sampled
        levels = self.levels()
        if self.most < levels.modes[0]:
            raise SettingError(f"setting 'most' [1]: found {self.most}, expected at least {levels.modes[0]}")
        bodies = [SampledBody(own, *given) for own in levels.cut(basis)]
        return FidelityLevels(bodies, levels, self.error, self.most, self.deadline or math.inf)

    def step(self, load: list[Load], *, dt: float) -> Surface:
        surface, switched = super().step(load, dt=dt), self._body
        assert isinstance(switched, FidelityLevels)
        return msgspec.structs.replace(surface, estimated_error=switched.estimated_error, fidelity=switched.fidelity)

    def levels(self) -> FidelityBases:
        """The stored levels of the basis.

        SettingError: none are stored, they cannot be read, or are those of another basis.
        """
        stored = self.stored(SHIPPED, cache())
        path = beside(stored[0]) if stored else Path("none")
        make = f"Make them: {self.levels_command()}"
        try:
            levels, about = FidelityBases.load(path)
        except ArchiveError as error:
            raise SettingError(f"{error}. {make}") from None
        if about.get("basis") != self.key():
            raise SettingError(f"{path}: fidelity levels of basis {about.get('basis')}, expected {self.key()}. {make}")
        return levels

    def levels_command(self) -> str:
        """What makes the levels of its basis."""
        return self.command().replace("palpate reduce", "palpate reduce --levels", 1)


def beside(basis: Path) -> Path:
    """Where the levels of a stored basis lie."""
    return basis.parent / "levels" / basis.name
