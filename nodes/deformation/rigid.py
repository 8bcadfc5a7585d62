"""A body that hardly gives."""

from __future__ import annotations

from typing import Annotated

import msgspec

from palpate.messages import Load, Surface
from palpate.nodes.base import Node
from palpate.physics.bodies.mass_spring import normal_force
from palpate.physics.entry_point import NO_NODES, NO_VECTORS


class Rigid(Node):
    """A plate that is indented by force/stiffness, 10 nm at 10 N unless set otherwise, and sends no displacement: for
    scenes without tissue, and to see the fingertip alone."""

    plate_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 1e9

    def step(self, load: Load, *, dt: float) -> Surface:
        return Surface(
            nodes=NO_NODES,
            displacement=NO_VECTORS,
            stiffness=self.plate_stiffness,
            exponent=1.0,
            damping=0.0,
            rest_indentation=0.0,
            previous_indentation=(push := normal_force(load.forces, load.normal)) / self.plate_stiffness,
            step=dt,
            stored=(0.5 * push * push / self.plate_stiffness,),
        )
