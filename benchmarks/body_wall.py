"""The stiffest tissue model that a device can render: a body in place of the wall of `palpate bench stability`.

    python benchmarks/body_wall.py [--body deformation.ReducedFE ...] [--rate 1000 ...] [--delay 1 ...] [--json]

The hand of `physics.device.wall_loop` pushes a mass with drag into a body on the plane, through an encoder and a
delay. A rigid finger touches it by contact.Series and spread.Kernel; the force goes through controller.Haptic or not.
"""

import math
from collections import deque
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from tables import parser, print_tables

from palpate.compiler.entry_point import NO_NODES, NO_VECTORS
from palpate.launch.load.classes import find_class
from palpate.messages import Contact, Load, Pose, Proximity, Surface
from palpate.nodes.base import Node, inputs, outputs, settings
from palpate.nodes.base.contacts import press_body
from palpate.nodes.base.surface import OnSurface
from palpate.nodes.contact import Series
from palpate.nodes.controller import Haptic
from palpate.nodes.spread import Kernel
from palpate.physics.device.stability import poles
from palpate.physics.device.wall_loop import WallDevice, advance, settles
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy.chain import BALL, LAW

PUSH = 0.1  # [N] of the hand: soft bodies are then pressed by millimetres
SPEED, BEGIN, SECONDS = 0.02, 0.2e-3, 2.0  # [m/s], [m] above the body, [s]
LONG = 100.0  # [s] Duration of a step after which a body is at rest
FAR = 1.0  # [m] Beyond this distance from the body, the loop counts as unstable
PLACE: dict[str, Any] = {"surface": "plane", "vertices": 1000, "position": (0.0, 0.0, 0.0)}
STIFF = ("Pa", "N/m", "N/m^n")  # Units of the settings for stiffness
NARROW = 3  # Halvings of an octave
NONE, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def stiffened(cls: type[Node], factor: float) -> Node:
    """The body on the plane, with all default moduli and stiffnesses multiplied by a factor.

    ArgumentError: the class is not a body, or has no setting for its stiffness.
    """
    if Surface not in outputs(cls) or Load not in {port.type for port in inputs(cls)}:
        raise ArgumentError(f"--body: found {cls.__name__}, expected a node that takes Load and sends Surface")
    own: dict[str, Any] = {}
    for name, setting in settings(cls).items():
        if setting.unit in STIFF and setting.default is not ...:
            usual = setting.default
            own[name] = tuple(factor * one for one in usual) if isinstance(usual, tuple) else factor * usual
    if not own:
        raise ArgumentError(f"--body: {cls.__name__} has no setting in {', '.join(STIFF)} that could be made stiffer")
    body = cls(**own, **(PLACE if issubclass(cls, OnSurface) else {}))
    body.wanted = LAW
    return body


class Wall:
    """A body with a rigid finger on it, stepped at one period [s]."""

    def __init__(self, body: Node, period: float) -> None:
        self._contact, self._spread, self._body, self._dt = Series(**BALL), Kernel(**PLACE), body, period
        for node in (self._contact, self._spread, body):
            node.start()
        self._surface = press_body(body, Load(nodes=NO_NODES, forces=NO_VECTORS, foot=NONE, normal=UP), dt=period)

    def press(self, depth: float) -> Contact:
        """The finger at this depth [m], below 0 in the air."""
        near = Proximity(
            foot=NONE, normal=UP, coordinates=(0.0, 0.0), element=0, gap=-depth, approach=max(depth, 0.0), slip=NONE
        )
        contact = self._contact.step(near, self._surface, dt=self._dt)
        self._surface = press_body(self._body, self._spread.step(contact, None, dt=self._dt), dt=self._dt)
        return contact

    def linear(self, force: float) -> tuple[float, float]:
        """K [N/m] at rest under this force [N], and B [N s/m] from the additional force in the first step after a
        displacement: a device that moves little feels the wall f = K s + B (s_k - s_{k-1})/T."""
        high = 1e-6
        while self._rested(high) < force:
            high *= 2.0
        low = 0.5 * high
        for _ in range(20):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._rested(middle) < force else (low, middle)
        way = 0.02 * high
        stiffness = (self._rested(high + way) - self._rested(high - way)) / (2.0 * way)
        rest = self._rested(high)
        jump = (self.press(high + way).force - rest) / way
        return stiffness, max(jump - stiffness, 0.0) * self._dt

    def _rested(self, depth: float) -> float:
        """Force [N] after a while at this depth [m]."""
        period, self._dt = self._dt, LONG
        for _ in range(4):
            contact = self.press(depth)
        self._dt = period
        return contact.force


