"""The elementary functions of kernels: below 1 ulp of the exact value everywhere, and IEEE 754's special values."""

import math

import mpmath
import numpy as np
import pytest

from palpate.compiler import angles, exponentials

FUNCTIONS = {
    "exp": exponentials.exp, "expm1": exponentials.expm1, "log": exponentials.log, "log1p": exponentials.log1p,
    "log2": exponentials.log2, "cbrt": exponentials.cbrt, "pow": exponentials.power, "sin": angles.sin,
    "cos": angles.cos, "acos": angles.acos, "asin": angles.asin, "atan2": angles.atan2, "hypot": angles.hypot,
}  # fmt: skip
EXACT = {
    "pow": mpmath.power,
    "log2": lambda x: mpmath.log(x, 2),
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
}
COUNT = 1200


def samples(name):
    """Arguments (n, 1 or 2) over the whole range of a function, and near the edges of its cases."""
    rng = np.random.default_rng(sum(map(ord, name)))
    sign = rng.choice([-1.0, 1.0], COUNT)
    wide = sign * 10.0 ** rng.uniform(-307, 308, COUNT)
    middle = sign * 10.0 ** rng.uniform(-18, 3, COUNT)
    near = 1.0 + sign * 10.0 ** rng.uniform(-16, -0.01, COUNT)
    if name in ("exp", "expm1"):
        x = np.concatenate([rng.uniform(-745, 709.7, COUNT), middle[abs(middle) < 700], rng.uniform(-1, 1, COUNT)])
        return x[:, None]
    if name in ("log", "log2"):
        tiny = abs(wide[abs(wide) > 1e-20]) * 1e-300
        return np.concatenate([abs(wide), near, tiny, [5e-324, 2.2e-308, math.sqrt(0.5), 1.0]])[:, None]
    if name == "log1p":
        return np.concatenate([abs(wide), middle[middle > -1.0], near - 1.0, -abs(near - 1.0)])[:, None]
    if name in ("sin", "cos"):
        turns = np.round(10.0 ** rng.uniform(0, 17, COUNT)) * (math.pi / 4)
        nearest = np.array([6381956970095103.0 * 2.0**797, 5.31937264832654141671e255, 2.0**20, 2.0**1023])
        return np.concatenate([wide, middle, turns, sign * rng.uniform(0, 7, COUNT), nearest, -nearest])[:, None]
    if name in ("asin", "acos"):
        edge = sign * (1.0 - 10.0 ** rng.uniform(-16, 0, COUNT))
        return np.concatenate([rng.uniform(-1, 1, COUNT), edge, wide[abs(wide) < 1.0]])[:, None]
    if name == "cbrt":
        return np.concatenate([wide, middle, [5e-324, 1.7e308, 8.0, -27.0]])[:, None]
    other = rng.permutation(sign) * 10.0 ** rng.uniform(-307, 307, COUNT)
    if name == "pow":
        base = np.concatenate([abs(wide), near])
        y = np.concatenate([rng.uniform(-1, 1, COUNT) * 700 / np.log(abs(wide)), middle / 10])
        kept = abs(y * np.log(base)) < 700
        return np.stack([base, y], axis=1)[kept]
    close = np.stack([middle, middle * rng.uniform(-2, 2, COUNT)], axis=1)
    return np.concatenate(
        [np.stack([wide, other], axis=1) / 2, close, close * 1e-290, np.stack([middle, near], axis=1)]
    )


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_error_is_below_one_unit_in_the_last_place(name):
    exact = EXACT.get(name) or getattr(mpmath, name)
    worst, at = 0.0, None
    with mpmath.workprec(1200 if name in ("sin", "cos") else 200):
        for given in samples(name).tolist():
            found, right = FUNCTIONS[name](*given), exact(*given)
            error = float(abs(mpmath.mpf(found) - right) / math.ulp(float(right)))
            assert math.isfinite(error), given
            if error > worst:
                worst, at = error, given
    assert worst < 1.0, at


INFINITY, NAN = math.inf, math.nan
SPECIAL = {
    "exp": [(INFINITY, INFINITY), (-INFINITY, 0.0), (710.0, INFINITY), (-746.0, 0.0), (0.0, 1.0), (-745.0, 5e-324)],
    "expm1": [(INFINITY, INFINITY), (-INFINITY, -1.0), (-0.0, -0.0), (5e-324, 5e-324), (-50.0, -1.0)],
    "log": [(0.0, -INFINITY), (-1.0, NAN), (INFINITY, INFINITY), (1.0, 0.0)],
    "log1p": [(-1.0, -INFINITY), (-2.0, NAN), (INFINITY, INFINITY), (-0.0, -0.0)],
    "log2": [(0.0, -INFINITY), (-1.0, NAN), (INFINITY, INFINITY), *((2.0**k, float(k)) for k in range(-1074, 1024))],
    "cbrt": [(0.0, 0.0), (-0.0, -0.0), (-INFINITY, -INFINITY), (27.0, 3.0), (-1e300, -1e100)],
    "sin": [(INFINITY, NAN), (-0.0, -0.0), (5e-324, 5e-324)],
    "cos": [(INFINITY, NAN), (0.0, 1.0)],
    "acos": [(1.0, 0.0), (-1.0, math.pi), (1.0000001, NAN), (0.0, math.pi / 2)],
    "asin": [(1.0, math.pi / 2), (-1.0, -math.pi / 2), (-1.1, NAN), (-0.0, -0.0)],
}


def same(found, expected):
    return (math.isnan(found) and math.isnan(expected)) or (
        found == expected and math.copysign(1.0, found) == math.copysign(1.0, expected)
    )


@pytest.mark.parametrize("name", SPECIAL)
def test_special_values_are_those_of_ieee_754(name):
    for given, expected in [*SPECIAL[name], (NAN, NAN)]:
        assert same(FUNCTIONS[name](given), expected), given


@pytest.mark.parametrize("name", ["atan2", "pow", "hypot"])
def test_special_values_of_two_arguments_are_those_of_the_standard_library(name):
    numbers = [0.0, 1.0, 2.0, 3.0, 0.25, 1e300, 2.0**53, 2.0**53 - 1.0, 5e-324, INFINITY]
    for x in (sign * number for number in numbers for sign in (1.0, -1.0)):
        for y in (sign * number for number in numbers for sign in (1.0, -1.0)):
            with np.errstate(all="ignore"):
                expected = float({"pow": np.power, "hypot": np.hypot, "atan2": np.arctan2}[name](x, y))
            found = FUNCTIONS[name](x, y)
            assert same(found, expected) or abs(found - expected) <= math.ulp(expected), (x, y, found, expected)
    assert all(math.isnan(FUNCTIONS[name](*pair)) for pair in ((NAN, 2.0), (2.0, NAN)))
