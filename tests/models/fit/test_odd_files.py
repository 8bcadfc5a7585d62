"""Odd files of instruments and spreadsheets: the right numbers, or a refusal with the line; never other numbers."""

import numpy as np
import pytest
from pytest import approx
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.finger import read_presses as read_finger
from palpate.models.fit.probes.read import read_probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.texture import fit_texture
from palpate.models.fit.tissue.measured import read_presses
from palpate.physics.table_numbers import number

TIME = 0.01 * np.arange(60)
DEPTH = 1e-5 * (np.arange(60) - 20.0)  # [m]
FORCE = 1e3 * np.maximum(DEPTH, 0.0) ** 1.5  # [N]
HEAD = ["t [ms]", "d [um]", "F [uN]"]
NUMBERS = np.transpose([1e3 * TIME, 1e6 * DEPTH, 1e6 * FORCE])  # up to 7701.9 uN


def lines(separator=";", head=HEAD, style="{:.3f}".format, before=(), below=(), end=()):
    rows = [separator.join(map(style, row)) for row in NUMBERS]
    return "\n".join([*before, separator.join(head), *below, *rows, *end]) + "\n"


def german(value):
    return f"{value:,.3f}".replace(",", "_").replace(".", ",").replace("_", ".")


def grouped(mark, comma=True):
    return lambda value: f"{value:,.3f}".replace(",", mark).replace(".", "," if comma else ".")


READ = {
    "thousands of Germany": lines(style=german),
    "thousands of Switzerland": lines(style=grouped("'", False)),
    "thousands of France": lines("\t", style=grouped("\u202f")),
    "thousands of France, no-break": lines(style=grouped("\u00a0")),
    "thousands of the USA, quoted": lines(",", style=lambda v: f'"{v:,.3f}"'),
    "decimal commas, quoted": lines(",", style=lambda v: f'"{v:.3f}"'.replace(".", ",")),
    "a typographic minus": lines(style=lambda v: f"{v:.3f}".replace("-", "−")),
    "MATLAB": lines("\t", ["% t [ms]", *HEAD[1:]]),
    "C comments": lines("\t", ["// t [ms]", *HEAD[1:]]),
    "a column called #": lines("\t", ["#", *HEAD], style=str).replace("#", "#", 1),
    "units in words": lines(head=["t (msec)", "d (Microns)", "F (Micronewton)"]),
    "units in words below": lines(head=["t", "d", "F"], below=["Milliseconds;Micrometer;Micronewtons"]),
    "a row of units for some columns": lines(head=["t [ms]", "d", "F"], below=[";um;uN"]),
    "channels, then units": lines(head=["t", "d", "F"], below=["ch1;ch2;ch3", "ms;um;uN"]),
    "padded by MATLAB": lines(end=["NaN;NaN;NaN"] * 30),
    "end of file of DOS": lines() + "\x1a",
    "an instruction to Excel": lines(before=["sep=;"], style=german),
    "fixed width": "".join(f"{t:>14}{d:>14}{f:>14}\n" for t, d, f in [HEAD, *NUMBERS.round(3)]),
}


def saved(tmp_path, content, name="press.csv"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(path):
    return read_presses(path, {}, {})


@pytest.mark.parametrize("name", READ)
def test_the_numbers_are_read(tmp_path, name):
    text = READ[name]
    if name == "a column called #":
        head, *rows = text.splitlines()
        text = "\n".join([head, *(f"{k}\t{row}" for k, row in enumerate(rows))]) + "\n"
    (press,) = read(saved(tmp_path, text))
    assert press.time == approx(TIME) and press.depth == approx(DEPTH, abs=1e-9)
    assert press.force + press.zero == approx(FORCE, abs=2e-9)


def whole(value):
    return f"{value:,.0f}".replace(",", ".")


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (lines(style=whole), r"row \d+: found '1.000', a decimal point or a separator of thousands\? Set --dialect"),
        (lines(style=lambda v: whole(v) if v > 999 else f"{v:.1f}".replace(".", ",")),
         "found '1.000', a decimal point or .* Other rows have decimal commas"),
        (lines("\t").replace("t [ms]\t", "", 1), "row 2: 3 cells, the header in row 1 has 2; name each column"),
        (lines(" ", ["time of test [ms]", "depth [um]", "force [uN]"]), "row 2: 3 cells, .* names without blanks"),
        (lines(end=["ERR;ERR;ERR"] * 6), "row 62, column 't .ms.': found 'ERR'"),
        (lines(end=["OVER;OVER"]).replace("390.000;7701.883", "390.000;OVER"), "row 61, column 'F"),
        (lines(head=["t", *HEAD[1:]]), "row 1, column 't': no unit; in s its rows would be 10 s apart.*UNIT"),
        (lines(head=["d [um]", "d [um]", "F [uN]"]), "--columns indentation=1$"),
        (lines(head=["t [ms]", "d [um]", "Load (g)"]), "a mass; expected a force. If it shows a weight: --unit .*=gf"),
        (lines(head=["t [ms]", "d [um]", "Load (Kg)"]), "'Kg' is unknown; .* If it shows a weight: --unit force=kgf$"),
        (lines(head=["t [ms]", "d [kg]", "F [N]"]), "a mass; expected a length$"),
        (lines(head=["t [ms]", "d [um]", "F [V]"]), "a voltage; expected a force$"),
        (lines().replace("\n300.000", "\n30\x000.000"), r"found the character '\\x00' in row 32"),
        (b"PK\x03\x04xl/workbook.xml", "workbook .*CSV"),
        (b"\r\n\r\n", "cannot be read: empty"),
        ("t;d;F\ns;mm;N\n", "no rows after the header in row 1"),
    ],
)  # fmt: skip
def test_what_may_be_wrong_is_refused(tmp_path, content, expected):
    with pytest.raises(SessionError, match=expected):
        read(saved(tmp_path, content))


