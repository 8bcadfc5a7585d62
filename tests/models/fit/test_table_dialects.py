"""Tables as instruments write them: every dialect gives the same press, and every refusal names the line."""

import math

import numpy as np
import pytest
from pytest import approx
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.finger import read_presses as read_finger
from palpate.models.fit.sessions import SessionError, read_sessions
from palpate.models.fit.texture import fit_texture
from palpate.models.fit.tissue.measured import read_presses
from palpate.nodes.base import SettingError
from palpate.nodes.device.motion import read_motion
from palpate.nodes.device.replayed import Replayed

TIME = 0.01 * np.arange(60)
DEPTH = 1e-5 * (np.arange(60) - 20.0)  # [m]
FORCE = 1e3 * np.maximum(DEPTH, 0.0) ** 1.5 + 1e-5 * np.sin(37.0 * np.arange(60))  # [N]


def table(separator=",", header="t [s],d [mm],F [mN]", comma=False, scale=(1.0, 1e3, 1e3), end="\n"):
    rows = [
        separator.join(f"{value * factor:.6f}" for value, factor in zip(row, scale, strict=True))
        for row in zip(TIME, DEPTH, FORCE, strict=True)
    ]
    body = "\n".join(rows)
    return (
        (header if "\t" in header else header.replace(",", separator))
        + "\n"
        + (body.replace(".", ",") if comma else body)
        + end
    )


GF = (1.0, 1e3, 1 / 9.80665e-3)
META = "".join(f"Parameter {k};{k}\n" for k in range(67))
DIALECTS = {
    "decimal commas, semicolons": table(";", comma=True),
    "decimal commas, tabs": table("\t", comma=True),
    "Latin-1": table("\t", "Probe µm\nt [s],d [µm],F [mN]", scale=(1.0, 1e6, 1e3)).encode("latin-1"),
    "UTF-16": table("\t").encode("utf-16"),
    "UTF-16 without a mark": table("\t").encode("utf-16-le"),
    "a row of units": table(header="t,d,F\ns,mm,mN"),
    "a row of units in brackets": table("\t", "t,d,F\n[s],[mm],[mN]"),
    "a comma in a name": table("\t", "t\td, mm\tFz, gf", scale=GF),
    "a comma in a name, commas": table(header="t, s,d, mm,Fz, gf", scale=GF),
    "a quoted comma in a name": table(header='t,"d, mm","Fz, gf"', scale=GF),
    "kilogram-force": table(header="t [s],d [mm],F [kgf]", scale=(1.0, 1e3, 1 / 9.80665)),
    "a slash before the unit": table(header="t/s,d/mm,F/mN"),
    "blanks": table(" ", "t [s] d [mm] F [mN]"),
    "numpy.savetxt": table(" ", "# t [s] d [mm] F [mN]"),
    "names split by commas, rows by blanks": table(" ", "t [s];d [mm];F [mN]"),
    "JPK": table(" ", "# segment: extend\n# columns: t d F\n# units: s mm mN"),
    "a header on line 69": META + "\n" + table(";"),
    "a footer": table(";", end="\n;;\n\nEnd of test;;\nOperator;A. Smith;\n"),
    "empty last rows": table(",", end="\n,,\n,,\n"),
}


def saved(tmp_path, content):
    path = tmp_path / "press.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", DIALECTS)
def test_each_dialect_gives_the_same_press(tmp_path, name):
    (press,) = read_presses(saved(tmp_path, DIALECTS[name]), {}, {})
    assert len(press.depth) == 60
    assert press.time == approx(TIME) and press.depth == approx(DEPTH, abs=1e-9)
    assert press.force + press.zero == approx(FORCE, abs=2e-8 if "kilo" not in name else 1e-5)
    assert press.remarks[0].startswith("press.csv: time from 't")


