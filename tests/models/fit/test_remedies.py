"""A remedy of an error that is followed literally gives the right press or another refusal, never another number.

The files are drawn: names and units of columns in forms that are read and in forms that are not, signs, zeros, clocks.
"""

import re

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.sessions import SessionError
from palpate.studies.presses import PressReader

COUNT = 400  # files
TIME = 0.01 * np.arange(60)  # [s]
DEPTH = 1e-5 * (np.arange(60) - 20.0)  # [m]
FORCE = 1e3 * np.maximum(DEPTH, 0.0) ** 1.5 + 1e-5 * np.sin(37.0 * np.arange(60))  # [N]
FORMS = (
    "{0} [{1}]", "{0} ({1})", "{0}_{1}", "{0} in {1}", "{0}, {1}", "{0}/{1}", "{0}.{1}.", "{0}", "{0}{1}", "{0} <{1}>",
    "{0} ({1}) [raw]", "{0}:{1}", "{0}  {1}",
)  # fmt: skip
FORCES = {
    "N": 1.0, "mN": 1e-3, "uN": 1e-6, "kN": 1e3, "gf": 9.80665e-3, "lbf": 4.4482216, "lbs": 4.4482216, "KGF": 9.80665,
    "Newton": 1.0, "g": 9.80665e-3, "daN": 10.0,
}  # fmt: skip
LENGTHS = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "MM": 1e-3, "mil": 2.54e-5, "inch": 0.0254, "Micron": 1e-6, "nm": 1e-9}
TIMES = {"s": 1.0, "ms": 1e-3, "sec.": 1.0, "min": 60.0, "MSEC": 1e-3}
NAMES = {"force": ("Force", "force", "F", "Load", "Standardkraft", "Fz"), "depth": ("depth", "Depth", "d", "Weg"),
         "time": ("time", "t", "Zeit")}  # fmt: skip


def draw(rng):
    """Text of a file, options that name its columns, and its inverted columns."""
    cells, table, named = [], [], []
    flip = {key: bool(rng.uniform() < 0.2) for key in ("force", "depth")}
    for key, values, units in (("time", TIME, TIMES), ("depth", DEPTH, LENGTHS), ("force", FORCE, FORCES)):
        name, unit = str(rng.choice(NAMES[key])), str(rng.choice(list(units)))
        cell = str(rng.choice(FORMS)).format(name, unit)
        offset = float(rng.choice([0.0, -0.5, 2.0]) * np.ptp(values)) if key != "time" else 0.0
        sign = -1.0 if flip.get(key) else 1.0
        table.append((sign * values + offset) / units[unit])
        cells.append(cell)
        option = {"depth": "indentation"}.get(key, key)
        if name in ("Standardkraft", "Weg", "Zeit", "Fz") or rng.uniform() < 0.2:
            named.append(f"{option}={name if rng.uniform() < 0.5 else cells.index(cell) + 1}")
    rows = ["\t".join(f"{v:.9e}" for v in row) for row in np.transpose(table)]
    return "\n".join(["\t".join(cells), *rows]) + "\n", named


def remedies(text):
    """The options that an error proposes, as (columns, units), each followed literally."""
    found = [(match[1].split(","), None) for match in re.finditer(r"--columns ([^\s;]+)", text)]
    return found + [(None, match[1]) for match in re.finditer(r"--unit ([^\s;,.]+)", text)]


def follow(path, columns, units, left, texts):
    """Every press that is read after up to `left` remedies."""
    try:
        yield from PressReader(columns, units, False)(path)
    except SessionError as error:
        texts.append(str(error))
        for more, unit in remedies(str(error)) if left else ():
            yield from follow(path, more or columns, [*units, unit] if unit else units, left - 1, texts)


def test_a_remedy_that_is_followed_gives_the_right_press_or_another_refusal(tmp_path):
    rng = np.random.default_rng(79)
    path, texts, read = tmp_path / "press.csv", [], 0
    for number in range(COUNT):
        text, named = draw(rng)
        path.write_text(text, encoding="utf-8")
        for press in follow(path, named, [], 3, texts):
            read += 1
            assert np.ptp(press.force) == approx(np.ptp(FORCE), rel=2e-3), (number, text[:80], named, texts[-3:])
            assert np.ptp(press.depth) == approx(np.ptp(DEPTH), rel=1e-6), (number, text[:80], named, texts[-3:])
            assert press.force[-1] > press.force[0] and press.depth[-1] > press.depth[0]
    assert read > 0.25 * COUNT and len(texts) > 0.25 * COUNT
    assert not [text for text in texts if re.search(r"--unit \S+=(?!UNIT|gf|kgf)", text)]


