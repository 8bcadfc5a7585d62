"""Every unit that palpate reads: symbols, prefixes, their SI factors and dimensions.

Factors are fractions, so that "6 mm" is the same float as 0.006. The radian counts as 1, as in the SI (BIPM, The
International System of Units, 9th edition, 2019); offset scales (°C) are not read. Pound, inch and gram-force:
international yard and pound, standard gravity (NIST Special Publication 811, 2008, appendix B).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from palpate.physics.errors import MISUSE, PalpateError
from palpate.units.words import written

Dimension = tuple[Fraction, ...]  # powers of m, kg, s, A, K, mol


class UnitError(PalpateError, ValueError):
    """A text that is not a quantity, or a quantity of another dimension."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Unit:
    """A unit: its factor to the SI unit, and its dimension."""

    factor: Fraction
    dimension: Dimension

    def __mul__(self, other: Unit) -> Unit:
        dimension = tuple(a + b for a, b in zip(self.dimension, other.dimension, strict=True))
        return Unit(self.factor * other.factor, dimension)

    def __pow__(self, power: Fraction) -> Unit:
        if power.denominator == 1:
            factor = self.factor**power.numerator
        else:
            factor = Fraction(float(self.factor) ** float(power))
        return Unit(factor, tuple(a * power for a in self.dimension))


def _unit(factor: Fraction | int, *powers: int) -> Unit:
    return Unit(Fraction(factor), tuple(map(Fraction, powers + (0,) * (6 - len(powers)))))


ONE = _unit(1)
_PREFIXED = {
    "m": _unit(1, 1), "g": _unit(Fraction(1, 1000), 0, 1), "s": _unit(1, 0, 0, 1), "A": _unit(1, 0, 0, 0, 1),
    "K": _unit(1, 0, 0, 0, 0, 1), "mol": _unit(1, 0, 0, 0, 0, 0, 1), "Hz": _unit(1, 0, 0, -1), "rad": ONE,
    "N": _unit(1, 1, 1, -2), "Pa": _unit(1, -1, 1, -2), "J": _unit(1, 2, 1, -2), "W": _unit(1, 2, 1, -3),
    "V": _unit(1, 2, 1, -3, -1), "bar": _unit(100_000, -1, 1, -2), "L": _unit(Fraction(1, 1000), 3),
    "gf": _unit(Fraction(980665, 10**8), 1, 1, -2), "lbf": _unit(Fraction(44482216152605, 10**13), 1, 1, -2),
    "Nm": _unit(1, 2, 1, -2),
}  # fmt: skip
_PLAIN = {
    "1": ONE, "%": _unit(Fraction(1, 100)), "deg": _unit(Fraction(math.pi) / 180), "°": _unit(Fraction(math.pi) / 180),
    "min": _unit(60, 0, 0, 1), "h": _unit(3600, 0, 0, 1), "in": _unit(Fraction(254, 10**4), 1),
    "mil": _unit(Fraction(254, 10**7), 1), "ft": _unit(Fraction(3048, 10**4), 1), "Å": _unit(Fraction(1, 10**10), 1),
    "ozf": _unit(Fraction(44482216152605, 16 * 10**13), 1, 1, -2), "dyn": _unit(Fraction(1, 10**5), 1, 1, -2),
    "kp": _unit(Fraction(980665, 10**5), 1, 1, -2), "Nmm": _unit(Fraction(1, 1000), 2, 1, -2),
}  # fmt: skip
_PREFIX = {"G": 9, "M": 6, "k": 3, "h": 2, "da": 1, "d": -1, "c": -2, "m": -3, "µ": -6, "μ": -6, "u": -6, "n": -9,
           "p": -12}  # fmt: skip
_NAMES = {
    ONE: "a plain number", _PREFIXED["m"]: "a length", _unit(1, 0, 1): "a mass", _PREFIXED["s"]: "a time",
    _PREFIXED["Hz"]: "a frequency or rate", _PREFIXED["N"]: "a force", _PREFIXED["Pa"]: "a pressure or modulus",
    _PREFIXED["J"]: "an energy or torque", _PREFIXED["W"]: "a power", _PREFIXED["A"]: "a current",
    _PREFIXED["K"]: "a temperature", _PREFIXED["V"]: "a voltage", _unit(1, 2): "an area", _unit(1, 3): "a volume",
    _unit(1, 1, 0, -1): "a velocity", _unit(1, 1, 0, -2): "an acceleration", _unit(1, 0, 1, -2): "a stiffness",
    _unit(1, 0, 1, -1): "a damping", _unit(1, -3, 1): "a density", _unit(1, -1, 1, -1): "a viscosity",
    _unit(1, -1): "a number per length", _unit(1, -1, 0, 1): "a time per length",
}  # fmt: skip


def symbol(name: str) -> Unit:
    """The unit of one symbol, with or without prefix. UnitError: unknown; lists the known ones."""
    if name in _PLAIN or name in _PREFIXED:
        return _PLAIN.get(name) or _PREFIXED[name]
    for size in (1, 2):
        if name[:size] in _PREFIX and name[size:] in _PREFIXED:
            return _unit(Fraction(10) ** _PREFIX[name[:size]]) * _PREFIXED[name[size:]]
    known = ", ".join([*_PREFIXED, *(p for p in _PLAIN if p != "1")])
    if meant := _meant(name):
        raise UnitError(f"unit {name!r}: unknown; did you mean {' or '.join(map(repr, meant))}?")
    raise UnitError(f"unit {name!r}: unknown; known are {known}, with the prefixes {' '.join(_PREFIX)}")


def _meant(name: str) -> list[str]:
    """The symbols of a unit that is written out or in another case, such as "sec", "millimeters" or "kpa"."""
    if unit := written(name):
        return [unit]
    word = name.lower().rstrip(".")
    symbols = [before + unit for unit in _PREFIXED for before in ("", *_PREFIX)] + [*_PLAIN]
    return [known for known in symbols if known.lower() == word][::-1]  # small ones first: mm, Mm


def describe(unit: Unit) -> str:
    """The dimension in words, "a length", or in base units if it has no name."""
    for known, words in _NAMES.items():
        if known.dimension == unit.dimension:
            return words
    powers = zip(("m", "kg", "s", "A", "K", "mol"), unit.dimension, strict=True)
    return " ".join(s if p == 1 else f"{s}^{p}" for s, p in powers if p)


def spellings(like: Unit) -> dict[str, Unit]:
    """Every symbol with the dimension of a unit, with each prefix; the radian and other plain numbers excluded."""
    named = {**_PREFIXED, **_PLAIN}
    named |= {prefix + name: symbol(prefix + name) for prefix in _PREFIX for name in _PREFIXED}
    return {name: unit for name, unit in named.items() if unit.dimension == like.dimension != ONE.dimension}
