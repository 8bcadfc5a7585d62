"""What all bristle laws share: the deflection z lies in the tangent plane of a surface that turns under the finger.

A law is a NamedTuple in a file of its own: its fields are its settings, `Annotated[type, unit, limit]` with a default,
and its property `advance` is a compiled function

    advance(law, z, v, load, dt) -> (z [m] (3), force [N] (3), stick)

of the deflection before the step, the slip velocity [m/s] (3), both tangential, the normal force [N] > 0 and the step
[s] > 0. A law may have

    play             a setting [m]; `advance` then takes a sixth argument, the path [m] that wears the bristles: that of
                     a point which the finger drags on a string of this length. A finger that wanders by less, as one
                     that is measured by an encoder does, strains the bristles but does not wear them
    stored(z, load)  the energy [J] that the bristles hold: the ledger then reports what is dissipated
    rescale          a setting; True: a load that rises gives the bristles no energy beyond what it took from them as it
                     fell (needs `stored`)
    caution()        which settings let it generate energy, a line that the user sees; "" where none does
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, get_args, get_type_hints

from palpate.physics.entry_point import entry_point
from palpate.physics.kernel import kernel

Vector = tuple[float, float, float]
NOTHING = (0.0, 0.0, 0.0)


class Bristles(NamedTuple):
    """Deflection [m] (3), and normal [1] (3) and normal force [N] that it was found under; the finger's place from the
    point that it drags [m] (3); the energy [J] that a falling load has taken from the bristles and may give back."""

    z: Vector = NOTHING
    normal: Vector = (0.0, 0.0, 1.0)
    load: float = 0.0
    slack: Vector = NOTHING
    spare: float = 0.0


@kernel(error_model="numpy")
def turn(zx, zy, zz, ax, ay, az, bx, by, bz):
    """z [m], tangent to the unit normal a, rotated by the smallest rotation that takes a to b; length kept.

    For b = -a, where that rotation is not unique, z is the axis and stays.
    """
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    # R z = z - (z.b)/(1 + a.b) (a + b) for z perpendicular to a.
    lean = (zx * bx + zy * by + zz * bz) / max(1.0 + ax * bx + ay * by + az * bz, 1e-12)
    x, y, z = zx - lean * (ax + bx), zy - lean * (ay + by), zz - lean * (az + bz)
    # Take away what rounding, or a normal that is not quite unit, leaves along b.
    lift = x * bx + y * by + z * bz
    x, y, z = x - lift * bx, y - lift * by, z - lift * bz
    rest = math.sqrt(x * x + y * y + z * z)
    if not rest > 0.0:
        return 0.0, 0.0, 0.0
    scale = length / rest
    return x * scale, y * scale, z * scale


@kernel(error_model="numpy")
def carry(z, a, b, slip):
    """Deflection z [m] (3), tangent to the last normal a [1] (3), under this normal b; tangential slip [m/s] (3)."""
    along = slip[0] * b[0] + slip[1] * b[1] + slip[2] * b[2]
    v = (slip[0] - along * b[0], slip[1] - along * b[1], slip[2] - along * b[2])
    return turn(z[0], z[1], z[2], a[0], a[1], a[2], b[0], b[1], b[2]), v


@kernel
def drag(slack, a, b, v, dt, play):
    """The finger's place [m] (3) from a point that it drags on a string of the length `play` [m], and the point's path
    [m], after a step of v dt; the normal turns from a to b."""
    x, y, z = turn(slack[0], slack[1], slack[2], a[0], a[1], a[2], b[0], b[1], b[2])
    x, y, z = x + v[0] * dt, y + v[1] * dt, z + v[2] * dt
    length = math.sqrt(x * x + y * y + z * z)
    if length <= play:
        return (x, y, z), 0.0
    keep = play / length
    return (keep * x, keep * y, keep * z), length - play


@dataclass(frozen=True, slots=True)
class Kernel:
    """A law as `step` takes it.

    carry, advance  compiled
    """

    law: Any  # with each choice of words as its place among them: numbers are all that `advance` takes
    carry: Callable[..., tuple[Vector, Vector]]
    advance: Callable[..., tuple[Vector, Vector, bool]]
    stored: Callable[[Vector, float], float] | None  # of the law, None where it has none
    rescale: bool  # whether a load that rises gives the bristles no energy but `spare`
    drag: Callable[..., tuple[Vector, float]] | None  # compiled; None for a law without play
    play: float  # [m]


def kernel_form(law: Any) -> Kernel:
    """The law as `step` takes it."""
    hints = get_type_hints(type(law))
    law = law._replace(**{k: get_args(hints[k]).index(v) for k, v in law._asdict().items() if isinstance(v, str)})
    worn = hasattr(law, "play")
    return Kernel(
        law,
        entry_point(carry, NOTHING, NOTHING, NOTHING, NOTHING),
        entry_point(law.advance, law, NOTHING, NOTHING, 1.0, 1.0, *(1.0,) * worn),
        getattr(law, "stored", None),
        getattr(law, "rescale", False),
        entry_point(drag, NOTHING, NOTHING, NOTHING, NOTHING, 1.0, 1.0) if worn else None,
        law.play if worn else 0.0,
    )


def step(kernel: Kernel, before: Bristles, normal: Vector, slip: Vector, load: float, dt: float):
    """One step of a law: (bristles, force [N] (3), whether it sticks).

    Without load the bristles are forgotten and the force is zero; such a contact does not stick.
    """
    if not load > 0.0:
        return Bristles(), NOTHING, False
    z, v = kernel.carry(before.z, before.normal, normal, slip)
    slack: Vector = NOTHING
    wear: tuple[float, ...] = ()
    if kernel.drag is not None:
        slack, path = kernel.drag(before.slack, before.normal, normal, v, dt, kernel.play)
        wear = (path,)
    answer = kernel.advance(kernel.law, z, v, load, dt, *wear)
    last, spare = before.load, before.spare
    if kernel.rescale and last > 0.0 and load != last:
        if load > last:
            here = _dissipated(kernel, answer, z, last, v, load, dt)
            if here + spare < 0.0:
                answer, here = _without_gain(kernel, answer, here, spare, z, last, v, load, dt, wear)
            spare = max(spare + min(here, 0.0), 0.0)
        else:
            spare += kernel.stored(z, last) - kernel.stored(z, load)
        # No more than the bristles hold: many falls must not pay for one large rise.
        spare = min(spare, kernel.stored(answer[0], load))
    z, force, stick = answer
    return Bristles(z, normal, load, slack, spare), force, stick


def _dissipated(kernel, answer, z, last, v, load, dt):
    """D = f.v T + V(z, f_last) - V(z+, f_n) [J], of an answer of `advance`, where the load was `last` [N] before."""
    after, force, _ = answer
    work = dt * (force[0] * v[0] + force[1] * v[1] + force[2] * v[2])
    return work + kernel.stored(z, last) - kernel.stored(after, load)


def _without_gain(kernel, answer, here, spare, z, last, v, load, dt, wear):
    """The answer for bristles s z, s < 1, and its D, where that of `advance` gives more energy than it takes and than
    is to spare, D(1) + E < 0 with D(1) = `here`, E = `spare`:

        D(s) + E = f(s).v T + V(z, f_last) - V(z+(s), f_n) + E >= 0

    At s = sqrt(f_last/f_n) the bristles hold under the new load what they held under the last one, so that D >= 0 for a
    law that is passive under constant load. Between that and s = 1 LuGre's D is concave: the zero of the chord of D + E
    has D + E >= 0 too.
    """

    def scaled(s):
        answer = kernel.advance(kernel.law, (s * z[0], s * z[1], s * z[2]), v, load, dt, *wear)
        return answer, _dissipated(kernel, answer, z, last, v, load, dt)

    least = math.sqrt(last / load)
    lowest = scaled(least)
    there = lowest[1] + spare
    if not there > 0.0:
        return lowest
    chord = scaled(least + (1.0 - least) * there / (there - here - spare))
    return chord if chord[1] + spare >= 0.0 else lowest
