"""Every reader of tables takes every unit of its dimension in every form of a header, and refuses contradictions."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.finger import read_presses as read_finger
from palpate.models.fit.sessions import SessionError, read_sessions
from palpate.models.fit.texture import fit_texture
from palpate.models.fit.tissue.measured import read_presses
from palpate.nodes.base import SettingError
from palpate.nodes.base.measured_map import measured_factor
from palpate.nodes.device.motion import read_motion
from palpate.physics.table_units import Units
from palpate.physics.texture.surface import _columns
from palpate.units.header import factor, split_unit
from palpate.units.quantity import parse
from palpate.units.symbols import spellings
from palpate.units.words import WORDS

FORMS = {
    "[]": "{0} [{1}]", "()": "{0} ({1})", "comma": "{0}, {1}", "slash": "{0}/{1}", "underscore": "{0}_{1}",
    "R": "{0}..{1}.", "in": "{0} in {1}", "wide": "{0}（{1}）", "below": "{0}", "comment": "{0}",
}  # fmt: skip
UNITS = {si: sorted(spellings(parse(si))) for si in ("m", "N", "s")}
UNITS["rad"] = ["rad", "mrad", "deg", "°"]
UNITS["m/s"] = ["m/s", "mm/s", "cm/s", "um/s", "in/s", "mm/min", "m/h"]


def test_words_are_units():
    assert all(parse(unit) for unit in WORDS.values())
    assert factor("grams force", "N") == approx(9.80665e-3) and factor("KGF", "N") == approx(9.80665)
    assert factor("sec.", "s") == 1.0 and factor("lbs", "N") == approx(4.4482216) and factor("daN", "N") == 10.0
    assert factor("MM", "m") == 1e-3 and factor("Inches", "m") == 0.0254 and factor("thou", "m") == 2.54e-5
    assert factor(".sec", "s") == 1.0 and factor("mils", "m") == 2.54e-5 and factor("MIL", "m") == 2.54e-5
    assert factor("kg-f", "N") == factor("KG F", "N") == factor("kgf", "N") and factor("lb f", "N") == factor(
        "lbf", "N"
    )
    assert split_unit("Time .sec") == split_unit("Time, .sec") == split_unit("Time (.sec)") == ("Time", "s")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("si", UNITS)
def test_every_unit_in_every_form_of_header(form, si):
    """Symbols without letters, such as °, need brackets or a row of units."""
    count = 0
    for unit in UNITS[si]:
        if form in ("underscore", "R", "in") and not unit.replace("/", "").isalpha():
            continue
        units = Units(1, [FORMS[form].format("depth", unit)])
        if form == "below":
            units.add_row(2, [unit])
        if form == "comment":
            units.add_text(0, f"depth in {unit}")
        assert units.names == ["depth"] and factor(units.of(0), si) == approx(float(parse(unit).factor)), unit
        count += 1
    assert count >= 3


def table(head, rows, form, units):
    """A file whose columns (name, SI unit, values) are in these units by SI unit."""
    cells = [FORMS[form].format(name, units[si]) for name, si in head]
    scaled = [
        [f"{value / factor(units[si], si):.9e}" for value, (_, si) in zip(row, head, strict=True)] for row in rows
    ]
    comments = [f"# {name} in {units[si]}" for name, si in head] * (form == "comment")
    below = ["\t".join(units[si] for _, si in head)] * (form == "below")
    return "\n".join([*comments, "\t".join(cells), *below, *map("\t".join, scaled)]) + "\n"


TIME = 0.001 * np.arange(1200)
DEPTH = 1e-6 * (np.arange(1200) - 200.0)
FORCE = 1e3 * np.maximum(DEPTH, 0.0) ** 1.5 + 1e-5 * np.sin(37.0 * np.arange(1200))


def press(path):
    (found,) = read_presses(path, {}, {})
    return np.array([np.ptp(found.time), np.ptp(found.depth), np.ptp(found.force)])


def finger(path):
    (found,) = read_finger(path)
    return np.array([found.travel[-1] - found.travel[0], found.force[-1]])


def sessions(path):
    path.write_text("\n".join(
        line if line.startswith("#") else f"{line}\t" + ("subject\tsession" if "depth" in line else "\t"
        if not any(c.isdigit() for c in line) else "a\t1") for line in path.read_text().splitlines()))  # fmt: skip
    ((found,), _) = read_sessions(path)
    return np.array([found.depth[-1], found.force[-1]])


def motion(path):
    found = read_motion(str(path))
    return np.array([found.times[-1], *found.values[-1]])


def profile(path):
    return _columns(path, "s", "height")[-1]


SMOOTH = np.arange(1.0, 61.0)
READERS = {
    "press": (press, [("t", "s"), ("d", "m"), ("F", "N")], np.transpose([TIME, DEPTH, FORCE])[::10]),
    "finger": (finger, [("travel", "m"), ("force", "N")], np.transpose([1e-5 * SMOOTH, 1e-4 * SMOOTH**2])),
    "sessions": (sessions, [("depth", "m"), ("force", "N")], np.transpose([1e-4 * SMOOTH, 1e-2 * SMOOTH])),
    "motion": (motion, [("t", "s"), ("x", "m"), ("y", "m"), ("z", "m")], 1e-3 * SMOOTH[:, None] * [1, 2, 3, 4]),
    "joints": (motion, [("t", "s"), ("joint1", "rad"), ("joint2", "rad")], 1e-3 * SMOOTH[:, None] * [1, 2, 3]),
    "profile": (profile, [("s", "m"), ("height", "m")], 1e-5 * SMOOTH[:, None] * [1, 2]),
}
CHOICES = {"s": ("s", "ms", "us", "min"), "m": ("m", "mm", "um", "cm", "in", "mil", "nm"),
           "N": ("N", "mN", "gf", "kgf", "lbf", "daN", "uN"), "rad": ("rad", "deg", "mrad")}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("reader", READERS)
def test_every_reader_in_every_form(tmp_path, reader, form):
    read, head, rows = READERS[reader]
    path = tmp_path / "table.csv"
    expected = None
    for k in range(7):
        units = {si: names[k % len(names)] for si, names in CHOICES.items()}
        path.write_text(table(head, rows, form, units), encoding="utf-8")
        found = read(path)
        expected = found if expected is None else expected
        assert found == approx(expected, rel=1e-6, abs=1e-9), (form, units)


def test_a_texture_and_a_map_take_other_units(tmp_path):
    rng, path = np.random.default_rng(1), tmp_path / "stroke.csv"
    rows = np.transpose([TIME, np.full(1200, 0.1), np.full(1200, 0.5), 0.1 + 0.01 * rng.standard_normal(1200)])
    head = [("t", "s"), ("speed", "m/s"), ("normal", "N"), ("lateral", "N")]
    for k, speed in enumerate(("m/s", "mm/min", "in/s")):
        units = {"s": CHOICES["s"][k], "N": CHOICES["N"][k], "m/s": speed}
        path.write_text(table(head, rows, "()", units), encoding="utf-8")
        (model,) = fit_texture(path).models
        assert (model.speed, model.force) == approx((0.1, 0.5), rel=1e-6)
    path.write_text("x [mm],y [mil],z [um],factor\n" + "".join(f"{k},{k / 0.0254},{1e3 * k},2\n" for k in range(6)))
    assert measured_factor(str(path), 1e-3 * np.array([[0.0, 0.0, 0.0], [3.0, 3.0, 3.0]])) == approx([2.0, 2.0])


ROWS = "".join(f"{t:.4f},{1e3 * d:.5f},{f:.7f}\n" for t, d, f in zip(TIME[::10], DEPTH[::10], FORCE[::10], strict=True))


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("t,d,Force (N)\n(s),(mm),(mN)\n", ("'N' in row 1 contradicts 'mN' in row 2", "F")),
        ("t [s],d [mm],Force [mN] [N]\n", ("'mN' in row 1 contradicts 'N' in row 1", "F")),
        ("# Force in mN\nt [s],d [mm],Force [N]\n", ("'N' in row 2 contradicts 'mN' in row 1", "F")),
        ("Force: mN\nt [s],d [mm],Force [N]\n", ("'N' in row 2 contradicts 'mN' in row 1", "F")),
        ("# unit of d = um\nt [s],d [mm],Force [N]\n", ("'mm' in row 2 contradicts 'um' in row 1", "d")),
        ("t [s],d (um),Force [N]\ns,mm,N\n", ("'um' in row 1 contradicts 'mm' in row 2", "d")),
    ],
)  # fmt: skip
def test_contradictory_units_are_refused_with_both(tmp_path, head, names):
    path = tmp_path / "press.csv"
    path.write_text(head + ROWS, encoding="utf-8")
    with pytest.raises(SessionError, match=names[0]):
        read_presses(path, {}, {})
    # the one that --unit gives is taken, with a remark
    ours = {"F": {"force": "mN"}, "d": {"indentation": "um"}}[names[1]]
    (found,) = read_presses(path, {}, ours)
    assert "replaces the two units of the file" in found.remarks[0]


@pytest.mark.parametrize(
    "head",
    ["t [s],d [mm],Force [N] [newton]\n", "# Force in N\nt (s),d [mm],Force (N)\n", "t,d [mm],Force [N]\ns,MM,Newton\n",
     "t [s],d [mm],Load (V),Load [N]\n"],
)  # fmt: skip
def test_units_that_agree_are_read(tmp_path, head):
    path = tmp_path / "press.csv"
    rows = (
        ROWS
        if "(V)" not in head
        else "".join(f"{r.rpartition(',')[0]},1,{r.rpartition(',')[2]}\n" for r in ROWS.split())
    )
    path.write_text(head + rows, encoding="utf-8")
    (found,) = read_presses(path, {}, {})
    assert np.ptp(found.force) == approx(np.ptp(FORCE[::10]), rel=1e-4)


def test_motions_and_maps_refuse_contradictions_too(tmp_path):
    path = tmp_path / "m.csv"
    path.write_text("t [s],x [mm],y [mm],z [mm]\ns,m,mm,mm\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(SettingError, match="'mm' in row 1 contradicts 'm' in row 2"):
        read_motion(str(path))


def test_names_that_end_like_units_keep_them():
    for cell in ("subject_A", "nx", "joint1", "field.wrench.force.z", "press_1", "Temp [°C]", "column 1", "probe x"):
        assert split_unit(cell)[0].split(" ")[0] == cell.split(" ")[0]
