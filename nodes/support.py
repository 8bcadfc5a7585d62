"""The prescribed motion of organs, and the finger in their frame (docs/equations/moving-organs.md)."""

from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.records import floats, integers, put, vector
from palpate.messages import Pose, Vector3
from palpate.messages.tissue import Support
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out
from palpate.nodes.base.absence import PACE, keep_pace
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.path import Segment, ends_of, points_of, shapes_of
from palpate.physics.bodies.carried import displacement

REST: Vector3 = (0.0, 0.0, 0.0)


class Moving(CompiledNode):
    """A motion of organs with their elastic foundations: d = amplitude w(t/period) + path.

    moves      names of the bodies that move; the loader connects them (scene key `motions`)
    amplitude  displacement from exhalation to inhalation
    period     of a breath
    waveform   `sine`: sin²(pi t/period); `breathing`: its square, which stays longer near exhalation
    path       displacements, as the path of a hand: `{to: [0, 0.01, 0], time: 0.5}`, `{hold: 0.2}`; it begins at rest
               at zero, and ends at its last displacement

    During a pause of its process the motion also pauses, as that of a simulated hand.
    """

    paced = True

    moves: Annotated[tuple[str, ...], "1"] = ()
    amplitude: Annotated[Vector3, "m"] = REST
    period: Annotated[float, "s", msgspec.Meta(ge=0.05, le=1e6)] = 4.0
    waveform: Annotated[Literal["sine", "breathing"], "1"] = "sine"
    path: Annotated[tuple[Segment, ...], "1"] = ()

    State = {
        "ends": ARRAY, "points": TABLE, "shapes": ARRAY, "pace": PACE, "begun": bool, "clock": (), "last": (3,),
    }  # fmt: skip
    """The path; time [s] since the start, and the last displacement [m]."""
    shared = ("ends", "points", "shapes")

    def start(self) -> None:
        super().start()
        self.hold("ends", ends_of(self.path))
        self.hold("points", np.ascontiguousarray(points_of(REST, self.path)))
        self.hold("shapes", shapes_of(self.path))

    @kernel
    def compute(own, out: Out[Support], dt):
        if keep_pace(own.pace, dt):
            dt = own.pace.usual
        if own.begun:
            own.clock += dt
        own.begun = True
        d = displacement(
            own.clock, vector(own.amplitude), own.period, 1 + own.waveform, floats(own.ends), floats(own.points),
            integers(own.shapes),
        )  # fmt: skip
        last = vector(own.last)
        put(out.displacement, d)
        put(out.velocity, ((d[0] - last[0]) / dt, (d[1] - last[1]) / dt, (d[2] - last[2]) / dt))
        put(own.last, d)


class Relative(CompiledNode):
    """The finger in the frame of organs that move: its pose less the displacement of their foundation.

    Collision, contact, friction, controller and energy balance then work in this frame, in which the organs are at
    rest. The forces are the same in both.
    """

    State = {"at": (3,)}  # [m] displacement of the last support, which stays while it is missing

    @kernel
    def compute(own, pose: Pose, support: Support | None, out: Out[Pose], dt):
        out.delayed, out.dt = pose.delayed, pose.dt
        put(out.velocity, vector(pose.velocity))
        if support.there:
            put(own.at, vector(support.displacement))
        for i in range(3):
            out.position[i] = pose.position[i] - own.at[i]
            if support.there:
                out.velocity[i] -= support.velocity[i]
