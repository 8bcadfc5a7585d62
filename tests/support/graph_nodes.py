"""Small nodes for the tests of loading and planning: a hand that presses on a spring."""

from typing import Annotated

import msgspec

from palpate.messages import Contact, DeviceState, Force, Friction, Load, Pose, Proximity, Surface, Torque
from palpate.nodes import Node, Wants
from palpate.nodes.base import Observer, SettingError


class Hand(Node):
    """A source that moves on a straight line, or as a torque drives it."""

    paced = True
    speed: Annotated[float, "m/s"] = 0.01

    def step(self, torque: Torque | None) -> DeviceState:
        return DeviceState(position=(0.0, 0.0, -self.speed))


class RequiredHand(Node):
    """A source whose input is not optional."""

    paced = True

    def step(self, torque: Torque) -> DeviceState:
        return DeviceState()


class Finger(Node):
    """The position of the fingertip."""

    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 6e-3
    h0: Annotated[float, "m"] = 3e-3

    def step(self, state: DeviceState) -> Pose:
        return Pose(position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), dt=1e-3)


class Near(Node):
    """The nearest point of a plane."""

    offset: Annotated[tuple[float, float, float], "m"] = (0.0, 0.0, 0.0)
    count: Annotated[int, "1", msgspec.Meta(ge=1)] = 4
    mode: Annotated[str, "1"] = "plane"

    def step(self, pose: Pose) -> Proximity:
        zero = (0.0, 0.0, 0.0)
        return Proximity(zero, (0.0, 0.0, 1.0), (0.0, 0.0), 0, 0.0, 0.0, zero)


class Press(Node):
    """A contact that reads two fields of the body."""

    stiffness: Annotated[float, "N/m"] = 400.0

    def step(
        self, proximity: Proximity, body: Annotated[Surface | None, Wants("stiffness", "rest_indentation")]
    ) -> Contact:
        zero = (0.0, 0.0, 0.0)
        return Contact(zero, zero, 0.0, 0.0, 0.0, 0.0, 0.0)


class StrictPress(Node):
    """A contact that requires the body."""

    def step(self, proximity: Proximity, body: Surface) -> Contact:
        raise NotImplementedError


class Rub(Node):
    """Friction."""

    mu: Annotated[float, "1"] = 0.5

    def step(self, contact: Contact) -> Friction:
        return Friction((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), False)


class Spread(Node):
    """Spreads a force."""

    def step(self, contact: Contact, friction: Friction | None) -> Load:
        return Load([], [], (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


class StrictSpread(Node):
    """Spreads a force, and requires friction."""

    def step(self, contact: Contact, friction: Friction) -> Load:
        return Load([], [], (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


class Spring(Node):
    """A body."""

    stiffness: Annotated[float, "N/m"] = 1000.0
    exponent: Annotated[float, "1"] = 1.0

    def step(self, load: Load) -> Surface:
        return Surface([], [], self.stiffness, self.exponent, 0.0, 0.0, 0.0)


class Foam(Node):
    """Another body, with a different setting."""

    stiffness: Annotated[float, "N/m"] = 500.0
    cells: Annotated[int, "1"] = 10

    def step(self, load: Load) -> Surface:
        return Surface([], [], self.stiffness, 1.5, 0.0, 0.0, 0.0)


class Both(Node):
    """A node with two outputs."""

    def step(self, pose: Pose) -> tuple[Force, Torque]:
        zero = (0.0, 0.0, 0.0)
        return Force(zero, "rest_indentation", 0.0), Torque(zero)


class Control(Node):
    """The force on the hand."""

    gain: Annotated[float | None, "1"] = None

    def step(self, contact: Contact, friction: Friction | None) -> Force:
        return Force((0.0, 0.0, 0.0), "rest_indentation", 0.0)


class Motor(Node):
    """Torque from force."""

    def step(self, force: Force) -> Torque:
        return Torque((0.0, 0.0, 0.0))


class Lamp(Node):
    """A sink: it shows a friction."""

    sink = True

    def step(self, friction: Friction) -> None:
        return None


class Tape(Observer):
    """Listens."""

    size: Annotated[int, "B"] = 10

    def observe(self, stream: str, tick: int, payload: bytes) -> None:
        return None


class Needy(Node):
    """A setting without default."""

    mass: Annotated[float, "kg"]

    def step(self, pose: Pose) -> Pose:
        return pose


class Ring(Node):
    """A node driven by the type that it sends."""

    def step(self, pose: Pose) -> Pose:
        return pose


class Idle(Node):
    """No input and not a source."""

    def step(self) -> Pose:
        raise NotImplementedError


class NoUnit(Node):
    """A setting without a unit."""

    mass: float = 1.0

    def step(self, pose: Pose) -> Pose:
        return pose


class BadWants(Node):
    """Reads a field that the message does not have."""

    def step(self, body: Annotated[Surface, Wants("stifness")]) -> Pose:
        raise NotImplementedError


class Moody(Node):
    """Its constructor checks two settings together, and may fail."""

    low: Annotated[float, "m"] = 0.0
    high: Annotated[float, "m"] = 1.0

    def __init__(self, **given):
        super().__init__(**given)
        if self.low > self.high:
            raise SettingError(f"low {self.low} m lies above high {self.high} m")
        self.share = 1 / (self.high - self.low)

    def step(self, pose: Pose) -> Pose:
        return pose


class NoStep(Node):
    """No step."""


class Stray:
    """Not a node."""
