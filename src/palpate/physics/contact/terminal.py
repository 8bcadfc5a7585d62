"""The terminal law: the response of a deformable body at the contact in its next step, as five numbers.

    F(s) = K <s - s_free>^n <1 + c (s - s_prev)/T>,    <x> = max(0, x)

F [N] normal force, s [m] indentation at the end of the step, T [s] its length. It is a Hunt-Crossley law
(Hunt & Crossley 1975) in state form. F is zero up to `free_recovery` and increases from there on, so its balance with
any law of the same kind has a bracketed root for every step length.
"""

import math
from typing import NamedTuple

from palpate.compiler.exponentials import cbrt
from palpate.compiler.kernel import kernel

LEAST_FORCE = 1e-3  # [N] Smallest force at which a body's law is fitted
LEAST_DEPTH = 1e-9  # [m] Depth below which a fitted body counts as rigid; it keeps K finite
LEAST_FREE = -0.1  # [m] Lower bound of a plausible rest indentation


class Terminal(NamedTuple):
    """Values of a terminal law."""

    stiffness: float  # [N/m^n] K > 0
    exponent: float  # [1] n in [1, 3]
    damping: float = 0.0  # [s/m] c >= 0
    rest_indentation: float = 0.0  # [m] s_free, indentation of the next step at zero force
    previous_indentation: float = 0.0  # [m] s_prev, indentation at the end of this step


@kernel(error_model="numpy")
def power_of(x, n):
    """x^n for x >= 0; avoids pow for the common exponents."""
    if n == 1.5:
        return x * math.sqrt(x)
    if n == 1.0:
        return x
    if n == 2.0:
        return x * x
    return x**n


@kernel(error_model="numpy")
def power_slope(x, n):
    """x^n and n x^(n-1) for x >= 0, n >= 1."""
    if n == 1.5:
        root = math.sqrt(x)
        return x * root, 1.5 * root
    if n == 1.0:
        return x, 1.0
    if n == 2.0:
        return x * x, 2.0 * x
    below = x ** (n - 1.0)
    return x * below, n * below


@kernel(error_model="numpy")
def root_of(x, n):
    """x^(1/n) for x >= 0; avoids pow for the common exponents."""
    if n == 1.5:
        y = cbrt(x)
        return y * y
    if n == 1.0:
        return x
    if n == 2.0:
        return math.sqrt(x)
    return x ** (1.0 / n)


@kernel(error_model="numpy")
def free_recovery(previous, free, damping, dt):
    """Indentation [m] after a step `dt` [s] without load, max(s_free, s_prev - T/c): the largest s with F(s) = 0."""
    if damping > 0.0:
        return max(free, previous - dt / damping)
    return free


@kernel(error_model="numpy")
def terminal_force(s, dt, stiffness, exponent, damping, free, previous):
    """F(s) [N] of the terminal law and dF/ds [N/m] at the indentation s [m], for a step of dt > 0 [s]."""
    x = s - free
    rate = 1.0 + damping * (s - previous) / dt
    if x <= 0.0 or rate <= 0.0:
        return 0.0, 0.0
    elastic = stiffness * power_of(x, exponent)
    return elastic * rate, exponent * elastic / x * rate + elastic * damping / dt


