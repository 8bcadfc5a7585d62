"""Quantities with units."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.units.quantity import UnitError, convert, is_quantity, parse
from palpate.units.symbols import symbol


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("6 mm", "m", 0.006),
        ("6mm", "m", 0.006),
        ("-2.5e1 µm", "m", -25e-6),
        ("0.4 kN/m", "N/m", 400.0),
        ("5 deg", "rad", math.radians(5)),
        ("180 °", "rad", math.pi),
        ("1 kHz", "Hz", 1000.0),
        ("1 kHz", "1/s", 1000.0),
        ("2 g/cm^3", "kg/m^3", 2000.0),
        ("3 N/mm²", "Pa", 3e6),
        ("4 mm2", "m^2", 4e-6),
        ("2 N s/m", "N s/m", 2.0),
        ("2 N·ms/mm", "N s/m", 2.0),
        ("9 J/(kg K)", "m^2/(s^2 K)", 9.0),
        ("1 m^(1/2)", "m^0.5", 1.0),
        ("100 m^0.5", "m^(1/2)", 100.0),
        ("3 km^-1", "1/m", 0.003),
        ("3 km⁻¹", "1/m", 0.003),
        ("2 min", "s", 120.0),
        ("5 %", "1", 0.05),
        ("7", "m", 7.0),
        ("12 mm", "mm", 12.0),
        ("12 m", "mm", 12000.0),
        ("3 kPa", "N/m^2", 3000.0),
        ("3 N/m^n", "N/m^n", 3.0),
    ],
)
def test_a_quantity_becomes_the_number_of_the_settings_unit(text, unit, value):
    assert convert(text, unit) == pytest.approx(value, rel=1e-15)


@given(st.decimals(allow_nan=False, allow_infinity=False, min_value=-1000, max_value=1000, places=4))
def test_millimetres_give_the_same_float_as_the_plain_number(number):
    assert convert(f"{number} mm", "m") == float(number.scaleb(-3))


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("6 s", "m", ["'6 s' [s], a time", "expected a length"]),
        ("6 N", "Pa", ["a force", "expected a pressure"]),
        ("6 m^7", "m", ["m^7", "expected a length"]),
        ("6 mn", "m", ["'mn': unknown", "did you mean 'mN'"]),
        ("many", "m", ["'many'", "'6 mm'"]),
        ("6 mm/", "m", ["missing at its end"]),
        ("6 (mm", "m", ["a ) is missing"]),
        ("6 mm)", "m", ["')' is out of place"]),
        ("6 /m", "1/m", ["'/' is out of place"]),
        ("6 ^2", "1", ["out of place"]),
        ("6 m^(1/0)", "m", ["power"]),
        ("6 m^99999999999", "m", ["too large"]),
        ("1e999 m", "m", ["too large"]),
        ("1e300 km^9", "m^9", ["too large"]),
        ("6 ((((m))))", "m", ["too many brackets"]),
        ("3 N/mm^n", "N/m^n", ["not understood"]),
        ("3 N/mm", "N/m^n", ["plain number, taken in N/m^n"]),
    ],
)
def test_a_wrong_quantity_is_an_error_with_both_dimensions(text, unit, words):
    with pytest.raises(UnitError) as error:
        convert(text, unit)
    for word in words:
        assert word in str(error.value)


def test_a_vanishing_number_is_zero():
    assert convert("1e-99999999 m", "m") == 0.0


@given(st.text(max_size=30))
def test_any_text_is_a_quantity_or_an_error(text):
    try:
        value = convert(text, "m")
    except UnitError:
        return
    assert math.isfinite(value)


@given(st.text(alphabet="mkNsg/^²()123 *·.-", max_size=20))
def test_any_text_is_a_unit_or_an_error(text):
    try:
        assert parse(text).factor > 0
    except UnitError:
        assert not is_quantity(f"1 {text}") or not text.strip()


@pytest.mark.parametrize(
    ("prefix", "power"), [("G", 9), ("M", 6), ("k", 3), ("c", -2), ("m", -3), ("u", -6), ("n", -9)]
)
def test_prefixes_are_powers_of_ten(prefix, power):
    assert float(symbol(f"{prefix}m").factor) == 10.0**power
