"""The hand that holds a simulated or emulated device: script, arm and grip."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.fields import form
from palpate.compiler.records import floats, integers, unpacking
from palpate.messages import DeviceState, Pose, Vector3
from palpate.nodes.base import ARRAY, TABLE, Agrees, CompiledNode, Ideal, Node, SettingError
from palpate.nodes.base.kernels import kernel
from palpate.nodes.device.path import Segment, ends_of, points_of, shapes_of
from palpate.physics.device.falcon import FALCON, HOME, Geometry, directions
from palpate.physics.device.grip import GRIP, MOTION, grip_kernel

geometry_of = unpacking(Geometry)
COUNTS = Ideal("counts of the encoder")
"""Mark of the resolution of a simulated device."""
HELD_GRIP = {
    "geometry": form(Geometry), "grip": GRIP, "motion": MOTION, "ends": ARRAY, "points": TABLE, "shapes": ARRAY,
}  # fmt: skip
"""State of a simulated grip, for `physics.device.grip.grip_kernel`."""


class HeldGrip(Node):
    """Settings of a grip and the hand that holds it with a compliant arm:

    begin     initial position of the grip, world frame
    origin    position of the device's frame in the world
    mass      of grip and hand together
    damping   of the device alone
    hand_stiffness, hand_damping  of the arm; both 0: no hand
    """

    begin: Annotated[Vector3, "m"] = HOME
    origin: Annotated[Vector3, "m", Agrees(DeviceState, Pose)] = (0.0, 0.0, 0.0)
    mass: Annotated[float, "kg", msgspec.Meta(gt=0)] = 0.2
    damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 0.2
    hand_stiffness: Annotated[float, "N/m", msgspec.Meta(ge=0)] = 500.0
    hand_damping: Annotated[float, "N s/m", msgspec.Meta(ge=0)] = 10.0


def check_reach(grip: HeldGrip, name: str, point: Vector3) -> np.ndarray:
    """A point of the world [m] in the device's frame (3). SettingError: out of its reach; `name`: of the setting."""
    inside = np.array(point) - np.array(grip.origin)
    # Uncompiled, because the launcher needs no other kernel and the compiler takes 0.25 s to start.
    if not all(directions.py_func(FALCON.geometry, i, *inside.tolist())[0] for i in range(3)):
        raise SettingError(
            f"setting {name!r} [m]: found {point}, {tuple(inside.tolist())} from the device's origin, which is out of "
            f"its reach. Points near {HOME} from its origin work; 'origin' places the device in the world."
        )
    return inside


def hold_grip(node: CompiledNode, ends: np.ndarray, points: np.ndarray, shapes: np.ndarray) -> None:
    """Initialize a grip with `HELD_GRIP` and the settings of `HeldGrip`: at rest at the start of its path."""
    own, given = node.own, ("mass", "damping", "hand_stiffness", "hand_damping", "resolution")
    own["grip"] = (*(getattr(node, name) for name in given), FALCON.limit)
    node.hold("geometry", FALCON.geometry)
    own["motion"]["position"] = points[0]
    node.hold("ends", ends)
    node.hold("points", points)
    node.hold("shapes", shapes)


@kernel
def move_grip(own, torques, dt):
    """Move the grip by one step of dt [s] under motor torques [N m] (3). Returns its driven angles [rad]."""
    return grip_kernel(
        geometry_of(own.geometry), own.grip, own.motion, floats(own.ends), floats(own.points),
        integers(own.shapes), torques[0], torques[1], torques[2], dt,
    )  # fmt: skip


class SimulatedOperator(HeldGrip):
    """Settings of a hand that follows a scripted path:

    path      segments after `begin` (see Segment); the hand ends at rest
    speed_factor  factor on the speed of the path: 2 halves its duration
    """

    path: Annotated[tuple[Segment, ...], "1"] = ()
    speed_factor: Annotated[float, "1", msgspec.Meta(gt=0, le=1000)] = 1.0

    def points(self) -> np.ndarray:
        """Start and end points of the segments [m] (n + 1,3), in the device's frame."""
        return points_of(self.begin, self.path) - np.array(self.origin)

    def ends(self) -> np.ndarray:
        """End times of the segments [s] (n)."""
        return ends_of(self.path) / self.speed_factor

    def shapes(self) -> np.ndarray:
        return shapes_of(self.path)