@kernel(error_model="numpy")
def indentation(force, dt, stiffness, exponent, damping, free, previous):
    """Indentation s [m] with F(s) = force; the free recovery where force <= 0.

    With x = s - free and n >= 1, F is convex and increasing, so Newton's method converges monotonically from any point
    with F >= force. Available start points are the static root, the previous indentation (unloading), and one Newton
    step from there (loading).
    """
    least = free_recovery(previous, free, damping, dt)
    if not force > 0.0:
        return least
    goal = min(force / stiffness, 1e300)
    if exponent == 1.0 and damping == 0.0:  # linear: the result of the iteration, to the last bit
        return max(goal + free, least)
    inverse = damping / dt
    p = previous - free
    x = p
    value = slope = 0.0
    if p > 0.0:
        value, slope = power_slope(p, exponent)
    if value < goal:
        # a Newton step is safe but overshoots far if the law starts flat; the static root is then closer
        if value > 0.0:
            x = p + (goal - value) / (slope + value * inverse)
        if not value > 0.1 * goal:
            bound = root_of(goal, exponent)
            x = min(x, bound) if value > 0.0 else bound
    for _ in range(100):
        value, slope = power_slope(x, exponent)
        rate = 1.0 + inverse * (x - p)
        rise = slope * rate + value * inverse
        # the law overflows or underflows for a tiny force or step: accept x
        if not 0.0 < rise < math.inf:
            break
        step = (value * rate - goal) / rise
        x -= step
        if not step > 1e-9 * x:
            break
    return max(x + free, least)


@kernel(error_model="numpy")
def fit_terminal(free, s, slope, force):
    """K and n of the terminal law through two points of a body's next implicit step; c is 0.

    free   [m]    indentation of the next step at zero force
    s      [m]    indentation of the next step at `force`
    slope  [N/m]  tangent stiffness dF/ds there, of the step: it includes the body's damping
    force  [N]    present force, at least `LEAST_FORCE`: a law fitted at zero load would deadlock the contact

    n = slope (s - free)/force, limited to [1, 3]; K = force/(s - free)^n. So the law matches force and slope at s.
    """
    depth = max(s - free, LEAST_DEPTH)
    n = slope * depth / force
    if not n >= 1.0:
        n = 1.0
    n = min(n, 3.0)
    return force / depth**n, n


def check_law(law: Terminal, step: float = 0.0, relaxation: float = 0.0) -> None:
    """ValueError: the law would pull or has no root; names the number, what was found and what is expected."""
    stiffness, exponent, damping, free, previous = law
    some, none = "a finite number > 0", "a finite number >= 0"
    for name, unit, value, least, most, expected in (
        ("stiffness", "N/m^n", stiffness, math.ulp(0.0), math.inf, some),
        ("exponent", "1", exponent, 1.0, 3.0, "1 to 3"),
        ("damping", "s/m", damping, 0.0, math.inf, none),
        ("rest_indentation", "m", free, LEAST_FREE, math.inf, f"a finite number >= {LEAST_FREE}"),
        ("previous_indentation", "m", previous, -math.inf, math.inf, "a finite number"),
        ("step", "s", step, 0.0, math.inf, none),
        ("relaxation", "s", relaxation, 0.0, math.inf, none),
    ):
        if not (math.isfinite(value) and least <= value <= most):
            raise ValueError(
                f"{name} [{unit}]: found {value}, expected {expected}. A terminal law, F(s) = stiffness "
                "<s - rest_indentation>^exponent <1 + damping (s - previous_indentation)/T>, presses and never pulls."
            )


@kernel(error_model="numpy")
def law_at(length, start, law, step, relaxation):
    """K [N/m^n] and s_free [m] of a law, valid for a step of length `step` [s] from s_prev, converted to a step of
    `length` > 0 [s] from the indentation `start` [m].

    The body relaxes to equilibrium with the time constant tau = `relaxation` [s]; an implicit step of length a covers
    the fraction m(a) = a/(a + tau). With s_rest, its equilibrium without force,

        s_rest = s_prev + (s_free - s_prev)/m(step)
        s_free <- start + m(length) (s_rest - start),   K <- K (m(step)/m(length))^n

    Exact for a Kelvin-Voigt body. If `step` or `relaxation` is 0, the law does not depend on the length.
    """
    stiffness, exponent, _, rest, previous = law
    if not (step > 0.0 and relaxation > 0.0):
        return stiffness, rest
    share = (length / step) * (step + relaxation) / (length + relaxation)
    fraction = length / (length + relaxation)
    free = start + share * (rest - previous) + fraction * (previous - start)
    return stiffness / share**exponent, free