def test_segments_and_a_repeated_time_stamp_are_one_press_with_notes(tmp_path):
    text = table(";")
    head, *rows = text.splitlines()
    segments = "\n".join([head, *rows[:40], head, *rows[40:]]) + "\n"
    (press,) = read_presses(saved(tmp_path, segments), {}, {})
    assert press.depth == approx(DEPTH, abs=1e-9) and "segments of one press" in press.remarks[1]
    rows[30] = rows[29].split(";")[0] + ";" + rows[30].split(";", 1)[1]
    (press,) = read_presses(saved(tmp_path, "\n".join([head, *rows])), {}, {})
    assert len(press.depth) == 59 and "row 32 repeats the time" in press.remarks[1]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (table(header="t [s],d [mm],F [mN]").replace("0.300000,", "0.3o,"), "row 32, column 't .s.': found '0.3o'"),
        (table(header="t [s],d [mm],F"), "row 1, column 'F': no unit; give it with --unit force=UNIT, with N, mN"),
        (table(header="approach [mm],d [mm],F [mN]"),
         r"row 1: 'approach \[mm\]' .column 1. and 'd \[mm\]' .column 2. both"),
        (table(header="t [s],d [mm],F [furlong]"), r"row 1, column 'F \[furlong\]': unit 'furlong' is unknown.*=UNIT$"),
        ("t [s],d [mm],F [mN]\n", "no rows after the header in row 1"),
        (table(comma=True), "decimal commas"),
        (b"\x00\x01\x02\x03", "not a text file"),
        ("", "cannot be read: empty"),
        ("t [s];d [mm];F [mN]\n" + "".join(f"{k};{k},000;{k},500\n" for k in range(1, 20)),
         "row 2: .*--dialect decimal"),
    ],
)  # fmt: skip
def test_a_refusal_names_the_line(tmp_path, text, expected):
    with pytest.raises(SessionError, match=expected):
        read_presses(saved(tmp_path, text), {}, {})


def test_an_open_dialect_is_chosen(tmp_path):
    rows = "".join(f"{k};{0.1 * k:.3f};{1 + k}.{100 + k}\n".replace(".", ",") for k in range(10, 40))
    path = saved(tmp_path, "t [s];d [mm];F [mN]\n" + rows)
    with pytest.raises(SessionError, match="row 2: found '11,110', a decimal comma or a separator of thousands"):
        read_presses(path, {}, {})
    (press,) = read_presses(path, {}, {}, "decimal-comma")
    assert press.depth[0] == approx(1e-3) and press.force[0] + press.zero == approx(11.110e-3)
    (press,) = read_presses(path, {}, {"indentation": "um"}, "decimal-point")
    assert press.depth[0] == approx(1e-3) and press.force[0] + press.zero == approx(11.110)


OPEN = {
    "force": ("subject;session;depth [um];force [N]", "a;1;0;0\na;1;1,500;1,125\na;1;2,500;1,250\n", "row 3"),
    "finger": ("travel [mm];force [N]", "".join(f"{k};1,{100 + k}\n" for k in range(40)), "row 2"),
    "texture": ("t;speed;normal;lateral", "0;1,234;1;1\n1;1,234;1;1\n", "row 2"),
}


@pytest.mark.parametrize("command", OPEN)
def test_every_command_that_reads_a_table_takes_the_dialect(tmp_path, command):
    head, rows, where = OPEN[command]
    path = saved(tmp_path, f"{head}\n{rows}")

    def call(*more):
        found = CliRunner().invoke(app, ["fit", command, str(path), *more])
        return unwrapped(found.output)

    question = "a decimal comma or a separator of thousands?"
    assert question in call() and f"{where}: found '1," in call() and "Set --dialect decimal-comma" in call()
    assert question not in call("--dialect", "decimal-comma") and question not in call("--dialect", "decimal-point")
    assert "--dialect: found 'comma', expected decimal-comma or decimal-point" in call("--dialect", "comma")


