"""A pointer, of a mouse, a pen or a finger on a touch screen, and a hand that follows it."""

import math
from typing import Annotated

import msgspec

from palpate.messages import DeviceState, Force, Pointed, Torque, Vector3
from palpate.nodes.base import Node, Out, SettingError
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.device.follower import Follower, follow
from palpate.nodes.device.mailbox import Inbox, open_inbox
from palpate.physics.device.falcon import HOME

FARTHEST = 1e3  # [m] largest distance of a sample from the world's origin, along each axis


class PointerSample(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True):
    """A sample for a `device.Pointer`, sent as a msgpack array: number, position [m, world], buttons."""

    number: int
    place: Vector3
    buttons: int = 0


class Pointer(Node):
    """Target position of the fingertip from a pointer of another program: the newest sample on a local datagram socket.

    A sample is a msgpack array [number, [x, y, z], buttons] in metres of the world. Other datagrams are dropped and
    counted. The messages of this node are recorded, so that the motion of the hand can be recomputed. Settings:

    socket  path of the socket, made at the start; only this user can send to it. On Windows a file (see `mailbox`)
    begin   position of the pointer before its first sample, world frame
    """

    paced = True
    sink = True
    hardware = True

    socket: Annotated[str, "1"]
    begin: Annotated[Vector3, "m"] = HOME

    foreign = reported = 0

    def start(self) -> None:
        self.stop()
        self.last = PointerSample(0, self.begin)
        self.foreign = self.reported = 0
        try:
            self._inbox = open_inbox(self.socket)
        except OSError as error:
            raise SettingError(
                f"setting 'socket': found {self.socket!r}: {error.strerror or error}; expected the path of a new "
                "socket in a folder of this user, of at most 107 bytes"
            ) from None

    def step(self, *, dt: float) -> Pointed:
        for data in self._inbox.read():
            try:
                sample = msgspec.msgpack.decode(data, type=PointerSample)
            except msgspec.MsgspecError:
                self.foreign += 1
                continue
            if all(abs(x) <= FARTHEST for x in sample.place):
                self.last = sample
            else:
                self.foreign += 1
        return Pointed(position=self.last.place, buttons=self.last.buttons, sample=self.last.number)

    def notes(self) -> list[str]:
        """Number of dropped samples: at the first ones, and in total at the end."""
        going = "_inbox" in self.__dict__
        if self.foreign == self.reported or (going and self.reported):
            return []
        self.reported = self.foreign
        return [
            f"the pointer's socket: {self.foreign} dropped, expected [number, [x, y, z], buttons] with places within "
            f"{FARTHEST:g} m" + ("; more are counted" if going else "")
        ]

    def stop(self) -> None:
        inbox: Inbox | None = self.__dict__.pop("_inbox", None)
        if inbox is not None:
            inbox.close()


class Mouse(Follower):
    """A Falcon's grip in a simulated hand that follows a pointer. The hand's goal p follows the pointer q as

        p' = (q - p)/lag,  |p'| <= speed

    so that the steps of a pointer (60 per second, or large jumps) become the smooth motion of a hand. Settings, in
    addition to those of the hand:

    lag     [s] time constant with which the goal follows the pointer, assumed
    speed   [m/s] largest speed of the goal, assumed
    """

    lag: Annotated[float, "s", msgspec.Meta(gt=0, le=1)] = 0.03
    speed: Annotated[float, "m/s", msgspec.Meta(gt=0, le=2)] = 0.5

    @ieee_kernel
    def compute(own, pointer: Pointed, torque: Torque | None, force: Force | None, out: Out[DeviceState], dt):
        p, q, origin = own.goal, pointer.position, own.origin
        away = (q[0] - origin[0] - p[0], q[1] - origin[1] - p[1], q[2] - origin[2] - p[2])
        length = math.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
        way = length * -math.expm1(-dt / own.lag)
        share = min(way, own.speed * dt) / length if length > 0.0 else 0.0
        goal = (p[0] + away[0] * share, p[1] + away[1] * share, p[2] + away[2] * share)
        follow(own, goal, torque, force, out, dt)
        out.buttons = pointer.buttons
