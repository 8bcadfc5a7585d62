"""A body that gives back more than it was given, for the ledger to catch."""

from typing import Annotated

import msgspec

from palpate.messages import Load, Surface
from palpate.nodes.deformation import MassSpring


class Giving(MassSpring):
    """Its law is stiffer on the way out than on the way in, by `gain`; what it says to hold is that of the way in."""

    gain: Annotated[float, "1"] = 0.3

    def start(self) -> None:
        super().start()
        self._last = 0.0

    def step(self, load: list[Load], *, dt: float) -> Surface:
        surface = super().step(load, dt=dt)
        out, self._last = surface.previous_indentation < self._last, surface.previous_indentation
        return msgspec.structs.replace(surface, stiffness=surface.stiffness * (1.0 + self.gain * out))
