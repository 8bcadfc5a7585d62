"""Layouts of instruments and programs: the press of each file is read, or the file is refused with line and remedy."""

import gzip

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.sessions import SessionError
from palpate.studies.presses import PressReader

COUNT = 60
TIME = 0.01 * np.arange(COUNT)  # [s]
DEPTH = 1e-5 * (np.arange(COUNT) - 20.0)  # [m]
FORCE = 1.6e3 * np.maximum(DEPTH, 0.0) ** 1.5 + 2e-5 * np.sin(37.0 * np.arange(COUNT))  # [N]


def columns(time=1.0, depth=1e3, force=1.0):
    return np.transpose([time * TIME, depth * DEPTH, force * FORCE])


def rows(table, separator=",", style="{:.6f}", mark='"', quote=False, comma=False, form="{}"):
    lines = [
        separator.join(f"{mark}{style.format(v)}{mark}" if quote else style.format(v) for v in row) for row in table
    ]
    text = "".join(form.format(line) + "\n" for line in lines)
    return text.replace(".", ",") if comma else text


PLAIN = rows(columns())
GERMAN = rows(columns(), ";", comma=True).splitlines()
HEAD = "Time [s],Depth [mm],Force [N]\n"
SCAN = "Points, Elapsed Time , Disp , Load\n , sec , mm , N\n"
NUMBERED = [f"{k},{line}\n" for k, line in enumerate(PLAIN.splitlines())]
BLUEHILL = '"Specimen label","A1"\n\n"Time","Extension","Load"\n"(s)","(mm)","(N)"\n'
ZWICK = '"Prüfprotokoll"\n"Prüfer";"Müller"\n\n"Prüfzeit";"Standardweg";"Standardkraft"\n"s";"mm";"N"\n'
OPTICS11 = "Date\t12/11/2019\nTime\t10:22:01\n\nTip radius (um)\t25.5\nE[v=0.500] (Pa)\t10000.0\nModel: Hertz\n\n"
HYSITRON = "\nNumber of Points = 60\n\nDepth (nm)\tLoad (µN)\tTime (s)\tDepth (V)\tLoad (V)\n" + "".join(
    f"{d:.4f}\t{f:.6f}\t{t:.5f}\t1.2\t3.4\n" for t, d, f in columns(1.0, 1e9, 1e6)
)
JPK = "# segment: extend\n# columns: height vDeflection seriesTime\n# units: m N s\n"
JPK_COLUMNS = "indentation=height,force=vDeflection,time=seriesTime"
LVM = (
    "LabVIEW Measurement\t\nSeparator\tTab\nDate\t2019/11/02\nTime\t10:22:01.5\n***End_of_Header***\t\n\t\n"
    "Samples\t60\t60\t\nX0\t0.0\t0.0\t\n***End_of_Header***\t\t\t\nX_Value\tDepth\tForce\tComment\n"
)
IGOR = (
    "IGOR\nWAVES/D\tt\tdepth\tforce\nBEGIN\n" + rows(columns(), "\t", form="\t{}") + 'END\nX SetScale/P x 0,1,"", t\n'
)
FRENCH = "".join(
    ";".join(f"{v:,.3f}".replace(",", "\u202f").replace(".", ",") for v in row) + "\n" for row in columns(1.0, 1e6, 1e3)
)
TWICE = "Time,Depth,Load,Time,Depth,Load\ns,mm,N,s,mm,N\n" + "".join(
    f"{line},{line}\n" if k < 40 else f"{line},,,\n" for k, line in enumerate(PLAIN.splitlines())
)
MTS = "MTS793|BTW|ENU|1|2|.|/|:|1|1|0|A\n\n" + "".join(
    f"Data Acquisition: Timed\tTime:\t{begin}.5\tSec\nAxial Displacement\tAxial Force\tTime\nmm\tN\tSec\n"
    + rows(columns()[begin : begin + 30][:, [1, 2, 0]], "\t") + "\n" for begin in (0, 30)
)  # fmt: skip
MACH = "<Mach-1 File>\n<INFO>\nTime:\t10:22:01 AM\nSoftware Version:\t3.2\n<END INFO>\n\n" + "".join(
    f"<{name}>\nStage Axis:\tPosition (z)\nDirection:\tPositive\nStage Velocity, mm/s:\t0.5\nStop Criteria, N:\t0.1\n"
    "<DATA>\nTime, s\tPosition (z), mm\tFz, gf\n"
    + rows(columns(force=1 / 9.80665e-3)[begin : begin + 30], "\t", "{:.9f}") + "<END DATA>\n\n"
    for name, begin in (("Find Contact", 0), ("Stress Relaxation", 30))
)  # fmt: skip
ROSBAG = "%time,field.header.seq,field.wrench.force.z,field.pose.z\n" + "".join(
    f"{1710547199123456789 + round(1e9 * t)},{k},{f:.6f},{d:.4f}\n" for k, (t, d, f) in enumerate(columns())
)
READ = {
    "Bose": (SCAN + "".join(NUMBERED), "time=Elapsed Time,indentation=Disp"),
    "Bose, two scans": ("Scan 1\n" + SCAN + "".join(NUMBERED[:30]) + "\nScan 2\n" + SCAN + "".join(NUMBERED[30:]),
                        "time=Elapsed Time,indentation=Disp"),
    "Bluehill": (BLUEHILL + rows(columns(), quote=True), "indentation=Extension"),
    "Bluehill, compression negative": (BLUEHILL + rows(columns() * [1, -1, -1], quote=True),
                                       "indentation=-Extension,force=-Load"),
    "Bluehill, kN": ('"Time (sec)","Extension (mm)","Load (kN)"\n'
                     + rows(columns(force=1e-3), style="{:.9f}", quote=True), "indentation=Extension"),
    "inches and pounds": ("Time (s),Depth (inches),Load (lbf)\n"
                          + rows(columns(1.0, 1 / 25.4e-3, 1 / 4.4482216), style="{:.9f}"), ""),
    "thousandths of an inch": ("Time (s),Depth (mil),Load (N)\n" + rows(columns(1.0, 1 / 25.4e-6)), ""),
    "Zwick, Latin-1": ((ZWICK + rows(columns(), ";", comma=True)).encode("latin-1"),
                       "time=Prüfzeit,indentation=Standardweg,force=Standardkraft"),
    "Zwick, UTF-16": ((ZWICK + rows(columns(), ";", comma=True)).encode("utf-16"),
                      "time=Prüfzeit,indentation=Standardweg,force=Standardkraft"),
    "MTS": ("MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Header:\tTime:\t1.2\tSec\nAxial Displacement\tAxial Force\tTime\n"
            "mm\tN\tSec\n" + rows(columns()[:, [1, 2, 0]], "\t"), "indentation=Axial Displacement,force=Axial Force"),
    "TA.XTplus": ("Batch,TPA1\nTest ID,Time,Distance,Force\n,sec,mm,N\n" + rows(columns(), form="1,{}"),
                  "indentation=Distance"),
    "Optics11": ((OPTICS11 + "Time (s)\tLoad (µN)\tIndentation (nm)\tPiezo (nm)\n"
                  + "".join(f"{t:.4f}\t{f:.5f}\t{d:.3f}\t{d:.3f}\n" for t, d, f in columns(1.0, 1e9, 1e6))
                  ).encode("latin-1"), ""),
    "Hysitron: volts are no depth": (HYSITRON, ""),
    "Hysitron, by number": (HYSITRON, "indentation=1,force=2"),
    "Anton Paar": ('"Time";"Pd";"Fn"\n"[s]";"[nm]";"[mN]"\n'
                   + rows(columns(1.0, 1e9, 1e3), ";", quote=True, comma=True), ""),
    "JPK": (JPK + rows(columns(1.0, 1.0)[:, [1, 2, 0]], " ", "{:.9e}"), JPK_COLUMNS),
    "JPK, two segments": ("\n".join([JPK + rows(columns(1.0, 1.0)[:40, [1, 2, 0]], " ", "{:.9e}"),
                                     JPK + rows(columns(1.0, 1.0)[40:, [1, 2, 0]], " ", "{:.9e}")]), JPK_COLUMNS),
    "LabVIEW": (LVM.replace("Depth", "Depth [mm]").replace("Force", "Force [N]") + rows(columns(), "\t", form="{}\t"),
                "time=X_Value"),
    "Igor": (IGOR.replace("depth", "depth [mm]").replace("force", "force [N]"), ""),
    "R, row names": ('"time [s]" "depth [mm]" "force [N]"\n'
                     + "".join(f'"{k + 1}" {line}\n' for k, line in enumerate(PLAIN.replace(",", " ").splitlines())),
                     ""),
    "R, csv2": ('"";"time [s]";"depth [mm]";"force [N]"\n'
                + "".join(f'"{k + 1}";{line}\n' for k, line in enumerate(GERMAN)), ""),
    "Excel, Unicode text": (("Time [s]\tDepth [mm]\tForce [N]\n" + rows(columns(), "\t", comma=True)
                             ).encode("utf-16"), ""),
    "France": ("Temps (s);Profondeur (µm);Force (mN)\n" + FRENCH, "time=Temps,indentation=Profondeur"),
    "bars": ("time [s]|depth [mm]|force [N]\n" + rows(columns(), "|"), ""),
    "Markdown": ("| time [s] | depth [mm] | force [N] |\n|---|---|---|\n" + rows(columns(), " | ", form="| {} |"), ""),
    "whole rows quoted": (f'"{HEAD.strip()}"\n' + rows(columns(), form='"{}"'), ""),
    "whole rows quoted below a plain header": (HEAD + rows(columns(), form='"{}"'), ""),
    "quotes in a quoted row": ('"Time [s],""Depth [mm]"",Force [N]"\n' + rows(columns(), form='"{}"'), ""),
    "single quotes": ("'time [s]','depth [mm]','force [N]'\n" + PLAIN, ""),
    "two header lines": ("Time,Indentation,Normal\nt (s),depth (mm),force (N)\n" + PLAIN, ""),
    "a comment between rows": (HEAD + rows(columns()[:30]) + "# cough\n" + rows(columns()[30:]), ""),
    "MTS, two blocks": (MTS, "indentation=Axial Displacement,force=Axial Force"),
    "Mach-1, two functions": (MACH, "indentation=Position (z)"),
    "rosbag": (ROSBAG, "time=%time,force=field.wrench.force.z,indentation=field.pose.z",
               ("field.wrench.force.z=N", "field.pose.z=mm")),
    "rosbag, plain names": ("%time,field.header.seq,field.force [N],field.depth [mm]\n" + ROSBAG.split("\n", 1)[1], ""),
    "stamps": ("Timestamp,Depth [mm],Force [N]\n" + "".join(
        f"2024-03-15 10:22:{1 + t:09.6f},{d:.4f},{f:.6f}\n" for t, d, f in columns()), ""),
    "stamps in Excel": ("Time stamp (s);Depth [mm];Force [N]\n" + "\n".join(GERMAN) + "\n", ""),
    "stamps next to a time": ("Time [s],Timestamp,Depth [mm],Force [N]\n" + "".join(
        f"{t:.6f},{9 + k // 7},{d:.4f},{f:.6f}\n" for k, (t, d, f) in enumerate(columns())), ""),
    "elapsed time": (HEAD.replace("Time [s]", "Elapsed Time (sec.)") + PLAIN, ""),
    "LabVIEW, decimal commas and a row of units": (
        LVM.replace("X0\t0.0", "Y_Unit_Label\tmm\tNewton\t\nX0\t0.0").replace(".", ",")
        + rows(columns(), "\t", form="{}\t", comma=True), ""),
    "Shift-JIS": (("試験名,圧縮\n時間(s),変位(mm),荷重(N)\n" + PLAIN).encode("cp932"),
                  "time=時間,indentation=変位,force=荷重"),
    "Shift-JIS, wide brackets": (("時間（s）,変位（mm）,荷重（N）\n" + PLAIN).encode("cp932"),
                                 "time=時間,indentation=変位,force=荷重"),
    **{f"lbf and mil, {form}": (f"Time,Depth{form},Load{form}\n".replace("#", "mil", 1).replace("#", "lbf")
                               .replace("Time", "Time" + form.replace("#", "sec."))
                               + rows(columns(1.0, 1 / 25.4e-6, 1 / 4.4482216152605), style="{:.9f}"), "")
       for form in (" [#]", " (#)", "_#", ", #", "/#", " in #")},
    **{unit: (f"Time (SEC),Depth (MM),Load ({unit})\n" + rows(columns(force=1 / size), style="{:.9f}"), "")
       for unit, size in (("KGF", 9.80665), ("lbs", 4.4482216152605), ("daN", 10.0), ("grams force", 9.80665e-3))},
    "Latin-1 with letters that are kanji in Shift-JIS": (
        ("Time [s],D\xe9placement [mm],Force pr\xe9lev\xe9e [N]\n" + PLAIN).encode("latin-1"),
        "time=Time,indentation=D\xe9placement,force=Force pr\xe9lev\xe9e"),
    "specimens side by side": (TWICE, "time=1,indentation=2,force=3"),
}  # fmt: skip


