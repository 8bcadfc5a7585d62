"""Normal contact of fingertip and tissue."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from palpate.messages import Contact, Proximity, Surface, Vector3
from palpate.nodes.base import Node, Wants
from palpate.physics.contact import Law, exponential, hertz_exponential, power, series_step
from palpate.physics.terminal import free_recovery

__all__ = ["Probabilistic", "Series"]  # noqa: F822  (Probabilistic comes by __getattr__)

Positive = msgspec.Meta(gt=0)


def __getattr__(name: str) -> Any:
    """`contact.Probabilistic`, brought in when it is asked for: the force path does not need what it imports."""
    if name == "Probabilistic":
        from palpate.nodes.probabilistic import Probabilistic

        return Probabilistic
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


class Series(Node):
    """Fingertip and tissue in series: they share the approach and press on each other with one force
    (docs/equations/contact.md).

    The tissue answers by the terminal law of its last message. Without tissue there is nothing to press on: the force
    is zero and the fingertip recovers.
    """

    finger_law: Annotated[Literal["exponential", "power", "hertz"], "1"] = "exponential"
    finger_damping: Annotated[float, "s/m", msgspec.Meta(ge=0)] = 8.0
    finger_stiffness: Annotated[float, "N/m", Positive] = 26.2641
    """of the exponential law"""
    finger_hardening: Annotated[float, "1/m", Positive] = 1681.06
    """of the exponential law"""
    finger_power_stiffness: Annotated[float, "N/m^n", Positive] = 8.1e3
    finger_power_exponent: Annotated[float, "1", msgspec.Meta(ge=1, le=10)] = 1.5
    finger_hertz_slope: Annotated[float, "Pa/m", Positive] = 5.672e6
    finger_hertz_hardening: Annotated[float, "1/m", Positive] = 466.6
    finger_hertz_radius: Annotated[float, "m", Positive] = 9.84e-3

    def start(self) -> None:
        self.compression = 0.0
        self.last: Contact | None = None
        self._law = self._finger()
        self._solve(1e-3, 1e-3, 3e3, 1.5, 5.0, 0.0, 0.0)
        free_recovery(0.0, 0.0, self.finger_damping, 1e-3)
        self._contact((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0, 0.0, 0.0, 0.0, 0.0)

    def _finger(self) -> Law:
        if self.finger_law == "power":
            return power(self.finger_power_stiffness, self.finger_power_exponent)
        if self.finger_law == "hertz":
            return hertz_exponential(self.finger_hertz_slope, self.finger_hertz_hardening, self.finger_hertz_radius)
        return exponential(self.finger_stiffness, self.finger_hardening)

    def _solve(self, approach: float, dt: float, *body: float) -> tuple[float, float, float]:
        return series_step(approach, dt, self.compression, *self._law, self.finger_damping, *body)

    def step(
        self,
        proximity: Proximity,
        body: Annotated[Surface | None, Wants("stiffness", "exponent", "damping", "free", "previous")],
        *,
        dt: float,
    ) -> Contact:
        before = self.compression
        if not dt > 0.0:
            # A duplicate or reordered message: no time has passed, so nothing has changed.
            if self.last is None:
                self.last = self._contact(proximity.foot, proximity.normal, 0.0, 0.0, 0.0, 0.0, 0.0)
            return self.last
        if body is None:
            force, indentation, indentation_rate = 0.0, 0.0, 0.0
            self.compression = free_recovery(before, 0.0, self.finger_damping, dt)
        else:
            force, self.compression, indentation = self._solve(
                proximity.approach, dt, body.stiffness, body.exponent, body.damping, body.free, body.previous
            )
            indentation_rate = (indentation - body.previous) / dt
        rate = (self.compression - before) / dt
        self.last = self._contact(
            proximity.foot, proximity.normal, force, self.compression, indentation, rate, indentation_rate
        )
        return self.last

    @staticmethod
    def _contact(
        foot: Vector3, normal: Vector3, force: float, s1: float, s2: float, rate1: float, rate2: float
    ) -> Contact:
        return Contact(
            foot=foot,
            normal=normal,
            force=force,
            compression=s1,
            indentation=s2,
            compression_rate=rate1,
            indentation_rate=rate2,
        )
