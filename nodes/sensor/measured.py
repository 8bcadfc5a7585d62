"""Real force sensors, for the force of a real indentation."""

from typing import Annotated, Any, ClassVar

import msgspec

from palpate.drivers.exchange import Driver
from palpate.messages import Contact, Pose, Vector3
from palpate.nodes.base.wired import EMULATOR, Wired
from palpate.nodes.sensor.force_sensor import direction

Wrench = tuple[float, ...]


class NetFT(Wired):
    """ATI's Net F/T on the network: the force of a press against `normal`. Settings:

    port    its address, 192.168.1.1 by default of the manufacturer; `emulator`: an emulated sensor
    normal  out of the sensor's face, in the frame of the sensor; a press is a force against it
    foot    position of the sensor in the world
    tare    [s] time without contact at the start; its mean force is subtracted. It lasts at least until a sample

    While the sensor reports an error, or its last sample is older than 20 ms, or than 3 of its periods if longer, the
    force is 0, and a note counts these samples or steps.

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
        if sample is not None and sample.wrench:
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

    def driver(self) -> Driver:
        from palpate.drivers.sensors.netft import EmulatedNetFT
        from palpate.drivers.sensors.netft import NetFTDriver as Sensor

        if self.port != EMULATOR:
            return Sensor(self.port)
        self.emulated = EmulatedNetFT(self.sensed_wrench, self.faults)
        return self.emulated.driver()

    def stop(self) -> None:
        try:
            super().stop()
        finally:
            if hasattr(self, "emulated"):
                self.emulated.close()
