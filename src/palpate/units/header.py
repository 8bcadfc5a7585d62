"""Units of the columns of tables: every form in which a header names one, and the factor to the SI unit.

`name [unit]`, `name (unit)`, `name, unit`, `name/unit`, `name_unit`, `name.unit.` (R), `name in unit`; brackets may be
those of East Asian fonts. Units may be words (`Newton`, `sec.`, `lbs`) or in capital letters (`MM`, `KGF`).
"""

import re
from functools import lru_cache

from palpate.units.quantity import parse
from palpate.units.symbols import ONE, UnitError, describe, spellings
from palpate.units.words import written

WIDE = str.maketrans("（）［］／，：", "()[]/,:")
BRACKET = re.compile(r"(?P<name>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))\s*", re.DOTALL)
AFTER = re.compile(r"(?P<name>[^,/]*[^,/\s])\s*[,/]\s*(?P<unit>[^,]+)")
ENDING = re.compile(r"(?P<name>.*[^\W_])(?:\s*[._]+|\s+in\s+)(?P<unit>[A-Za-zÅµμ]+(?:/[A-Za-zÅµμ]+(?:\^?2|²)?)?)\.*")
CLOCK = re.compile(r"(?i)(?=.*:)[hmsydftz:./,\-\s]+")  # hh:mm:ss.f, yyyy-mm-dd hh:mm:ss
WORD = re.compile(r"[A-Za-zÅµμ]+(?:[- ]force)?")
NO_UNITS = ("-", "1", "a.u.", "#", "°c", "°f", "degc", "counts")
"""Entries of a row of units, without brackets, that are no units of a quantity that palpate reads."""
SMALL = ("", "k", "c", "d", "da", "m", "u", "µ", "n")  # prefixes of units in capital letters
ENDINGS = ("m", "s", "N", "g", "m/s", "m/s^2")
"""Units whose dimensions may follow a name without brackets: `depth_mm`, but not `subject_A`."""
EXAMPLES = {"m": "mm, um, m, in", "N": "N, mN, gf, lbf", "s": "s, ms, us, min", "rad": "rad, deg",
            "m/s": "m/s, mm/s", "m/s^2": "m/s^2, mm/s^2"}  # fmt: skip


@lru_cache(maxsize=4096)
def split_units(cell: str) -> tuple[str, tuple[str, ...]]:
    """Name of a header cell and its units, one from each bracket; several units are a contradiction unless equal."""
    text = cell.translate(WIDE).strip().strip("\"'").strip()
    notes: list[str] = []
    units: list[str] = []
    rest = text
    while match := BRACKET.fullmatch(rest):
        inside = (match["square"] if match["square"] is not None else match["round"]).strip()
        (units if is_unit(inside) else notes).insert(0, inside)
        rest = match["name"]
    if units:
        name = " ".join([rest, *(f"({note})" for note in notes)])
        return name.strip().rstrip("_,/:").strip(), tuple(map(plain_unit, units))
    if notes:  # an unknown unit is refused later, with its column
        last = BRACKET.fullmatch(text)
        return (last["name"].strip() if last else text), (notes[-1],)
    for form, accepts in ((ENDING, _may_end), (AFTER, is_unit)):
        match = form.fullmatch(text)
        if match and accepts(plain_unit(match["unit"])):
            return match["name"].strip(), (plain_unit(match["unit"]),)
    return text, ()


def split_unit(cell: str) -> tuple[str, str]:
    """Name and unit of a header cell; the unit is "" if it has none."""
    name, units = split_units(cell)
    return name, units[-1] if units else ""


@lru_cache(maxsize=4096)
def plain_unit(cell: str) -> str:
    """A unit without brackets; one that is written as a word or in capital letters by its symbol."""
    unit = cell.translate(WIDE).strip()
    while len(unit) > 1 and unit[0] + unit[-1] in ("[]", "()"):
        unit = unit[1:-1].strip()
    if unit.lower() in NO_UNITS:
        return unit
    bare = unit.strip(".")
    for form in (
        bare,
        written(bare),
        WORD.sub(lambda word: written(word[0]) or word[0], bare),
        _capitals().get(bare.casefold(), ""),
    ):
        if form and is_known(form):
            return form
    return unit


def is_unit(cell: str) -> bool:
    """Whether a text is a unit, with or without brackets, one of `NO_UNITS`, or the form of a clock, `hh:mm:ss`."""
    unit = plain_unit(cell)
    return unit.lower() in NO_UNITS or is_known(unit) or CLOCK.fullmatch(unit) is not None


def same_unit(one: str, other: str) -> bool:
    """Whether two units are equal, however they are written."""
    if is_known(one) and is_known(other):
        return parse(one) == parse(other)
    return one.casefold() == other.casefold()


def factor(unit: str, si: str) -> float:
    """Factor from a unit, in any form of `plain_unit`, to an SI unit. UnitError: unknown, or another dimension."""
    plain = plain_unit(unit)
    try:
        given = parse(plain)
    except UnitError:
        raise UnitError(f"unit {unit!r} is unknown; expected {describe(parse(si))}, such as {examples(si)}") from None
    wanted = parse(si)
    if given.dimension != wanted.dimension:
        raise UnitError(f"unit {unit!r} is that of {describe(given)}; expected {describe(wanted)}")
    return float(given.factor / wanted.factor)


def has_dimension(unit: str, si: str) -> bool:
    """Whether a unit is known and has the dimension of an SI unit."""
    return is_known(unit) and parse(unit).dimension == parse(si).dimension


def examples(si: str) -> str:
    """Common units of a dimension, for messages."""
    return EXAMPLES.get(si, si)


def is_known(unit: str) -> bool:
    """Whether a text is the symbol of a unit, as `plain_unit` returns it."""
    try:
        parse(unit)
    except UnitError:
        return False
    return unit != "1"


@lru_cache(maxsize=1)
def _capitals() -> dict[str, str]:
    """Units of lengths, times, forces and angles by their letters, in any case; none if two have the same."""
    found: dict[str, set[str]] = {}
    for si in ("m", "s", "N"):
        for name in spellings(parse(si)):
            stem = next((name.removesuffix(unit) for unit in ("gf", "lbf", "N", "m", "s") if name.endswith(unit)), "")
            if stem in SMALL or stem == name:
                found.setdefault(name.casefold(), set()).add(name)
    found |= {"deg": {"deg"}, "rad": {"rad"}}
    return {letters: min(names) for letters, names in found.items() if len(names) == 1}


def _may_end(unit: str) -> bool:
    """Whether a name may end in this unit without brackets."""
    if unit.endswith(("deg", "rad")) and is_known(unit):
        return True
    return is_known(unit) and parse(unit).dimension != ONE.dimension and any(has_dimension(unit, si) for si in ENDINGS)
