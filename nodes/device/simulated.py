"""A simulated device in a simulated hand."""

from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.records import floats, integers, put, vector
from palpate.messages import DeviceState, Torque
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Ideal, Out
from palpate.nodes.base.absence import FADED, FALL, PACE, begin, fade_value, keep_pace
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.hand import (
    COUNTS,
    HELD_GRIP,
    SimulatedOperator,
    check_reach,
    geometry_of,
    hold_grip,
    move_grip,
)
from palpate.physics.device import random_numbers
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.grip import angles
from palpate.physics.device.random_numbers import seed_state, uniform

GLITCH = 1000 * FALCON.count  # [rad]


class Simulated(SimulatedOperator, CompiledNode):
    """A Falcon held by a hand that follows a scripted path, with a compliant arm (docs/equations/controller.md).

    Like a real one, it reports driven angles in whole encoder counts. Torques act on the grip through the geometry of
    the legs; when messages stop, the last torques fall to zero within 4 ms. The weight is balanced. During a pause of
    its process the hand and its script also pause. Settings, in addition to those of the hand:

    delay     delay of reports in samples
    lost      probability that a report repeats the one before
    glitches  probability that one angle has an error of 1000 counts in one report
    seed      of the random faults
    """

    paced = True
    sink = True

    resolution: Annotated[float, "rad", msgspec.Meta(ge=0), COUNTS] = FALCON.count
    delay: Annotated[int, "1", msgspec.Meta(ge=0, le=1000)] = 0
    lost: Annotated[float, "1", msgspec.Meta(ge=0, le=1), Ideal("lost reports")] = 0.0
    glitches: Annotated[float, "1", msgspec.Meta(ge=0, le=1), Ideal("wrong counts")] = 0.0
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1)] = 0

    State = HELD_GRIP | {
        "torques": FADED, "pace": PACE, "applied": (3,), "buttons": ARRAY, "random": random_numbers.STATE,
        "reports": TABLE, "newest": int, "last": (3,),  # a ring of `delay` + 1 reports [rad]; the last report
    }  # fmt: skip

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        check_reach(self, "begin", self.begin)
        for i, segment in enumerate(self.path):
            if segment.to is not None:
                check_reach(self, f"path[{i}].to", segment.to)

    def start(self) -> None:
        super().start()
        hold_grip(self, self.ends(), self.points(), self.shapes())
        self.hold("buttons", np.array([segment.buttons for segment in self.path] or [0], np.int32))
        self.hold("reports", np.zeros((self.delay + 1, 3)))
        self.own["newest"] = -1
        self.own["random"] = seed_state(self.seed)
        begin(self.own["torques"]["gain"], FALL, FALL)

    @kernel
    def compute(own, torque: Torque | None, out: Out[DeviceState], dt):
        reports = floats(own.reports)
        count = len(reports)
        if own.newest < 0:
            first = angles(geometry_of(own.geometry), own.grip, own.motion)
            for i in range(count):
                put(reports[i], first)
            put(own.last, first)
        if keep_pace(own.pace, dt):
            dt = own.pace.usual
        torques = fade_value(own.torques, torque.there, torque.torques, dt)
        put(own.applied, torques)
        own.newest = (own.newest + 1) % count
        put(reports[own.newest], move_grip(own, torques, dt))
        if own.lost == 0.0 or uniform(own.random) >= own.lost:
            put(own.last, vector(reports[(own.newest + 1) % count]))
        out.joints.count, out.homed = 3, True
        put(out.joints.values, vector(own.last))
        if own.glitches > 0.0 and uniform(own.random) < own.glitches:
            out.joints.values[0] += GLITCH
        out.buttons = integers(own.buttons)[own.motion.segment]