def test_the_dialect_decides_the_numbers_of_sessions_fingers_and_motions(tmp_path):
    path = saved(tmp_path, "subject;session;depth [um];force [mN]\na;1;0;0\na;1;1,500;1,125\na;1;2,500;1,250\n")
    for dialect, factor in (("decimal-comma", 1.0), ("decimal-point", 1000.0)):
        ((subject,), _) = read_sessions(path, dialect=dialect)
        assert subject.depth == approx(factor * np.array([0.0, 1.5e-6, 2.5e-6]))
        assert subject.force == approx(factor * np.array([0.0, 1.125e-3, 1.25e-3]))
    path = saved(tmp_path, "travel [mm];force [mN]\n" + "".join(f"{k / 10:g};{1 + k},{100 + k}\n" for k in range(40)))
    (press,) = read_finger(path, dialect="decimal-comma")
    assert press.force[-1] - press.force[-2] == approx(1.001e-3)
    path = saved(tmp_path, "t [ms]\tx [mm]\ty [mm]\tz [mm]\n0\t1,500\t0\t30\n10\t2,500\t0\t30\n")
    with pytest.raises(SettingError, match=r"row 2: found '1,500', .* Set dialect to decimal-comma or decimal-point"):
        read_motion(str(path))
    node = Replayed(path=str(path), dialect="decimal-comma")
    node.start()
    assert node.motion.values[:, 0] == approx([1.5e-3, 2.5e-3])
    assert read_motion(str(path), "decimal-point").values[:, 0] == approx([1.5, 2.5])
    node = Replayed(path=str(path), dialect="comma")
    with pytest.raises(SettingError, match="setting 'dialect': found 'comma', expected decimal-comma or decimal-point"):
        node.start()


def test_columns_are_chosen_by_number_and_files_need_no_header(tmp_path):
    path = saved(tmp_path, table(header="approach [mm],d [mm],F [mN]"))
    (press,) = read_presses(path, {"indentation": "2"}, {})
    assert press.depth == approx(DEPTH, abs=1e-9)
    np.savetxt(path, np.column_stack([TIME, 1e3 * DEPTH, 1e3 * FORCE]))
    numbers = {"time": "1", "indentation": "2", "force": "3"}
    (press,) = read_presses(path, numbers, {"indentation": "mm", "force": "mN"})
    assert press.depth == approx(DEPTH) and press.time == approx(TIME)


def test_sessions_strokes_and_motions_are_read_by_the_same_reader(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("made by X\nsubject;session;depth;force\n;;mm;gf\na;1;0;0,0\na;1;0,5;10,5\n", encoding="utf-16")
    ((subject,), _) = read_sessions(path)
    assert subject.depth == approx([0.0, 5e-4]) and subject.force == approx([0.0, 10.5 * 9.80665e-3])
    path.write_text(
        "t [ms]\tx [mm]\ty [mm]\tz [mm]\n0\t0,5\t0\t30\n10\t1,5\t0\t30\nend of motion\n", encoding="latin-1"
    )
    motion = read_motion(str(path))
    assert motion.times == approx([0.0, 0.01]) and motion.values[:, 0] == approx([5e-4, 1.5e-3])
    path.write_text("t,x,x,y,z\n0,0,0,0,0\n")
    with pytest.raises(SettingError, match="row 1: two columns 'x'"):
        read_motion(str(path))
    path.write_text("t,speed,normal,lateral\n" + "".join(f"{k / 1000},50,0.5,0.1\n" for k in range(2000)))
    with pytest.raises(
        SessionError, match=r"row 2, column 'speed': found 50 m/s, expected at most 5 m/s; name the unit"
    ):
        fit_texture(path)


def test_the_report_names_the_columns_and_hysteresis_needs_an_unloading(tmp_path):
    hold = "".join(f"{0.6 + 0.01 * k:.6f},0.390000,{1e3 * FORCE[-1]:.6f}\n" for k in range(10))
    path, other = saved(tmp_path, table(end="\n" + hold)), tmp_path / "deeper.csv"
    scale = (1.0, 2e3, 1e3 * 2**1.5)
    other.write_text(table(scale=scale))
    words = ["fit", "tissue", str(path), "--rig", "ball", "--radius", "30 mm", "--law", "hertz", "--force"]
    result = CliRunner().invoke(
        app, [*words, "--holdout", str(other), "-o", str(tmp_path / "out"), "--depth-limit", "0.3 mm"]
    )
    assert result.exit_code == 0, result.output
    report, output = (tmp_path / "out" / "report.md").read_text(), unwrapped(result.output)
    for text in (report, output):
        assert "indentation from 'd [mm]' times 0.001 m" in " ".join(text.split())
        assert "100 % of the work" not in text
    assert "% of the peak of the fitted presses" in output
    assert math.isfinite(float(output.split("held out, deeper.csv: RMS ")[1].split(" N")[0]))
