"""A body that generates energy, for tests of the ledger."""

from typing import Annotated

from palpate.compiler.kernel import ieee_kernel
from palpate.messages import Load, Surface
from palpate.nodes.base import Out
from palpate.nodes.deformation import MassSpring

_press = MassSpring.compute


class Giving(MassSpring):
    """Its law is stiffer by `gain` during unloading; the stored energy that it reports is that of loading."""

    gain: Annotated[float, "1"] = 0.3

    State = MassSpring.State | {"before": ()}

    @ieee_kernel
    def compute(own, load: list[Load], out: Out[Surface], dt):
        _press(own, load, out, dt)
        if out.previous_indentation < own.before:
            out.stiffness *= 1.0 + own.gain
        own.before = out.previous_indentation
