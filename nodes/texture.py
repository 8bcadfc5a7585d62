"""Texture of the surface under a sliding finger (docs/texture.md)."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.records import floats, lend_first, put, vector
from palpate.messages import Contact, Friction, Proximity, Vector3
from palpate.messages.record import array_handle
from palpate.messages.vibration import Vibration
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out, SettingError, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import SLID, slid
from palpate.nodes.base.texture_file import read_texture, tabulate_texture
from palpate.physics.device import random_numbers
from palpate.physics.device.random_numbers import seed_state
from palpate.physics.texture import surface
from palpate.physics.texture.autoregressive import coefficients, filter_sample, innovation

LONGEST = 0.1  # [s] longest block; a longer step is truncated
FRICTION, PRESS = Wants("force", "bristle", "stick", "stored"), Wants("force")
SLIP = Wants("slip", "foot", "normal", "gap")
LOCK = 2e-3  # [m] path on which a deviation of the integrated path from the place on the organ decays to 1/e
Positive, Share = msgspec.Meta(gt=0), msgspec.Meta(ge=0, le=1)


@ieee_kernel
def slide(own, friction, contact, proximity, dt):
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
    bound = own.share * min(max(lost, 0.0) / speed, size) if sliding > 0.0 else 0.0
    return sliding, bound, (v[0] / speed, v[1] / speed, v[2] / speed), moved


@ieee_kernel
def block(own, dt):
    """Number of samples that end in this step, and the time [s] of the first one from the start of the step."""
    before, due = own.begun, own.begun + dt * own.sampling
    count = int(due + 1e-6)
    own.begun = due - count if due - count > 1e-6 else 0.0
    return min(count, floats(own.samples).shape[0]), (1.0 - before) / own.sampling


@ieee_kernel
def send(own, friction, count, bound, direction, amplitude, sliding, dt, first, out, vibration):
    """Scale, limit and send the samples; add their mean to the friction."""
    samples, upright, total, before = floats(own.samples), floats(own.upright), 0.0, own.amplitude
    for i in range(count):
        scale = before + (amplitude - before) * min((first + i / own.sampling) / dt, 1.0)
        samples[i] = min(max(samples[i] * scale, -bound), bound)
        total += samples[i]
        upright[i] = own.normal * samples[i]
    own.amplitude = amplitude
    mean, f = total / count if count > 0 else 0.0, vector(friction.force)
    put(out.force, (f[0] + mean * direction[0], f[1] + mean * direction[1], f[2] + mean * direction[2]))
    put(out.bristle, vector(friction.bristle))
    out.stick, out.stored.count = friction.stick, friction.stored.count
    out.stored.values[0] = friction.stored.values[0]
    lend_first(vibration.lateral, own.samples, count)
    lend_first(vibration.normal, own.upright, count if own.normal > 0.0 else 0)
    vibration.sampling, vibration.speed = own.sampling, sliding


@kernel
def _silent(own, friction, contact, out, vibration):
    """Whether a step without contact would change nothing."""
    if contact.force > 0.0 or own.amplitude != 0.0 or own.begun != 0.0 or vibration.speed != 0.0:
        return False
    stored = friction.stored.values[0] if friction.stored.count > 0 else 0.0
    same = own.stored == stored and out.stick == friction.stick and vector(own.bristle) == vector(friction.bristle)
    return same and vector(out.force) == vector(friction.force)


class _TextureNode(CompiledNode):
    """Settings of all textures. The output is the friction plus the mean of each block.

    share   upper limit of the fluctuation, as a share of the dissipative part of the friction
    normal  ratio of the fluctuations of normal and lateral force; only readers of `Vibration` feel it, not the hand
    onset   the fluctuation grows with the sliding speed up to this speed
    """

    share: Annotated[float, "1", Share] = 0.9
    normal: Annotated[float, "1", msgspec.Meta(ge=0, le=10)] = 0.0
    onset: Annotated[float, "m/s", Positive] = 2e-3

    State = {"samples": ARRAY, "upright": ARRAY, "bristle": (3,), "stored": (), "begun": (), "amplitude": (),
             "motion": SLID}  # fmt: skip
    """One block of samples, lateral and normal [N]; bristle deflection [m] and energy [J] of the last step; elapsed
    fraction of the current sample; last amplitude [N]; sample of the position."""

    def start(self) -> None:
        super().start()
        self.own["motion"]["sampled"] = -1

    @kernel
    def idle(own, friction, contact, proximity, out, vibration, dt):
        if not _silent(own, friction, contact, out, vibration):
            return False
        slid(own.motion, proximity, dt)
        return True

    def room(self, sampling: float) -> None:
        """Allocate blocks for this sampling rate [Hz]."""
        for name in ("samples", "upright"):
            self.hold(name, np.zeros(math.ceil(LONGEST * sampling) + 1))


class Spectral(_TextureNode):
    """A surface texture by its spatial spectrum, its wavelength or a measured profile.

    The fluctuation is phi(s) f_n, with the slip path s and the normal force f_n: a spatial frequency k is felt at k
    times the sliding speed. Between the steps of the graph it is sampled at the rate `sampling`. There are two kinds of
    map. A *relief* has heights, and phi is its slope: the force of a slope does not depend on the direction of motion,
    so a bump resists in front of its top and pushes behind it, forth and back. A *friction map* is a fluctuation of the
    coefficient of friction: its force opposes the motion, so it changes its sign with the direction.

    spectrum        points of (spatial frequency [1/m], relative power density), with power laws between them
    wavelength      wavelength of a sinusoidal grating, instead of the spectrum; 0: no grating
    profile         CSV file with s,height [m], a relief, or s,friction [m, 1], a friction map, instead of the spectrum
    map             kind of the spectrum and the wavelength; a profile's columns determine its kind
    shortest        shortest wavelength of the profile that is resolved
    roughness       rms of the fluctuation over the normal force at 1 N and 0.1 m/s; 0 with a profile: as measured
    force_exponent, speed_exponent  exponents of the normal force and the sliding speed in the amplitude
    direction       direction along which the surface varies. The surface is then fixed to the organ: s is the
                    coordinate of the contact along it, also after a lift. Zero: s is the accumulated slip
    speed           highest expected sliding speed
    """

    spectrum: Annotated[tuple[tuple[float, float], ...], "1/m, 1"] = ((50.0, 1.0), (200.0, 1.0), (2000.0, 0.01))
    wavelength: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    profile: Annotated[str, "1"] = ""
    map: Annotated[Literal["friction", "relief"], "1"] = "friction"
    shortest: Annotated[float, "m", Positive] = 0.2e-3
    roughness: Annotated[float, "1", msgspec.Meta(ge=0, le=10)] = 0.05
    force_exponent: Annotated[float, "1", msgspec.Meta(ge=0, le=3)] = 1.0
    speed_exponent: Annotated[float, "1", msgspec.Meta(ge=0, le=3)] = 0.0
    direction: Annotated[Vector3, "1"] = (0.0, 0.0, 0.0)
    speed: Annotated[float, "m/s", Positive] = 0.3
    sampling: Annotated[float, "Hz", msgspec.Meta(ge=100, le=1e5)] = 10e3
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1)] = 0

    State = _TextureNode.State | {"table": ARRAY, "spacing": (), "place": (), "fastest": (), "axis": (3,), "late": bool,
                                   "ahead": (), "relief": bool, "pressed": bool}  # fmt: skip
    """One period [1] and its spacing [m]; position in it [m]; highest speed [m/s], above which the texture is silent;
    unit direction; path since the last sample of the position, at its speed [m]; whether it is a relief; whether the
    finger pressed in the last step."""

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
        if self.fit < self.speed:
            raise SettingError(
                f"setting 'speed' [m/s]: at {self.speed:g} it reaches {self.finest * self.speed:.4g} Hz, beyond half "
                f"of 'sampling', {0.5 * self.sampling:g} Hz. The highest speed that fits is {self.fit:.4g} m/s; "
                f"or sample at {2.0 * self.finest * self.speed:.4g} Hz or more"
            )

    @property
    def finest(self) -> float:
        """Highest spatial frequency [1/m]."""
        return (
            1.0 / self.wavelength if self.wavelength else 1.0 / self.shortest if self.profile else self.spectrum[-1][0]
        )

    @property
    def fit(self) -> float:
        """Highest sliding speed [m/s] without aliasing."""
        return 0.5 * self.sampling / self.finest

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

    def start(self) -> None:
        super().start()
        table, spacing = self.period()
        self.room(self.sampling)
        self.hold("table", table)
        self.own["spacing"], self.own["fastest"] = spacing, self.fit
        length = math.sqrt(sum(each * each for each in self.direction))
        self.own["axis"] = [each / length for each in self.direction] if length else 0.0
        self.own["relief"] = self.is_relief

    def notes(self) -> list[str]:
        if hasattr(self, "own") and self.own["late"]:
            self._note_once(f"Spectral: the finger slid faster than {self.fit:.3g} m/s, the highest speed that fits "
                            f"{self.sampling:g} Hz; the texture was silent there")  # fmt: skip
        return super().notes()

    @kernel
    def idle(own, friction, contact, proximity, out, vibration, dt):
        if own.pressed or not _silent(own, friction, contact, out, vibration):
            return False
        slid(own.motion, proximity, dt)
        return True

    @ieee_kernel
    def compute(
        own, friction: Annotated[Friction, FRICTION], contact: Annotated[Contact, PRESS],
        proximity: Annotated[Proximity, SLIP], out: Out[Friction], vibration: Out[Vibration], dt,
    ):  # fmt: skip
        dt = min(dt, LONGEST)
        sliding, bound, d, moved = slide(own, friction, contact, proximity, dt)
        count, first = block(own, dt)
        samples, table = floats(own.samples), floats(own.table)
        n, x, along, facing = len(table), own.axis, sliding, 1.0
        if x[0] != 0.0 or x[1] != 0.0 or x[2] != 0.0:
            # Speed along the axis; the share of a slope's force, which lies along the axis, in the direction of slip.
            cosine = x[0] * d[0] + x[1] * d[1] + x[2] * d[2]
            along, facing = sliding * cosine, cosine if own.relief else 1.0
        # While a network repeats the last position, the vibration continues at the last speed; the next position
        # replaces this path.
        if moved > 0.0:
            own.place += along * (moved - dt) - own.ahead
        own.ahead = own.ahead + along * dt if moved == 0.0 else 0.0
        landed = contact.force > 0.0 and not own.pressed
        own.pressed = contact.force > 0.0
        if (moved > 0.0 or landed) and (x[0] != 0.0 or x[1] != 0.0 or x[2] != 0.0):
            # The skin at the contact lags the foot point by the deflection of the bristles.
            at, z = proximity.foot, friction.bristle
            apart = x[0] * (at[0] - z[0]) + x[1] * (at[1] - z[1]) + x[2] * (at[2] - z[2]) - along * dt - own.place
            apart -= math.floor(apart / (n * own.spacing) + 0.5) * (n * own.spacing)
            own.place += apart if landed else apart * min(abs(along) * dt / LOCK, 1.0)
        # Sample the periodic profile by linear interpolation, and advance the position in it.
        for i in range(count):
            place = (own.place + along * (first + i / own.sampling)) / own.spacing
            whole = math.floor(place)
            k = int(whole) % n
            samples[i] = table[k] + (place - whole) * (table[k + 1 if k + 1 < n else 0] - table[k])
        own.place += along * dt
        own.place -= math.floor(own.place / (n * own.spacing)) * (n * own.spacing)
        # Amplitude A = f_n^p (v/0.1)^q min(v/onset, 1).
        own.late = own.late or sliding > own.fastest
        amplitude = contact.force * min(sliding / own.onset, 1.0) if sliding <= own.fastest else 0.0
        if own.force_exponent != 1.0 and amplitude > 0.0:
            amplitude *= contact.force ** (own.force_exponent - 1.0)
        if own.speed_exponent != 0.0 and amplitude > 0.0:
            amplitude *= (sliding / 0.1) ** own.speed_exponent
        send(own, friction, count, bound, d, amplitude * facing, sliding, dt, first, out, vibration)


class Autoregressive(_TextureNode):
    """A texture by models of recorded vibrations over sliding speed and normal force.

    model   file of `palpate fit texture`, or a model set (.xml) of the Penn Haptic Texture Toolkit
    mass    [kg] that turns a recorded acceleration into a force
    seed    seed of the noise that the models filter

    Line spectral frequencies and rms are interpolated between the models. Outside their range the nearest model is
    used; below its lowest speed or force the fluctuation falls in proportion.
    """

    model: Annotated[str, "1"]
    mass: Annotated[float, "kg", Positive] = 0.02
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1)] = 0

    State = _TextureNode.State | {
        "sampling": (), "unit": (), "speeds": ARRAY, "forces": ARRAY, "table": array_handle(3), "row": ARRAY,
        "a": ARRAY, "work": TABLE, "past": ARRAY, "newest": int, "random": random_numbers.STATE,
    }  # fmt: skip
    """Data of the model file; interpolated LSF and rms; coefficients; ring buffer of past samples; noise generator."""

    def start(self) -> None:
        super().start()
        try:
            texture = read_texture(Path(self.model))
        except (OSError, ValueError) as error:
            raise SettingError(f"setting 'model': {self.model}: {error}") from None
        speeds, forces, table = tabulate_texture(texture)
        order = table.shape[2] - 1
        self.room(texture.sampling)
        held = {"speeds": speeds, "forces": forces, "table": table, "row": np.zeros(order + 1)}
        held |= {"a": np.zeros(order), "work": np.zeros((2, order + 2)), "past": np.zeros(order)}
        for name, array in held.items():
            self.hold(name, np.ascontiguousarray(array))
        self.own["sampling"], self.own["random"] = texture.sampling, seed_state(self.seed)
        self.own["unit"] = self.mass if texture.quantity == "acceleration" else 1.0

    @ieee_kernel
    def compute(
        own, friction: Annotated[Friction, FRICTION], contact: Annotated[Contact, PRESS],
        proximity: Annotated[Proximity, SLIP], out: Out[Friction], vibration: Out[Vibration], dt,
    ):  # fmt: skip
        dt = min(dt, LONGEST)
        sliding, bound, d, _ = slide(own, friction, contact, proximity, dt)
        count, first = block(own, dt)
        samples, row, amplitude = floats(own.samples), floats(own.row), 0.0
        if sliding > 0.0:
            # Interpolate line spectral frequencies and rms bilinearly over speed and force.
            speeds, forces, table = floats(own.speeds), floats(own.forces), floats(own.table)
            i, u = cell(speeds, sliding)
            j, w = cell(forces, contact.force)
            i1, j1 = min(i + 1, len(speeds) - 1), min(j + 1, len(forces) - 1)
            for k in range(len(row)):
                low = table[i, j, k] + u * (table[i1, j, k] - table[i, j, k])
                high = table[i, j1, k] + u * (table[i1, j1, k] - table[i, j1, k])
                row[k] = low + w * (high - low)
            # Convert them to coefficients of a filter with output variance 1, and filter white noise.
            a, work, past = floats(own.a), floats(own.work), floats(own.past)
            coefficients(row[: len(a)], work[0], work[1], a)
            gain = innovation(a, work[0])
            for k in range(count):
                samples[k], own.newest = filter_sample(a, gain, past, own.newest, own.random)
            amplitude = (
                own.unit * row[len(a)] * min(sliding / own.onset, sliding / speeds[0], contact.force / forces[0], 1.0)
            )
        send(own, friction, count, bound, d, amplitude, sliding, dt, first, out, vibration)


@ieee_kernel
def cell(line, x):
    """Cell of x in an ascending, evenly spaced row (n), and the fraction [1] of the cell below x."""
    n = len(line)
    if n < 2:
        return 0, 0.0
    place = min(max((x - line[0]) / (line[n - 1] - line[0]) * (n - 1), 0.0), n - 1.0)
    i = min(int(place), n - 2)
    return i, place - i
