"""The texture of a scene's surface, for every node that needs it, and the path of a sliding finger on it."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.records import put, vector
from palpate.messages import Proximity, Vector3
from palpate.nodes.base.compiled import CompiledNode
from palpate.nodes.base.effect import Agrees
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.node import SettingError, Wants
from palpate.nodes.base.samples import SLID, slid
from palpate.physics.texture import surface

FRICTION, SLIP = Wants("force", "bristle", "stick", "stored"), Wants("slip", "foot", "normal", "gap")
LOCK = 2e-3  # [m] path on which a deviation of the integrated path from the place on the organ decays to 1/e
Positive = msgspec.Meta(gt=0)
SLIDES = {"bristle": (3,), "stored": (), "motion": SLID}
"""State of `slide`: bristle deflection [m] and energy [J] of the last step; sample of the position."""
PATH = {"place": (), "axis": (3,), "ahead": (), "pressed": bool}
"""State of `meet` and `advance`: position in the period [m]; unit direction of the texture, 0: none; path since the
last sample of the position, at its speed [m]; whether the finger pressed in the last step."""


class WithTexture(CompiledNode):
    """Settings of a node that needs the texture of the surface; all these nodes of a finger have the same values."""

    spectrum: Annotated[tuple[tuple[float, float], ...], "1/m, 1", Agrees(Proximity)] = (
        (50.0, 1.0), (200.0, 1.0), (2000.0, 0.01),
    )  # fmt: skip
    wavelength: Annotated[float, "m", msgspec.Meta(ge=0), Agrees(Proximity)] = 0.0
    profile: Annotated[str, "1", Agrees(Proximity)] = ""
    map: Annotated[Literal["friction", "relief"], "1", Agrees(Proximity)] = "friction"
    shortest: Annotated[float, "m", Positive, Agrees(Proximity)] = 0.2e-3
    roughness: Annotated[float, "1", msgspec.Meta(ge=0, le=10), Agrees(Proximity)] = 0.05
    direction: Annotated[Vector3, "1", Agrees(Proximity)] = (0.0, 0.0, 0.0)
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1), Agrees(Proximity)] = 0

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        points = np.array(self.spectrum).reshape(-1, 2)
        good = len(points) > 1 and ((points > 0.0) & np.isfinite(points)).all() and (np.diff(points[:, 0]) > 0.0).all()
        if self.wavelength and self.profile:
            raise SettingError("settings 'wavelength' and 'profile': found both, expected one")
        if not (self.wavelength or self.profile or good):
            raise SettingError(
                f"setting 'spectrum' [1/m, 1]: found {self.spectrum}, expected two or more pairs of a rising spatial "
                "frequency > 0 and a power density > 0"
            )

    @property
    def finest(self) -> float:
        """Highest spatial frequency [1/m]."""
        return (
            1.0 / self.wavelength if self.wavelength else 1.0 / self.shortest if self.profile else self.spectrum[-1][0]
        )

    @property
    def is_relief(self) -> bool:
        """Whether the fluctuation is the slope of heights, and not one of friction. SettingError: cannot be read."""
        try:
            return surface.has_heights(Path(self.profile)) if self.profile else self.map == "relief"
        except (OSError, ValueError) as error:
            raise SettingError(f"setting 'profile': {self.profile}: {error}") from None

    def period(self) -> tuple[np.ndarray, float]:
        """One period (n) [1] of the fluctuation over the normal force, and its spacing [m].

        SettingError: the profile or the spectrum cannot be used.
        """
        try:
            if self.profile:
                return surface.profile(Path(self.profile), self.roughness, self.shortest)
            if self.wavelength:
                return surface.grating(self.wavelength, self.roughness)
            return surface.random_surface(np.array(self.spectrum), self.roughness, self.seed)
        except (OSError, ValueError) as error:
            name = "profile" if self.profile else "spectrum"
            raise SettingError(f"setting {name!r}: {self.profile or self.spectrum}: {error}") from None

    @property
    def unit_direction(self) -> Vector3:
        """Unit vector of `direction`; 0 without one."""
        length = math.sqrt(sum(each * each for each in self.direction))
        x, y, z = self.direction
        return (x / length, y / length, z / length) if length else (0.0, 0.0, 0.0)


@ieee_kernel
def slide(own, share, friction, contact, proximity, dt):
    """Sliding speed [m/s], bound of the fluctuation [N], sliding direction (3) [1], and time [s] since the last sample
    of the position, 0 if it is repeated.

    With friction f, slip velocity v, time step T and bristle energy V, the bound is a share of the dissipative part of
    friction, (f.v T - dV)/|v T| <= |f|. Friction plus fluctuation therefore dissipates for every texture.
    """
    moved, v = slid(own.motion, proximity, dt)
    z, f, dt = vector(friction.bristle), vector(friction.force), moved if moved > 0.0 else dt
    stored = friction.stored.values[0] if friction.stored.count > 0 else 0.0
    released, speed = own.stored - stored, math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    strained = v[0] * (z[0] - own.bristle[0]) + v[1] * (z[1] - own.bristle[1]) + v[2] * (z[2] - own.bristle[2])
    put(own.bristle, z)
    own.stored = stored
    if friction.stick or not contact.force > 0.0 or not speed * dt > 0.0:
        return 0.0, 0.0, (0.0, 0.0, 0.0), moved
    sliding = min(max(speed - strained / (speed * dt), 0.0), speed)
    lost = f[0] * v[0] + f[1] * v[1] + f[2] * v[2] + released / dt  # [W]
    size = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
    bound = share * min(max(lost, 0.0) / speed, size) if sliding > 0.0 else 0.0
    return sliding, bound, (v[0] / speed, v[1] / speed, v[2] / speed), moved


@ieee_kernel
def meet(own, along, moved, dt, contact, proximity, friction, period):
    """Set `own.place` [m] at the start of this step to where the skin is on the texture, which moves by `along` [m/s].

    moved   [s]  time since the last sample of the position, 0 if it is repeated;  period [m] of the texture
    """
    x = own.axis
    # While a network repeats the last position, the motion continues at the last speed; the next position replaces
    # this path.
    if moved > 0.0:
        own.place += along * (moved - dt) - own.ahead
    own.ahead = own.ahead + along * dt if moved == 0.0 else 0.0
    landed = contact.force > 0.0 and not own.pressed
    own.pressed = contact.force > 0.0
    if (moved > 0.0 or landed) and (x[0] != 0.0 or x[1] != 0.0 or x[2] != 0.0):
        # The skin at the contact lags the foot point by the deflection of the bristles.
        at, z = proximity.foot, friction.bristle
        apart = x[0] * (at[0] - z[0]) + x[1] * (at[1] - z[1]) + x[2] * (at[2] - z[2]) - along * dt - own.place
        apart -= math.floor(apart / period + 0.5) * period
        own.place += apart if landed else apart * min(abs(along) * dt / LOCK, 1.0)


@ieee_kernel
def advance(own, path, period):
    """Move `own.place` [m] by this path [m], within one period [m]."""
    own.place += path
    own.place -= math.floor(own.place / period) * period