def test_thousands_and_decimals_of_one_number():
    assert number("1.234.567,5", ",") == number("1,234,567.5") == number("1 234 567.5") == 1234567.5
    assert number("1.234", ",") == 1234.0 and number("1,234", ",") == 1.234
    assert number("-1’000,5", ",") == -1000.5 and number("− 1") is None and number("1 2") is None


@pytest.mark.parametrize(("unit", "noted"), [("mN", False), ("N", True), ("uN", True)])
def test_a_stiffness_of_no_soft_material_is_noted(tmp_path, unit, noted):
    path = saved(tmp_path, lines(head=["t [ms]", "d [um]", f"F [{unit}]"], style="{:.6f}".format))
    path.write_text("\n".join([(t := path.read_text().splitlines())[0], *(
        ";".join([*r.split(";")[:2], f"{float(r.split(';')[2]) / 1e3 + 1e-3 * (k % 3):.6f}"])
        for k, r in enumerate(t[1:]))]))  # fmt: skip
    words = [
        "fit",
        "tissue",
        str(path),
        "--rig",
        "ball",
        "--radius",
        "8 mm",
        "--law",
        "hertz",
        "-o",
        str(tmp_path / "o"),
    ]
    output = unwrapped(CliRunner().invoke(app, words).output)
    assert ("Are the units of force and indentation right?" in output) == noted


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("travel [mm],force [N]\n", "no rows after the header in row 1"),
        ("travel [mm],force [N],force [N]\n0,0,0\n", "row 1: two columns 'force'; expected one"),
    ],
)
def test_a_file_of_a_finger_is_refused(tmp_path, text, expected):
    with pytest.raises(SessionError, match=expected):
        read_finger(saved(tmp_path, text))


def test_lines_that_were_not_read_are_printed(tmp_path):
    travel = np.linspace(0.0, 2.0, 60)
    rows = "".join(f"{s:.4f};{0.03 * np.expm1(1.2 * s):.6f}\n" for s in travel)
    path = saved(tmp_path, f"travel [mm];force [N]\n{rows}\nOperator;A. Smith\n")
    result = CliRunner().invoke(app, ["fit", "finger", str(path)])
    assert result.exit_code == 0 and "press.csv: line 63 is after the table: not read" in result.output


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"t": lambda t: np.round(t, 1)}, "row 3, column 't': found a step of 0 s, expected equal steps"),
        ({"t": lambda t: t[::-1]}, "row 3, column 't': found a step of -0.001 s, expected equal steps"),
        ({"lateral": lambda f: 150.0 * f}, "column 'lateral': found 30 times the normal force, .*both units right"),
    ],
)
def test_a_stroke_with_a_wrong_clock_or_unit_is_refused(tmp_path, change, expected):
    count = 2000
    columns = {"t": 1e-3 * np.arange(count), "speed": np.full(count, 0.1), "normal": np.full(count, 0.5),
               "lateral": np.full(count, 0.1)}  # fmt: skip
    columns |= {name: how(columns[name]) for name, how in change.items()}
    path = tmp_path / "stroke.csv"
    np.savetxt(path, np.transpose(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    with pytest.raises(SessionError, match=expected):
        fit_texture(path)


@pytest.mark.parametrize(
    ("signs", "expected"),
    [((-1, 1), "--columns force=3,indentation=-2 inverts"), ((1, -1), "--columns force=-3,indentation=2 inverts")],
)
def test_probes_with_an_inverted_column_are_refused(tmp_path, signs, expected):
    rows = [f"{p},{signs[0] * d:.2f},{signs[1] * (1 + 0.1 * p) * d**1.5:.4f}" for p in range(10)
            for d in np.linspace(0.1, 2.0, 10)]  # fmt: skip
    path = saved(tmp_path, "probe,depth [mm],force [mN]\n" + "\n".join(rows))
    with pytest.raises(SessionError, match=expected):
        read_probes(path, {}, {})


def test_a_finger_whose_presses_are_pure_exponentials_has_no_stiffness_at_touch(tmp_path):
    """It printed finger_stiffness 3e-07 N/m with an interval of the same ends, and a command to run it."""
    travel = np.linspace(0.0, 2.0, 120)
    rows = "".join(
        f"{k},{s:.4f},{4e-3 * np.exp((1.5 + 0.1 * k) * s) * (s > 0.1):.7f}\n" for k in range(3) for s in travel
    )
    path = saved(tmp_path, "press,travel [mm],force [N]\n" + rows)
    output = " ".join(CliRunner().invoke(app, ["fit", "finger", str(path)]).output.split())
    assert "finger_stiffness not determined" in output and "before the first row" in output
    assert "palpate run" not in output
