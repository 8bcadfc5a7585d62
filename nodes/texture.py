"""Texture of the surface under a sliding finger (docs/texture.md)."""

import math
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.records import floats, lend_first, put, vector
from palpate.messages import Contact, Friction, Proximity
from palpate.messages.record import array_handle
from palpate.messages.vibration import Vibration
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out, SettingError, Wants
from palpate.nodes.base.kernels import ieee_kernel, kernel
from palpate.nodes.base.samples import slid
from palpate.nodes.base.texture_file import read_texture, tabulate_texture
from palpate.nodes.base.textured import FRICTION, PATH, SLIDES, SLIP, WithTexture, advance, meet, slide
from palpate.physics.device import random_numbers
from palpate.physics.device.random_numbers import seed_state
from palpate.physics.texture.autoregressive import coefficients, filter_sample, innovation

LONGEST = 0.1  # [s] longest block; a longer step is truncated
PRESS = Wants("force")
Positive, Share = msgspec.Meta(gt=0), msgspec.Meta(ge=0, le=1)


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

    State = {"samples": ARRAY, "upright": ARRAY, "begun": (), "amplitude": ()} | SLIDES
    """One block of samples, lateral and normal [N]; elapsed fraction of the current sample; last amplitude [N]."""

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


class Spectral(_TextureNode, WithTexture):
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

    force_exponent: Annotated[float, "1", msgspec.Meta(ge=0, le=3)] = 1.0
    speed_exponent: Annotated[float, "1", msgspec.Meta(ge=0, le=3)] = 0.0
    speed: Annotated[float, "m/s", Positive] = 0.3
    sampling: Annotated[float, "Hz", msgspec.Meta(ge=100, le=1e5)] = 10e3

    State = _TextureNode.State | PATH | {"table": ARRAY, "spacing": (), "fastest": (), "late": bool, "relief": bool}
    """One period [1] and its spacing [m]; highest speed [m/s], above which the texture is silent; whether it is a
    relief."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        if self.fit < self.speed:
            raise SettingError(
                f"setting 'speed' [m/s]: at {self.speed:g} it reaches {self.finest * self.speed:.4g} Hz, beyond half "
                f"of 'sampling', {0.5 * self.sampling:g} Hz. The highest speed that fits is {self.fit:.4g} m/s; "
                f"or sample at {2.0 * self.finest * self.speed:.4g} Hz or more"
            )

    @property
    def fit(self) -> float:
        """Highest sliding speed [m/s] without aliasing."""
        return 0.5 * self.sampling / self.finest

    def start(self) -> None:
        super().start()
        table, spacing = self.period()
        self.room(self.sampling)
        self.hold("table", table)
        self.own["spacing"], self.own["fastest"] = spacing, self.fit
        self.own["axis"] = self.unit_direction
        self.own["relief"] = self.is_relief

    def notes(self) -> list[str]:
        if self.known["late"]:
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
        sliding, bound, d, moved = slide(own, own.share, friction, contact, proximity, dt)
        count, first = block(own, dt)
        samples, table = floats(own.samples), floats(own.table)
        n, x, along, facing = len(table), own.axis, sliding, 1.0
        if x[0] != 0.0 or x[1] != 0.0 or x[2] != 0.0:
            # Speed along the axis; the share of a slope's force, which lies along the axis, in the direction of slip.
            cosine = x[0] * d[0] + x[1] * d[1] + x[2] * d[2]
            along, facing = sliding * cosine, cosine if own.relief else 1.0
        meet(own, along, moved, dt, contact, proximity, friction, n * own.spacing)
        # Sample the periodic profile by linear interpolation, and advance the position in it.
        for i in range(count):
            place = (own.place + along * (first + i / own.sampling)) / own.spacing
            whole = math.floor(place)
            k = int(whole) % n
            samples[i] = table[k] + (place - whole) * (table[k + 1 if k + 1 < n else 0] - table[k])
        advance(own, along * dt, n * own.spacing)
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
        sliding, bound, d, _ = slide(own, own.share, friction, contact, proximity, dt)
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