def read(tmp_path, content, names="", units=()):
    path = tmp_path / "press.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return PressReader(names.split(","), units, False)(path)


@pytest.mark.parametrize("name", READ)
def test_the_press_is_read(tmp_path, name):
    (press,) = read(tmp_path, *READ[name])
    assert press.time - press.time[0] == approx(TIME, abs=2e-6) and press.depth == approx(DEPTH, abs=3e-8)
    assert press.force + press.zero == approx(FORCE, abs=1e-6)


@pytest.mark.parametrize(
    ("head", "separator", "found"),
    [
        ("時間 [s],変位 Depth [mm],荷重 Force [N]", ",", "force and indentation"),
        ("Stage Velocity, mm/s:\t0.1\n<DATA>\nTime, s\tPosition (z), mm\tFz, N", "\t", "indentation"),
        ("Axis Time [s];Axis Depth [mm];Cell Force [N]", ";", "force and indentation"),
    ],
)
def test_a_header_is_divided_like_the_rows_below_it(tmp_path, head, separator, found):
    """Blanks and commas of the names divided it: the message was about cells of row 2, and columns by number read 'z'
    as a unit."""
    table = head + "\n" + rows(columns(), separator)
    with pytest.raises(SessionError, match=f"no header with a column for {found}; found .* in row .[.] Name them"):
        read(tmp_path, table)
    (press,) = read(tmp_path, table, "time=1,indentation=2,force=3")
    assert press.depth == approx(DEPTH, abs=3e-8) and press.force + press.zero == approx(FORCE, abs=1e-6)


