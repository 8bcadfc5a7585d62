"""Quantities with units, "6 mm" or "0.4 kN/m", turned into numbers of another unit of the same dimension.

    quantity     = number [unit]
    unit         = factor { ("*" | "·" | " " | "/") factor }       "/" applies to the next factor only
    factor       = (symbol | "1" | "(" unit ")") [power]           power: ^2, ^-1, ^1.5, ², ³, or m2

`symbols` has the units. Numbers are kept as fractions until the end, so that "6 mm" is the same float as 0.006.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import lru_cache

from palpate.units.symbols import Unit, UnitError, describe, symbol

_SUPER = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_NUMBER = re.compile(r"\s*([-+−]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+−]?[0-9]+)?)\s*(.*)", re.DOTALL)
_TOKEN = re.compile(
    r"\s*(?:(?P<symbol>[A-Za-zÅµμ]+|°|%|1(?![0-9.]))(?P<digit>[0-9]+)?"
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