PAIRS = ("Specimen", "Organ", "Mouse ID", "tissue", "Material", "Datei", "group", "Well", "rate (mm/s)", "Versuch, Nr.",
         "Press", "site")  # fmt: skip
"""Names of a column that says which of two specimens a row is of."""


def draw_two(rng):
    """Text of a table with two specimens, one twice as stiff, below each other or side by side, and options."""
    back = bool(rng.uniform() < 0.6)
    path = np.r_[DEPTH, DEPTH[::-1]] if back else DEPTH
    force = np.r_[FORCE, FORCE[::-1]] if back else FORCE
    time = [f"{0.01 * k:.2f}" for k in range(len(path))]
    if rng.uniform() < 0.2:  # days of Excel
        time = [f"{45366.25 + 0.01 * k / 86400.0:.10f}" for k in range(len(path))]
    presses = [[f"{t}\t{1e3 * d:.5f}\t{size * f:.8f}" for t, d, f in zip(time, path, force, strict=True)]
               for size in (1.0, 2.0)]  # fmt: skip
    head, options = "time\tdepth [mm]\tforce [N]", []
    if rng.uniform() < 0.25:
        return "\n".join([f"{head}\t{head}", *map("\t".join, zip(*presses, strict=True))]) + "\n", options, False
    name, labels = str(rng.choice(PAIRS)), ("1", "2") if rng.uniform() < 0.5 else ("A", "B")
    lines = [f"{label}\t{row}" for label, rows in zip(labels, presses, strict=True) for row in rows]
    if rng.uniform() < 0.3:
        options = ["force=4", "indentation=3"]
    return "\n".join([f"{name}\t{head}", *lines]) + "\n", options, True


def test_no_specimen_of_two_is_lost_and_none_has_the_force_of_the_other(tmp_path):
    """Each remedy followed: both presses, one of them where the user chose its columns, or another refusal."""
    rng = np.random.default_rng(80)
    path, texts, read = tmp_path / "press.csv", [], 0
    for number in range(150):
        text, named, both = draw_two(rng)
        path.write_text(text, encoding="utf-8")
        presses = list(follow(path, named, [], 3, texts))
        peaks = {round(float(np.ptp(press.force)) / np.ptp(FORCE)) for press in presses}
        assert peaks == {1, 2} if both else peaks <= {1, 2}, (number, text[:60], named, texts[-2:])
        for press in presses:
            read += 1
            assert np.ptp(press.depth) == approx(np.ptp(DEPTH), rel=1e-3), (number, text[:60])
            assert np.diff(press.time) == approx(0.01, rel=2e-3), (number, text[:60])
            size = round(float(np.ptp(press.force)) / np.ptp(FORCE))
            assert np.ptp(press.force) == approx(size * np.ptp(FORCE), rel=2e-3)
    assert read > 150 and any("with a press for each" in text for text in texts)


@pytest.mark.parametrize("offset", [-0.5, 3.0])
def test_a_zero_of_the_sensor_is_no_wrong_sign(tmp_path, offset):
    path = tmp_path / "press.csv"
    lines = [f"{t:.3f},{1e3 * d:.4f},{f + offset:.6f}" for t, d, f in zip(TIME, DEPTH, FORCE, strict=True)]
    path.write_text("\n".join(["t [s],d [mm],F [N]", *lines]))
    (press,) = PressReader([], [], False)(path)
    assert np.ptp(press.force) == approx(np.ptp(FORCE), rel=2e-3)


def test_both_signs_are_inverted_by_one_remedy(tmp_path):
    path = tmp_path / "press.csv"
    lines = [f"{-1e3 * d:.4f};{-f:.6f}" for d, f in zip(DEPTH, FORCE, strict=True)]
    path.write_text("\n".join(["Extension [mm];Load [N]", *lines]))
    with pytest.raises(SessionError, match=r"force and the indentation fall.*--columns force=-2,indentation=-1"):
        PressReader(["indentation=Extension"], [], False)(path)
    (press,) = PressReader(["force=-2", "indentation=-1"], [], False)(path)
    assert np.ptp(press.depth) == approx(np.ptp(DEPTH))
