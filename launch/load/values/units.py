"""Quantities with units, "6 mm" or "0.4 kN/m", turned into numbers of another unit of the same dimension.

    quantity     = number [unit]
    unit         = factor { ("*" | "·" | " " | "/") factor }       "/" applies to the next factor only
    factor       = (symbol | "1" | "(" unit ")") [power]           power: ^2, ^-1, ^1.5, ², ³, or m2

Numbers are kept as fractions until the end, so that "6 mm" is the same float as 0.006. The radian counts as 1, as in
the SI (BIPM, The International System of Units, 9th edition, 2019); offset scales (°C) are not read.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

from palpate.physics.errors import MISUSE, PalpateError

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
}  # fmt: skip
_PLAIN = {
    "1": ONE, "%": _unit(Fraction(1, 100)), "deg": _unit(Fraction(math.pi) / 180), "°": _unit(Fraction(math.pi) / 180),
    "min": _unit(60, 0, 0, 1), "h": _unit(3600, 0, 0, 1), "in": _unit(Fraction(254, 10**4), 1),
    "mil": _unit(Fraction(254, 10**7), 1),
    "gf": _unit(Fraction(980665, 10**8), 1, 1, -2), "kgf": _unit(Fraction(980665, 10**5), 1, 1, -2),
    "lbf": _unit(Fraction(44482216152605, 10**13), 1, 1, -2),
}  # fmt: skip
_PREFIX = {"G": 9, "M": 6, "k": 3, "h": 2, "d": -1, "c": -2, "m": -3, "µ": -6, "μ": -6, "u": -6, "n": -9, "p": -12}
_NAMES = {
    ONE: "a plain number", _PREFIXED["m"]: "a length", _unit(1, 0, 1): "a mass", _PREFIXED["s"]: "a time",
    _PREFIXED["Hz"]: "a frequency or rate", _PREFIXED["N"]: "a force", _PREFIXED["Pa"]: "a pressure or modulus",
    _PREFIXED["J"]: "an energy or torque", _PREFIXED["W"]: "a power", _PREFIXED["A"]: "a current",
    _PREFIXED["K"]: "a temperature", _PREFIXED["V"]: "a voltage", _unit(1, 2): "an area", _unit(1, 3): "a volume",
    _unit(1, 1, 0, -1): "a velocity", _unit(1, 1, 0, -2): "an acceleration", _unit(1, 0, 1, -2): "a stiffness",
    _unit(1, 0, 1, -1): "a damping", _unit(1, -3, 1): "a density", _unit(1, -1, 1, -1): "a viscosity",
    _unit(1, -1): "a number per length", _unit(1, -1, 0, 1): "a time per length",
}  # fmt: skip
_WRITTEN = {
    "m": ("meter", "meters", "metre", "metres"), "g": ("gram", "grams"), "s": ("sec", "secs", "second", "seconds"),
    "Hz": ("hertz",), "N": ("newton", "newtons"), "Pa": ("pascal", "pascals"), "J": ("joule", "joules"),
    "W": ("watt", "watts"), "V": ("volt", "volts"), "A": ("amp", "amps", "ampere", "amperes"), "in": ("inch", "inches"),
    "L": ("liter", "liters", "litre", "litres"), "min": ("mins", "minute", "minutes"), "rad": ("radian", "radians"),
    "h": ("hr", "hrs", "hour", "hours"), "deg": ("degree", "degrees"), "%": ("percent", "pct"),
}  # fmt: skip
"""Units as people write them out, for errors."""
_WRITTEN_PREFIX = {
    "giga": "G", "mega": "M", "kilo": "k", "centi": "c", "milli": "m", "micro": "u", "nano": "n", "pico": "p", "m": "m",
    "k": "k", "u": "u", "n": "n",
}  # fmt: skip
_SUPER = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_NUMBER = re.compile(r"\s*([-+−]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+−]?[0-9]+)?)\s*(.*)", re.DOTALL)
_TOKEN = re.compile(
    r"\s*(?:(?P<symbol>[A-Za-zµμ]+|°|%|1(?![0-9.]))(?P<digit>[0-9]+)?"
    r"|(?P<power>(?:\^|\*\*)\s*(?:[-+]?[0-9]+(?:\.[0-9]+)?|\(\s*[-+]?[0-9]+\s*/\s*[0-9]+\s*\))|[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)"
    r"|(?P<sign>[*·/()]))"
)


def convert(text: str, unit: str) -> float:
    """A quantity as a number of `unit`; a number without a unit is in `unit`.

    UnitError: not a quantity, an unknown unit, or another dimension.
    """
    number, symbols = split(text, unit)
    if not symbols or "".join(symbols.split()) == "".join(unit.split()):
        return float(number)
    given_unit = parse(symbols)
    try:
        wanted = parse(unit)
    except UnitError:
        raise UnitError(f"found {text!r}; expected a plain number, taken in {unit}") from None
    if given_unit.dimension != wanted.dimension:
        raise UnitError(f"found {text!r} [{symbols}], {describe(given_unit)}; expected {describe(wanted)}")
    try:
        return float(number * given_unit.factor / wanted.factor)
    except (OverflowError, ZeroDivisionError):
        raise UnitError(f"found {text!r}, which is too large") from None


def split(text: str, wanted: str = "m") -> tuple[Fraction, str]:
    """Number and unit text of a quantity. UnitError: no finite number; gives an example in the unit `wanted`."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        example = {"m": "6 mm", "s": "20 ms", "1": ""}.get(wanted, f"6 {wanted}")
        other = f", or a number with its unit such as {example!r}" if is_quantity(example) else f", taken in {wanted}"
        raise UnitError(f"found {text!r}; expected a number{other if example else ''}")
    digits = match[1].replace("−", "-")
    if not math.isfinite(float(digits)):
        raise UnitError(f"found {text!r}, which is too large")
    number = Fraction(digits) if float(digits) else Fraction(0)
    return number, match[2].strip()


