"""What all bristle laws share: the deflection z lies in the tangent plane of a surface that turns under the finger.

A law is a NamedTuple in a file of its own: its fields are its settings, `Annotated[type, unit, limit]` with a default,
and its attribute `advance` is a kernel

    advance(law, z, v, load, dt) -> (z [m] (3), force [N] (3), stick)

of the deflection before the step, the slip velocity [m/s] (3), both tangential, the normal force [N] > 0 and the step
[s] > 0. `law` has the settings; one that is a word is its place among the words. A law may have

    play                  a setting [m]; `advance` then takes a sixth argument, the path [m] that wears the bristles:
                          that of a point which the finger drags on a string of this length. A finger that wanders by
                          less, as one that is measured by an encoder does, strains the bristles but does not wear them
    stored(law, z, load)  a kernel: the energy [J] that the bristles hold; the ledger then reports what is dissipated
    rescale               a setting; True: a load that rises gives the bristles no energy beyond what it took from them
                          as it fell (needs `stored`)
    caution()             which settings let it generate energy, a line that the user sees; "" where none does
"""

import math
from functools import cache
from typing import Any

from palpate.physics.kernel import Kernel, kernel

NOTHING, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


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


@kernel
def _taut(law, slack, a, b, v, dt):
    """`drag` for a law without play: nothing is worn by it."""
    return NOTHING, 0.0


@kernel
def _played(law, slack, a, b, v, dt):
    return drag(slack, a, b, v, dt, law.play)


@cache
def stepper(kind: type[Any]) -> Kernel:
    """The kernel of one step of a law:

        step(law, z, a, last, slack, spare, b, slip, load, dt) -> (z, b, load, slack, spare, force [N] (3), sticks)

    z      [m]   (3)  deflection;  a [1] (3), last [N]: normal and load that it was found under
    slack  [m]   (3)  the finger's place from the point that it drags
    spare  [J]        energy that a falling load has taken from the bristles and may give back
    b      [1]   (3)  normal now;  slip [m/s] (3);  load [N];  dt [s]

    Without load the bristles are forgotten and the force is zero; such a contact does not stick.
    """
    worn, rescales = "play" in kind._fields, "rescale" in kind._fields
    advanced, dragged, unrising = kind.advance, _played if worn else _taut, _rescaled(kind) if rescales else None

    @kernel(error_model="numpy")
    def plain(law, z, v, last, spare, load, dt, path):
        z, force, stick = advanced(law, z, v, load, dt)
        return z, force, stick, spare

    @kernel(error_model="numpy")
    def wearing(law, z, v, last, spare, load, dt, path):
        z, force, stick = advanced(law, z, v, load, dt, path)
        return z, force, stick, spare

    answer = unrising or (wearing if worn else plain)

    @kernel(error_model="numpy")
    def step(law, z, a, last, slack, spare, b, slip, load, dt):
        if not load > 0.0:
            return NOTHING, UP, 0.0, NOTHING, 0.0, NOTHING, False
        z, v = carry(z, a, b, slip)
        slack, path = dragged(law, slack, a, b, v, dt)
        z, force, stick, spare = answer(law, z, v, last, spare, load, dt, path)
        return z, b, load, slack, spare, force, stick

    return step


def _rescaled(kind: type[Any]) -> Kernel:
    """`advance` of a law whose bristles shrink where a load that rises would give them energy, beyond what it took from
    them as it fell, E = `spare`: where D(1) + E < 0, the answer for bristles s z, s < 1:

        D(s) + E = f(s).v T + V(z, f_last) - V(z+(s), f_n) + E >= 0

    At s = sqrt(f_last/f_n) the bristles hold under the new load what they held under the last one, so that D >= 0 for a
    law that is passive under constant load. Between that and s = 1 LuGre's D is concave: the zero of the chord of D + E
    has D + E >= 0 too.
    """
    advance, stored, worn = kind.advance, kind.stored, "play" in kind._fields

    @kernel(error_model="numpy")
    def plain(law, z, v, load, dt, path):
        return advance(law, z, v, load, dt)

    @kernel(error_model="numpy")
    def wearing(law, z, v, load, dt, path):
        return advance(law, z, v, load, dt, path)

    answer = wearing if worn else plain

    @kernel(error_model="numpy")
    def scaled(law, s, z, v, last, load, dt, path):
        """The answer for s z, and D of it."""
        after, force, stick = answer(law, (s * z[0], s * z[1], s * z[2]), v, load, dt, path)
        work = dt * (force[0] * v[0] + force[1] * v[1] + force[2] * v[2])
        return after, force, stick, work + stored(law, z, last) - stored(law, after, load)

    @kernel(error_model="numpy")
    def rescaled(law, z, v, last, spare, load, dt, path):
        after, force, stick, here = scaled(law, 1.0, z, v, last, load, dt, path)
        if not (law.rescale and last > 0.0 and load != last):
            return after, force, stick, spare
        if load > last:
            if here + spare < 0.0:
                one, least = here + spare, math.sqrt(last / load)
                after, force, stick, here = scaled(law, least, z, v, last, load, dt, path)
                there = here + spare
                if there > 0.0:
                    s = least + (1.0 - least) * there / (there - one)
                    chord, pushed, stuck, dissipated = scaled(law, s, z, v, last, load, dt, path)
                    if dissipated + spare >= 0.0:
                        after, force, stick, here = chord, pushed, stuck, dissipated
            spare = max(spare + min(here, 0.0), 0.0)
        else:
            spare += stored(law, z, last) - stored(law, z, load)
        # No more than the bristles hold: many falls must not pay for one large rise.
        return after, force, stick, min(spare, stored(law, after, load))

    return rescaled
