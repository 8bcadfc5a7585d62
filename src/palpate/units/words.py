"""Units that are written out as words, in headers of tables and by people in settings."""

BASE = {
    "meter": "m", "metre": "m", "sec": "s", "second": "s", "newton": "N", "pascal": "Pa", "gram": "g", "hertz": "Hz",
    "joule": "J", "watt": "W", "volt": "V", "amp": "A", "ampere": "A", "liter": "L", "litre": "L", "radian": "rad",
}  # fmt: skip
PREFIXES = {
    "giga": "G", "mega": "M", "kilo": "k", "centi": "c", "milli": "m", "micro": "u", "nano": "n", "pico": "p", "": "",
}  # fmt: skip
WORDS = {
    "msec": "ms", "usec": "us", "nsec": "ns", "min": "min", "minute": "min", "hour": "h", "hr": "h", "micron": "um",
    "angstrom": "Å", "inch": "in", "inche": "in", "thou": "mil", "mil": "mil", "foot": "ft", "feet": "ft",
    "kg-f": "kgf", "kg f": "kgf", "lb-f": "lbf", "lb f": "lbf",
    "gram-force": "gf", "grams-force": "gf", "gram force": "gf", "grams force": "gf", "gmf": "gf",
    "kilogram-force": "kgf", "kilograms-force": "kgf", "lb": "lbf", "pound": "lbf", "pound-force": "lbf",
    "pounds-force": "lbf", "pound force": "lbf", "oz-force": "ozf", "dyne": "dyn", "kilopond": "kp",
    "degree": "deg", "percent": "%", "pct": "%",
} | {prefix + word: before + unit for prefix, before in PREFIXES.items() for word, unit in BASE.items()}  # fmt: skip
"""Symbols by their word, without a plural s. A pound in a table is the force of a load cell."""


def written(word: str) -> str:
    """The symbol of a unit that is written as this word, in any case, singular or plural; "": none."""
    lower = word.lower().rstrip(".")
    return WORDS.get(lower) or WORDS.get(lower.removesuffix("s")) or ""
