"""Friction of the fingertip on the tissue (docs/equations/friction.md)."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Contact, Friction, Proximity
from palpate.nodes.base import Node
from palpate.physics.friction import EULER, EXPONENTIAL, coulomb_kernel, lugre_kernel

Positive = msgspec.Meta(gt=0)
UP = (0.0, 0.0, 1.0)


class _Sliding(Node):
    """What both laws share: state, the answer to a message without new time, and the form of the output."""

    def start(self) -> None:
        self._state, self._force = np.zeros(7), np.zeros(3)
        self.last = Friction(force=(0.0, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=False)
        self._advance(UP, (1e-3, 0.0, 0.0), 1.0, 1e-3)
        self._state[:] = 0.0

    def _advance(self, normal: tuple, slip: tuple, load: float, dt: float) -> bool:
        raise NotImplementedError

    def step(self, contact: Contact, proximity: Proximity, *, dt: float) -> Friction:
        if dt > 0.0:
            stick = self._advance(contact.normal, proximity.slip, contact.force, dt)
            f, z = self._force.tolist(), self._state.tolist()
            self.last = Friction(force=(f[0], f[1], f[2]), bristle=(z[0], z[1], z[2]), stick=stick)
        return self.last


class LuGre(_Sliding):
    """LuGre friction: presliding, Stribeck dip and viscous rise, in proportion to the normal force.

    The contact sticks while less than half of the finger's motion is lasting slip; it does not stick when apart. Below
    viscous = bristle_damping (mu_static - mu_slide)/mu_slide the law can give out energy.
    """

    mu_slide: Annotated[float, "1", Positive] = 0.5
    mu_static: Annotated[float, "1", Positive] = 0.7
    stribeck: Annotated[float, "m/s", Positive] = 0.02
    bristle_stiffness: Annotated[float, "1/m", Positive] = 3000.0
    bristle_damping: Annotated[float, "s/m", msgspec.Meta(ge=0)] = 1.0
    viscous: Annotated[float, "s/m", msgspec.Meta(ge=0)] = 0.4
    update: Annotated[Literal["exponential", "euler"], "1"] = "exponential"
    rescale: Annotated[bool, "1"] = False
    """shrink the bristles when the load rises, so that this gives no energy"""

    def start(self) -> None:
        self._law = (
            *(self.mu_slide, self.mu_static, self.stribeck),
            *(self.bristle_stiffness, self.bristle_damping, self.viscous),
            *(EXPONENTIAL if self.update == "exponential" else EULER, self.rescale),
        )
        super().start()

    def _advance(self, normal: tuple, slip: tuple, load: float, dt: float) -> bool:
        return lugre_kernel(self._state, normal, slip, load, dt, *self._law, self._force)


class Coulomb(_Sliding):
    """Coulomb friction with an elastic stick: a spring that slips at mu times the normal force.

    The contact sticks while the spring alone takes up the motion; it does not stick when apart.
    """

    mu: Annotated[float, "1", msgspec.Meta(ge=0)] = 0.5
    stiffness: Annotated[float, "N/m", Positive] = 1500.0

    def _advance(self, normal: tuple, slip: tuple, load: float, dt: float) -> bool:
        return coulomb_kernel(self._state, normal, slip, load, dt, self.mu, self.stiffness, self._force)
