"""The common part of all bristle laws: the deflection z is tangent to a surface whose normal changes.

A law is a NamedTuple, one per file. Its fields are its settings, `Annotated[type, unit, limit]` with a default, and its
attribute `advance` is a kernel

    advance(law, z, v, load, dt, path) -> (z [m] (3), force [N] (3), stick)

of the deflection before the step, the slip velocity [m/s] (3), both tangential, the normal force [N] > 0, the step
[s] > 0, and the path [m] of the setting `play`, else 0. `law` contains the settings; a word is given by its index among
the allowed words. Optional attributes:

    play                  setting [m]. `path` is that of a point that the finger drags on a string of this length; only
                          this path relaxes the bristles. Position noise below `play`, as from an encoder, then deflects
                          the bristles without relaxing them
    stored(law, z, load)  kernel: energy [J] stored in the bristles, from which the ledger computes dissipation
    rescale               setting. True: a rising load gives the bristles at most the energy that it took from them
                          while it fell (requires `stored`)
    stick(law, load)      spring [N/m] and damper [N s/m] of small motions in the stick, under a normal force [N]
    caution()             a warning about settings that let the law generate energy; "" for a passive law
"""

import math
from functools import cache
from typing import Any

from palpate.compiler.kernel import CompiledKernel, kernel

NOTHING, UP = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@kernel(error_model="numpy")
def turn(zx, zy, zz, ax, ay, az, bx, by, bz):
    """R z [m], with the smallest rotation R that takes the unit normal a to b; z is tangent to a. Preserves |z|.

    For b = -a the rotation is not unique: z is taken as its axis and does not change.
    """
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    # R z = z - (z.b)/(1 + a.b) (a + b) for z perpendicular to a.
    lean = (zx * bx + zy * by + zz * bz) / max(1.0 + ax * bx + ay * by + az * bz, 1e-12)
    x, y, z = zx - lean * (ax + bx), zy - lean * (ay + by), zz - lean * (az + bz)
    # Remove the component along b that is left by rounding or by a normal of inexact length.
    lift = x * bx + y * by + z * bz
    x, y, z = x - lift * bx, y - lift * by, z - lift * bz
    rest = math.sqrt(x * x + y * y + z * z)
    if not rest > 0.0:
        return 0.0, 0.0, 0.0
    scale = length / rest
    return x * scale, y * scale, z * scale


@kernel(error_model="numpy")
def carry(z, a, b, slip):
    """Deflection z [m] (3) rotated from the last normal a [1] (3) to b, and the tangential slip velocity [m/s] (3)."""
    along = slip[0] * b[0] + slip[1] * b[1] + slip[2] * b[2]
    v = (slip[0] - along * b[0], slip[1] - along * b[1], slip[2] - along * b[2])
    return turn(z[0], z[1], z[2], a[0], a[1], a[2], b[0], b[1], b[2]), v


@kernel
def _drag(law, slack, a, b, v, dt):
    """Displacement [m] (3) of the finger from a point that it drags on a string of length `play` [m], and the path [m]
    of the point, after a step v dt; the normal changes from a to b."""
    x, y, z = turn(slack[0], slack[1], slack[2], a[0], a[1], a[2], b[0], b[1], b[2])
    x, y, z = x + v[0] * dt, y + v[1] * dt, z + v[2] * dt
    length = math.sqrt(x * x + y * y + z * z)
    if length <= law.play:
        return (x, y, z), 0.0
    keep = law.play / length
    return (keep * x, keep * y, keep * z), length - law.play


@kernel
def _taut(law, slack, a, b, v, dt):
    """`_drag` for a law without play, which does not use the path."""
    return NOTHING, 0.0


@cache
def stepper(kind: type[Any]) -> CompiledKernel:
    """The kernel of one step of a law:

        step(law, z, a, last, slack, spare, b, slip, load, dt) -> (z, b, load, slack, spare, force [N] (3), sticks)

    z      [m]   (3)  deflection;  a [1] (3), last [N]: normal and load of the last step
    slack  [m]   (3)  displacement of the finger from the point that it drags
    spare  [J]        energy that a falling load has taken from the bristles and may return
    b      [1]   (3)  present normal;  slip [m/s] (3);  load [N];  dt [s]

    Without load the bristles are reset, the force is zero, and the contact does not stick.
    """
    advanced, dragged = kind.advance, _drag if "play" in kind._fields else _taut

    @kernel(error_model="numpy")
    def plain(law, z, v, last, spare, load, dt, path):
        z, force, stick = advanced(law, z, v, load, dt, path)
        return z, force, stick, spare

    answer = _rescale_bristles(kind) if "rescale" in kind._fields else plain

    @kernel(error_model="numpy")
    def step(law, z, a, last, slack, spare, b, slip, load, dt):
        if not load > 0.0:
            return NOTHING, UP, 0.0, NOTHING, 0.0, NOTHING, False
        z, v = carry(z, a, b, slip)
        slack, path = dragged(law, slack, a, b, v, dt)
        z, force, stick, spare = answer(law, z, v, last, spare, load, dt, path)
        return z, b, load, slack, spare, force, stick

    return step


def _rescale_bristles(kind: type[Any]) -> CompiledKernel:
    """`advance` with bristles that shrink to s z, s < 1, where a rising load would give them more than the energy
    E = `spare` that it took while it fell. With the dissipation D of the step it ensures

        D(s) + E = f(s).v T + V(z, f_last) - V(z+(s), f_n) + E >= 0

    At s = sqrt(f_last/f_n) the bristles store the same energy under the new load as under the last one, so D >= 0 for a
    law that is passive under constant load. Between that and s = 1, D of LuGre is concave, so the zero of the chord of
    D + E also satisfies D + E >= 0.
    """
    advance, stored = kind.advance, kind.stored

    @kernel(error_model="numpy")
    def step_scaled(law, s, z, v, last, load, dt, path):
        """The step from s z, and its dissipation D [J]."""
        after, force, stick = advance(law, (s * z[0], s * z[1], s * z[2]), v, load, dt, path)
        work = dt * (force[0] * v[0] + force[1] * v[1] + force[2] * v[2])
        return after, force, stick, work + stored(law, z, last) - stored(law, after, load)

    @kernel(error_model="numpy")
    def rescale_bristles(law, z, v, last, spare, load, dt, path):
        after, force, stick, here = step_scaled(law, 1.0, z, v, last, load, dt, path)
        if not (law.rescale and last > 0.0 and load != last):
            return after, force, stick, spare
        if load > last:
            if here + spare < 0.0:
                one, least = here + spare, math.sqrt(last / load)
                after, force, stick, here = step_scaled(law, least, z, v, last, load, dt, path)
                there = here + spare
                if there > 0.0:
                    s = least + (1.0 - least) * there / (there - one)
                    chord, pushed, stuck, dissipated = step_scaled(law, s, z, v, last, load, dt, path)
                    if dissipated + spare >= 0.0:
                        after, force, stick, here = chord, pushed, stuck, dissipated
            spare = max(spare + min(here, 0.0), 0.0)
        else:
            spare += stored(law, z, last) - stored(law, z, load)
        # At most the stored energy: many falls must not add up to one large rise.
        return after, force, stick, min(spare, stored(law, after, load))

    return rescale_bristles
