"""The rate at the end of a step, of second order: the mean rate of the step plus half of its expected change.

Implicit Euler applies the mean rate v of a step at its end, as if the motion were half a step late. On a smooth motion
the rate at the end is v + d/2 to second order, where d is the change of v from one step to the next. It is predicted
from the last three changes a, b, c, the newest first, so that it is known before the step, and a law that is linear in
the rate remains linear:

    d = minmod(a, b) + minmod(a - b, b - c)

minmod is the argument of smaller magnitude, or 0 if the signs differ (P. L. Roe, Annu. Rev. Fluid Mech. 18 (1986)
337-365). So d is 0, and the step is implicit Euler, where a motion starts, stops or turns within a step.

A step that uses the rate v + d/2 is implicit Euler from a start that is shifted by -T d/2.
"""

import math

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Record

STEPS = 4  # Number of mean rates that the prediction uses
COURSE = {
    "tick": int, "follows": bool,  # of the last message, -1 if unknown; whether it followed the tick before
    "value": (), "ahead": (),  # y; factor [1] on y at the start of the next step
    "rates": (STEPS,),  # mean rates of y in the last steps, the newest first
}  # fmt: skip
"""The course of a quantity y over the steps."""


@kernel
def minmod(a: float, b: float):
    """The argument of smaller magnitude; 0 if the signs differ."""
    return 0.0 if not a * b > 0.0 else math.copysign(min(abs(a), abs(b)), a)


@kernel
def expected_change(rates: Array):
    """Expected change d of the mean rate in the next step, from those of the last steps (4), the newest first."""
    a, b, c = rates[0] - rates[1], rates[1] - rates[2], rates[2] - rates[3]
    return minmod(a, b) + minmod(a - b, b - c)


@kernel
def remember(rates: Array, rate: float, follows: bool):
    """Add the mean rate of a step to `rates` (4). Unless the step follows the last one, no change is known."""
    for k in range(STEPS - 1, 0, -1):
        rates[k] = rates[k - 1] if follows else rate
    rates[0] = rate


@kernel
def arrive(course: Record, tick: int):
    """Begin a step with a message of this tick. Without the tick before, or with -1, the step is implicit Euler: a body
    at a divisor of the contact's rate does not know how the rate changes in the steps of the contact."""
    course.follows = tick >= 0 and (course.tick == tick - 1 or course.value == 0.0)
    course.tick = tick


@kernel
def advance(course: Record, value: float, dt: float):
    """Add y >= 0 at the end of a step of dt [s]. The factor for the next step is 1 - T d/2y, within 0 and 2."""
    if not value > 0.0:
        course.value, course.ahead = 0.0, 1.0
        for k in range(STEPS):  # numba takes a second to compile the assignment of a slice
            course.rates[k] = 0.0
        return
    remember(course.rates, (value - course.value) / dt, course.follows)
    shift = 0.5 * dt * expected_change(course.rates)
    course.value, course.ahead = value, 1.0 - max(-1.0, min(shift / value, 1.0))
