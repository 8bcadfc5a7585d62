"""The table of units equals the definitions, which are exact: the metre, kilogram and second, the international pound
(0.45359237 kg) and inch (0.0254 m), both of 1959, and the standard acceleration of gravity (9.80665 m/s², 1901)."""

from fractions import Fraction

import pytest

from palpate.drivers.sensors import netft
from palpate.units.quantity import convert, parse

POUND, INCH, FOOT, GRAVITY = Fraction("0.45359237"), Fraction("0.0254"), Fraction("0.3048"), Fraction("9.80665")
FORCES = {
    "N": Fraction(1), "mN": Fraction(1, 1000), "kN": Fraction(1000), "lbf": POUND * GRAVITY,
    "klbf": 1000 * POUND * GRAVITY, "kgf": GRAVITY, "gf": GRAVITY / 1000,
}  # fmt: skip
TORQUES = {
    "Nm": Fraction(1), "N-m": Fraction(1), "Nmm": Fraction(1, 1000), "N-mm": Fraction(1, 1000), "kNm": Fraction(1000),
    "kN-m": Fraction(1000), "lbf-in": FORCES["lbf"] * INCH, "lbf-ft": FORCES["lbf"] * FOOT,
    "kgf-cm": GRAVITY / 100,
}  # fmt: skip
LENGTHS = {"m": Fraction(1), "cm": Fraction(1, 100), "mm": Fraction(1, 1000), "um": Fraction(1, 10**6)}


def test_the_pound_force_has_its_exact_value():
    assert FORCES["lbf"] == Fraction("4.4482216152605") and 12 * INCH == FOOT


def test_the_units_of_a_net_ft_reach_its_scale():
    for force, newton in FORCES.items():
        for torque, newton_metre in TORQUES.items():
            page = f"<n><cfgcpf>1000</cfgcpf><cfgcpt>2000</cfgcpt><scfgfu>{force}</scfgfu><scfgtu>{torque}</scfgtu></n>"
            scale = netft.scale(page.encode())
            assert scale.force == pytest.approx(float(newton) / 1000, rel=2e-15)
            assert scale.torque == pytest.approx(float(newton_metre) / 2000, rel=2e-15)


@pytest.mark.parametrize("name", [*FORCES])
def test_the_parser_of_units_is_exact(name):
    assert parse(name).factor == FORCES[name]
    assert convert(f"2.5 {name}", "N") == float(Fraction("2.5") * FORCES[name])


@pytest.mark.parametrize(("name", "metre"), [("in", INCH), ("mil", INCH / 1000), *LENGTHS.items()])
def test_lengths_are_exact(name, metre):
    assert parse(name).factor == metre


@pytest.mark.parametrize(
    ("name", "unit", "size"),
    [
        ("ft", "m", FOOT), ("Å", "m", Fraction(1, 10**10)),
        ("ozf", "N", POUND * GRAVITY / 16), ("dyn", "N", Fraction(1, 10**5)), ("kp", "N", GRAVITY),
        ("Nmm", "N m", Fraction(1, 1000)), ("Nm", "J", Fraction(1)), ("bar", "Pa", Fraction(10**5)),
        ("L", "m^3", Fraction(1, 1000)), ("g", "kg", Fraction(1, 1000)), ("h", "s", Fraction(3600)),
        ("min", "s", Fraction(60)), ("%", "1", Fraction(1, 100)), ("W", "J/s", Fraction(1)), ("V", "W/A", Fraction(1)),
    ],
)  # fmt: skip
def test_every_unit_has_its_defined_size_and_dimension(name, unit, size):
    assert parse(name).factor == size
    assert convert(f"3 {name}", unit) == pytest.approx(float(3 * size), rel=1e-15)