def spoilt(token):
    lines = PLAIN.splitlines()
    lines[30] = f"{lines[30].rpartition(',')[0]},{token}"
    return HEAD + "\n".join(lines)


@pytest.mark.parametrize(
    "token", ["-1.#IND", "1.#QNAN", "NaN", "-Inf", "n/a", "#N/A", "--", "", "OVLD", "1e400", "1_0"]
)
def test_a_missing_value_is_refused_with_its_row_and_a_remedy(tmp_path, token):
    with pytest.raises(SessionError, match=r"row 32, column 'Force \[N\]': found .*delete"):
        read(tmp_path, spoilt(token))


@pytest.mark.parametrize(
    ("content", "names", "expected"),
    [
        (HEAD + "#N/A,0,0\n" + PLAIN, "", "row 2, column 'Time .s.': found '#N/A'"),
        (ZWICK + PLAIN.replace(",", ";"), "", r"found 'Prüfzeit;Standardweg;Standardkraft' in row 4. Name them"),
        (LVM + rows(columns(), "\t"), "", "row 10, column 'Force': no unit; give it with --unit force=UNIT, with N"),
        (TWICE, "", r"row 1: 'Time' \(column 1\) and 'Time' \(column 4\) both name the time.*--columns time=1"),
        ("Time (s),Depth (mm),Load (stones)\n" + PLAIN, "", "'stones' is unknown.*Give it with --unit force=UNIT"),
        ("Time (s),Depth (mm),Load (g)\n" + PLAIN, "", "a mass; expected a force. If it .*: --unit force=gf"),
        ("Time (s),Depth (mm),Load (kPa)\n" + PLAIN, "", "a pressure or modulus; expected a force"),
        (HEAD + rows(columns() * [1, 1, -1]), "", "falls in the press; --columns time=1,force=-3,indentation=2 inv"),
        (HEAD + rows(columns() * [1, -1, 1] + [0, 50, 0]), "", "--columns time=1,force=3,indentation=-2 inverts it"),
        ("Depth [mm],Force [N]\n" + rows(columns()[:, 1:]) * 2, "", "row 62: the indentation falls .* column `press`"),
        (HEAD + rows(columns(), style="{:.5e}").replace("e", "D"), "", r"row 2, column .*: found '0.00000D\+00'"),
        (gzip.compress(b"t,d,F\n0,0,0\n", mtime=0), "", "compressed; save its table as CSV"),
        (b"\xd0\xcf\x11\xe0" + bytes(99), "", r"a workbook \(.xls\); save it as .xlsx or CSV"),
        (b"MATLAB 5.0 MAT-file" + bytes(99), "", r"a file of MATLAB \(.mat\) that cannot be read.* as CSV"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_with_a_remedy(tmp_path, content, names, expected):
    with pytest.raises(SessionError, match=expected):
        read(tmp_path, content, names)


def test_a_line_of_text_above_the_numbers_and_one_below_are_listed(tmp_path):
    (press,) = read(tmp_path, *READ["Igor"])
    assert press.remarks[1:] == (
        "press.csv: line 3 is above the numbers: not read", "press.csv: lines 64 to 65 are after the table: not read",
    )  # fmt: skip


def test_workbooks_and_files_of_matlab_are_tables(tmp_path):
    openpyxl, savemat = pytest.importorskip("openpyxl"), pytest.importorskip("scipy.io").savemat
    book = openpyxl.Workbook()
    for row in (["Zwick"], ["Time (s)", "Depth (mm)", "Force (N)"], *columns().tolist()):
        book.active.append(row)
    book.create_sheet("Notes").append(["nothing"])
    book.save(tmp_path / "press.xlsx")
    savemat(tmp_path / "press.mat", {"t": TIME, "Depth_mm": 1e3 * DEPTH, "force": FORCE, "name": "x", "rate": 100.0})
    savemat(tmp_path / "struct.mat", {"run": {"t": TIME, "Depth_mm": 1e3 * DEPTH, "force_N": FORCE}})
    for name, units in (("press.xlsx", ()), ("press.mat", ("force=N",)), ("struct.mat", ())):
        (press,) = PressReader([], units, False)(tmp_path / name)
        assert press.depth == approx(DEPTH, abs=1e-9) and press.force + press.zero == approx(FORCE, abs=1e-9)
    savemat(tmp_path / "matrix.mat", {"data": columns()})  # columns by number, which read (1) as a unit
    numbers = ["time=1", "indentation=2", "force=3"]
    with pytest.raises(SessionError, match="column 'data 3': no unit; give it with --unit 3=UNIT"):
        PressReader(numbers, (), False)(tmp_path / "matrix.mat")
    (press,) = PressReader(numbers, ("1=s", "2=mm", "3=N"), False)(tmp_path / "matrix.mat")
    assert press.depth == approx(DEPTH, abs=1e-9)
    with pytest.raises(SessionError, match="column 'force': no unit; give it with --unit force=UNIT"):
        PressReader([], (), False)(tmp_path / "press.mat")
    for row in columns().tolist():
        book["Notes"].append(row)
    book.save(tmp_path / "press.xlsx")
    with pytest.raises(
        SessionError, match="numbers in the sheets Sheet, Notes, expected one sheet with numbers; save it"
    ):
        PressReader([], (), False)(tmp_path / "press.xlsx")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"TDSm" + bytes(100), r"LabVIEW \(.tdms\); save its table as CSV, .*npTDMS"),
        (b"\x89HDF\r\n" + bytes(100), "MATLAB 7.3.; save its table as CSV"),
        (b"\\*File list\r\n\\Version: 1\r\n\x1a\0\0\1\2" * 9, "atomic force microscope .NanoScope.; export its curve"),
        (np.arange(3000, dtype="<i2").tobytes(), "not a text file in UTF-8.*; save its table as text"),
        (np.random.default_rng(1).integers(0, 2**16, 3000).astype("<u4").tobytes(), "not a text file in UTF-8"),
    ],
)
def test_a_binary_file_is_refused_without_advice_about_columns(tmp_path, content, message):
    (tmp_path / "press.dat").write_bytes(content)
    with pytest.raises(SessionError, match=message) as error:
        PressReader([], (), False)(tmp_path / "press.dat")
    assert "--columns" not in str(error.value)