def is_quantity(text: str) -> bool:
    """Whether a text is a number with a known unit or without one."""
    try:
        parse(split(text)[1] or "1")
    except UnitError:
        return False
    return True


@lru_cache(maxsize=256)
def parse(text: str) -> Unit:
    """The unit of a text. UnitError: names the part that is not understood."""
    if text.count("(") > 3:
        raise UnitError(f"unit {text!r}: too many brackets")
    tokens = []
    at = 0
    while text[at:].strip():
        match = _TOKEN.match(text, at)
        if match is None or match.end() == at:
            raise UnitError(f"unit {text!r}: {text[at:].strip()!r} is not understood")
        tokens.append(match)
        at = match.end()
    if not tokens:
        raise UnitError("a unit is missing")
    unit = _product(text, tokens)
    if tokens:
        raise UnitError(f"unit {text!r}: {tokens[0][0].strip()!r} is out of place")
    return unit


def _product(text: str, tokens: list[re.Match[str]]) -> Unit:
    """The unit of the tokens up to a closing bracket, which are removed from the list."""
    unit = _factor(text, tokens)
    while tokens and (sign := tokens[0]["sign"]) != ")":
        if sign in ("*", "·", "/"):
            tokens.pop(0)
        unit = unit * _factor(text, tokens) ** Fraction(-1 if sign == "/" else 1)
    return unit


def _factor(text: str, tokens: list[re.Match[str]]) -> Unit:
    if not tokens:
        raise UnitError(f"unit {text!r}: something is missing at its end")
    token = tokens.pop(0)
    if token["sign"] == "(":
        unit = _product(text, tokens)
        if not tokens:
            raise UnitError(f"unit {text!r}: a ) is missing")
        tokens.pop(0)
    elif token["symbol"]:
        unit = symbol(token["symbol"]) ** _power(text, token["digit"] or "1")
    else:
        raise UnitError(f"unit {text!r}: {token[0].strip()!r} is out of place")
    if tokens and tokens[0]["power"]:
        unit = unit ** _power(text, tokens.pop(0)["power"])
    return unit


def _power(text: str, digits: str) -> Fraction:
    plain = "".join(digits.translate(_SUPER).lstrip("^*").strip(" ()").split())
    try:
        power = Fraction(plain)
    except (ValueError, ZeroDivisionError):
        raise UnitError(f"unit {text!r}: power {digits!r} is not understood") from None
    if abs(power) > 12:
        raise UnitError(f"unit {text!r}: power {digits!r} is too large")
    return power


def symbol(name: str) -> Unit:
    """The unit of one symbol, with or without prefix. UnitError: unknown; lists the known ones."""
    if name in _PLAIN or name in _PREFIXED:
        return _PLAIN.get(name) or _PREFIXED[name]
    if name[0] in _PREFIX and name[1:] in _PREFIXED:
        return _unit(Fraction(10) ** _PREFIX[name[0]]) * _PREFIXED[name[1:]]
    known = ", ".join([*_PREFIXED, *(p for p in _PLAIN if p != "1")])
    if meant := _meant(name):
        raise UnitError(f"unit {name!r}: unknown; did you mean {' or '.join(map(repr, meant))}?")
    raise UnitError(f"unit {name!r}: unknown; known are {known}, with the prefixes {' '.join(_PREFIX)}")


def _meant(name: str) -> list[str]:
    """The symbols of a unit that is written out or in another case, such as "sec", "millimeters" or "kpa"."""
    word = name.lower().rstrip(".")
    for prefix, before in (*_WRITTEN_PREFIX.items(), ("", "")):
        for unit, words in _WRITTEN.items():
            if word.startswith(prefix) and word.removeprefix(prefix) in words:
                return [before + unit]
    symbols = [before + unit for unit in _PREFIXED for before in ("", *_PREFIX)] + [*_PLAIN]
    return [known for known in symbols if known.lower() == word][::-1]  # small ones first: mm, Mm


def describe(unit: Unit) -> str:
    """The dimension in words, "a length", or in base units if it has no name."""
    for known, words in _NAMES.items():
        if known.dimension == unit.dimension:
            return words
    powers = zip(("m", "kg", "s", "A", "K", "mol"), unit.dimension, strict=True)
    return " ".join(s if p == 1 else f"{s}^{p}" for s, p in powers if p)
