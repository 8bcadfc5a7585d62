"""Real force sensors, for the force of a real indentation."""

import time
from typing import Annotated, Any, ClassVar

import msgspec

from palpate.drivers.exchange import Driver
from palpate.messages import Contact, Pose, Vector3
from palpate.nodes.base.wired import EMULATOR, Wired
from palpate.nodes.sensor.force_sensor import direction

Wrench = tuple[float, ...]
EXPIRED = 0.02  # [s] age at which a sample no longer counts; 3 periods of a slow sensor, as for the inputs of nodes


class NetFT(Wired):
    """ATI's Net F/T on the network: the force of a press against `normal`. Settings:

    port    its address, 192.168.1.1 by default of the manufacturer; `emulator`: an emulated sensor
    normal  out of the sensor's face, in the frame of the sensor; a press is a force against it
    foot    position of the sensor in the world
    tare    [s] time without contact at the start; its mean force is subtracted. It lasts at least until a sample

    While the sensor reports an error or is silent for more than 0.1 s, the force is 0, and a note counts these samples.

    A sample older than 20 ms, or than 3 periods of the sensor if longer, does not count: the force is zero until a new
    one arrives, and a note says for how many steps.

    With `port: emulator` and a pose, the finger presses an emulated sample with Hunt and Crossley's law: its surface is
    at `top` above the foot, and its force is `stiffness` d^`exponent` (1 + `damping` d').
    """

    paced: ClassVar[bool] = True

    normal: Annotated[Vector3, "1"] = (0.0, 0.0, 1.0)
    foot: Annotated[Vector3, "m"] = (0.0, 0.0, 0.0)
    tare: Annotated[float, "s", msgspec.Meta(ge=0, le=60)] = 0.2
    top: Annotated[float, "m"] = 0.0
    stiffness: Annotated[float, "N/m^n", msgspec.Meta(ge=0)] = 3e3
    exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=3)] = 1.5
    damping: Annotated[float, "s/m", msgspec.Meta(ge=0)] = 5.0

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.normal = direction(self.normal)

    def start(self) -> None:
        self.clock = 0.0
        self.bias, self.seen, self.last = 0.0, 0, -1
        self.pressed = 0.0  # [N] by the finger, on the emulated sample
        self.expired = 0  # steps whose newest sample was too old
        self.noted = self.ended = False
        super().start()

    def sensed_wrench(self, now: int) -> Wrench:
        """Force [N] and torque [N m] on the emulated sensor at `now` [ns]."""
        x, y, z = self.normal
        return (-self.pressed * x, -self.pressed * y, -self.pressed * z, 0.0, 0.0, 0.0)

    def _press_bone(self, pose: Pose) -> float:
        above = sum((p - f) * n for p, f, n in zip(pose.position, self.foot, self.normal, strict=True))
        rate = -sum(v * n for v, n in zip(pose.velocity, self.normal, strict=True))
        depth = max(self.top - above, 0.0)
        return float(max(self.stiffness * depth**self.exponent * (1.0 + self.damping * rate), 0.0))

    def step(self, pose: Pose | None, *, dt: float) -> Contact:
        if self.port == EMULATOR and pose is not None:
            self.pressed = self._press_bone(pose)
        sample = self.talk((), dt)
        self.clock += dt
        force = 0.0
        if sample is not None and self._has_expired(sample.time):
            self.expired += 1
        elif sample is not None and sample.wrench:
            press = -sum(f * n for f, n in zip(sample.wrench[:3], self.normal, strict=True))
            if self.clock <= self.tare or (self.tare > 0.0 and not self.seen):
                if sample.time != self.last:
                    self.seen, self.last = self.seen + 1, sample.time
                    self.bias += (press - self.bias) / self.seen
            else:
                force = max(press - self.bias, 0.0)
        return Contact(
            foot=self.foot, normal=self.normal, force=force,
            compression=0.0, indentation=0.0, compression_rate=0.0, indentation_rate=0.0,
        )  # fmt: skip

    def _has_expired(self, arrival: int) -> bool:
        """Whether a sample that arrived at this time [ns] is too old to be the force now."""
        rate = self.exchange.rate
        return (time.monotonic_ns() - arrival) * 1e-9 > max(EXPIRED, 3.0 / rate if rate > 0.0 else 0.0)

    def notes(self) -> list[str]:
        """Also that the sensor is silent, and at the end for how many steps."""
        notes = super().notes()
        if not hasattr(self, "exchange") or not self.expired:
            return notes
        if not self.noted:
            self.noted = True
            notes.append("the sensor is silent: the force counts as zero until it answers again")
        if self.ended:
            self.ended = False
            notes.append(f"the force of {self.expired} of {self.steps} steps is zero, because the sensor was silent")
        return notes

    def driver(self) -> Driver:
        from palpate.drivers.sensors.netft import EmulatedNetFT
        from palpate.drivers.sensors.netft import NetFTDriver as Sensor

        if self.port != EMULATOR:
            return Sensor(self.port)
        self.emulated = EmulatedNetFT(self.sensed_wrench, self.faults)
        return self.emulated.driver()

    def stop(self) -> None:
        self.ended = True
        try:
            super().stop()
        finally:
            if hasattr(self, "emulated"):
                self.emulated.close()
