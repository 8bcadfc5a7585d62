"""The prescribed motion of an organ with its elastic foundation, as by breathing or by an instrument that pushes it.

The displacement is the sum of a wave and a path, both zero at the start:

    d(t) = a w(t) + p(t),    w(t) = sin^2n(pi t/P)

a [m] (3) is the amplitude from exhalation to inhalation, P [s] the period. With n = 1 the wave is harmonic, with n = 2
it stays longer near exhalation, as the diaphragm does: A. E. Lujan, E. W. Larsen, J. M. Balter, R. K. Ten Haken, Med.
Phys. 26 (1999) 715-720, who use cos^2n with n from 1 to 3. The wave begins at exhalation, at rest. p(t) is a polygon of
straight motions, each at constant speed or with minimum jerk (`physics.device.grip.path_point`).

Body and foundation translate rigidly, so that the laws of the body hold in a frame that moves with d: a finger at x is
at x - d there, and forces are the same in both frames. The organ has no mass: nothing else depends on the motion. With
the force G of a finger on the hand, the foundation does the work G.dd, and of the hand's -G.dx the body gets
-G.(dx - dd).
"""

from palpate.compiler.angles import sin
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Vector3
from palpate.physics.device.grip import path_point

PI = 3.141592653589793


@kernel
def wave(time: float, period: float, flatness: int):
    """w(t) [1] at a time [s], in 0 ... 1, of a period [s] > 0; flatness n >= 1."""
    turns = time / period
    side = sin(PI * (turns - int(turns)))
    square, value = side * side, 1.0
    for _ in range(flatness):
        value *= square
    return value


@kernel
def displacement(
    time: float, amplitude: Vector3, period: float, flatness: int, ends: Array, points: Matrix, shapes: Indices
):
    """d(t) [m] (3). ends, points, shapes: of the path, see `path_point`; amplitude a [m]."""
    share = wave(time, period, flatness)
    _, x, y, z = path_point(time, ends, points, shapes)
    return x + share * amplitude[0], y + share * amplitude[1], z + share * amplitude[2]
