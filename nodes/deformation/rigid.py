"""A body that hardly gives."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base import Node
from palpate.nodes.base.contacts import several
from palpate.physics.bodies.mass_spring import normal_force
from palpate.physics.entry_point import NO_NODES, NO_VECTORS


class Rigid(Node):
    """A plate that is indented by force/stiffness, 10 nm at 10 N unless set otherwise, and sends no displacement: for
    scenes without tissue, and to see the fingertip alone. Several contacts do not feel one another."""

    plate_stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 1e9

    def step(self, load: list[Load], *, dt: float) -> Surface:
        pushes = [normal_force(each.forces, each.normal) for each in load]
        laws = [(self.plate_stiffness, 1.0, 0.0, 0.0, push / self.plate_stiffness) for push in pushes]
        return Surface(
            nodes=NO_NODES,
            displacement=NO_VECTORS,
            stiffness=self.plate_stiffness,
            exponent=1.0,
            damping=0.0,
            rest_indentation=0.0,
            previous_indentation=laws[0][-1],
            step=dt,
            stored=(sum([0.5 * push * push / self.plate_stiffness for push in pushes]),),
            **several(laws, np.eye(len(laws))),
        )