def held(device: WallDevice, body: Node, *, controlled: bool, period: float, delay: int) -> tuple[bool, float]:
    """Whether the device comes to rest on the body, and the most energy [J] that it gave to the hand."""
    wall = Wall(body, period)
    controller = Haptic(
        passivity=controlled, mass=device.mass, drag=device.drag, delay=delay, resolution=device.resolution,
        limit=device.limit, slew=device.slew, ramp=0.0,
    )  # fmt: skip
    controller.start()
    x, v, force = BEGIN, -SPEED, 0.0
    line, before = deque([BEGIN] * (delay + 1), maxlen=delay + 1), BEGIN
    path = np.empty(round(SECONDS / period))
    given = most = 0.0
    for k in range(len(path)):
        last = x
        x, v = advance(x, v, force - PUSH, device.mass, device.drag, device.coulomb, period)
        given += force * (x - last)
        most = max(most, given)
        line.appendleft(x)
        step = device.resolution
        seen = step * math.floor(line[-1] / step + 0.5) if step else line[-1]
        contact = wall.press(-seen)
        if controlled:
            pose = Pose(position=(0.0, 0.0, seen), velocity=(0.0, 0.0, (seen - before) / period), dt=period)
            force = controller.step(contact, None, pose, dt=period).force[2]
        else:
            force = min(contact.force, device.limit)
        path[k], before = x, seen
        if not abs(x) < FAR:
            return False, most
    lifted = path[-len(path) // 4 :].max() > BEGIN
    return not lifted and settles(path, device.resolution), most


def stable(device: WallDevice, cls: type[Node], factor: float, period: float, delay: int) -> bool:
    """Whether the poles of the loop with the body's linear wall at the hand's push lie within the unit circle."""
    stiffness, damping = Wall(stiffened(cls, factor), period).linear(PUSH)
    return bool(np.abs(poles(stiffness, damping, device.mass, device.drag, period, delay)).max() <= 1.0)


def row(device: WallDevice, cls: type[Node], rate: float, delay: int) -> dict[str, float]:
    """K [N/m] at the hand's push up to which the loop comes to rest, by the poles (`stable`), simulated (`bare`) and
    with the controller (`controlled`); `inf` where all do, 0 where the softest does not; and the most energy [J] that
    the controlled loop gave to the hand (`given_out`)."""
    period, most = 1.0 / rate, 0.0
    told: dict[str, float] = {"rate": rate, "delay": delay}

    def rests(factor: float, controlled: bool) -> bool:
        nonlocal most
        done, given = held(device, stiffened(cls, factor), controlled=controlled, period=period, delay=delay)
        most = max(most, given) if controlled else most
        return done

    for name, holds in (
        ("stable", lambda f: stable(device, cls, f, period, delay)),
        ("bare", lambda f: rests(f, False)),
        ("controlled", lambda f: rests(f, True)),
    ):
        factor = stiffest(holds)
        between = 0.0 < factor < math.inf
        told[name] = Wall(stiffened(cls, factor), period).linear(PUSH)[0] if between else factor
    return told | {"given_out": most}


def stiffest(holds: Callable[[float], bool], low: float = 1 / 16, high: float = 256.0) -> float:
    """Largest factor for which `holds` is true, by octaves upwards, then bisection; `inf`: for all, 0: for none."""
    below, above = 0.0, low
    while above <= high and holds(above):
        below, above = above, 2.0 * above
    if below == 0.0 or above > high:
        return 0.0 if below == 0.0 else math.inf
    for _ in range(NARROW):
        middle = math.sqrt(below * above)
        below, above = (middle, above) if holds(middle) else (below, middle)
    return below


def main() -> None:
    """Print a row for each body, rate and delay: stiffness [N/m] at a push of 0.1 N, and energy [J]."""
    options = parser(__doc__)
    options.add_argument("--body", nargs="+", default=["deformation.ReducedFE"], help="tissue models")
    options.add_argument("--rate", nargs="+", type=float, default=[1000.0], help="Hz")
    options.add_argument("--delay", nargs="+", type=int, default=[0, 1, 2, 5], help="whole samples")
    options.add_argument("--mass", type=float, default=0.1, help="of the device, kg")
    options.add_argument("--drag", type=float, default=0.2, help="of the device, N s/m")
    options.add_argument("--coulomb", type=float, default=0.0, help="dry friction of the device, N")
    options.add_argument("--resolution", type=float, default=60e-6, help="of the encoder, m; 0: exact")
    given = options.parse_args()
    device = WallDevice(given.mass, given.drag, given.coulomb, given.resolution)
    cases = product(given.body, given.rate, given.delay)
    rows = [{"body": name, **row(device, find_class(name), rate, delay)} for name, rate, delay in cases]
    print_tables({"stiffest tissue model, N/m at a push of 0.1 N": rows}, given.json)


if __name__ == "__main__":
    main()
