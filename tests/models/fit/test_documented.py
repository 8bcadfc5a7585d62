"""docs/fit_tissue.md lists what tables may contain; the readers take all of it, and it leaves nothing out."""

import re
from pathlib import Path

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.specimens import INDENTERS, PRESSES, SPECIMENS
from palpate.models.fit.tissue.table import NAMES, OTHERS
from palpate.physics.table_text import BINARY
from palpate.physics.table_times import are_days, is_clock, stamp_unit
from palpate.studies.presses import PressReader
from palpate.units.header import factor, split_unit
from palpate.units.quantity import parse
from palpate.units.symbols import spellings

PAGE = (Path(__file__).parents[3] / "docs" / "fit_tissue.md").read_text(encoding="utf-8")
ROWS = {
    cells[0]: cells[1]
    for line in PAGE[PAGE.index("## Tables that are read") : PAGE.index("## Many sparse probes")].splitlines()
    if len(cells := [cell.strip() for cell in line.strip("|").split(" | ")]) == 2
}


def listed(row):
    return re.findall(r"`([^`]+)`", ROWS[row])


@pytest.mark.parametrize(("row", "si"), [("lengths", "m"), ("forces", "N"), ("times", "s")])
def test_units_are_all_that_are_read_except_for_prefixes(row, si):
    """A unit with a prefix is listed if it is common."""
    known, bare = (
        spellings(parse(si)),
        {"m", "in", "mil", "ft", "Å", "N", "gf", "lbf", "ozf", "dyn", "kp", "s", "min", "h"},
    )
    assert set(listed(row)) <= set(known)
    assert {name for name in bare if name in known} <= set(listed(row))
    prefixed = {
        name for name in known if any(name != one and name.endswith(one) for one in ("m", "N", "gf", "lbf", "s"))
    }
    assert set(known) - prefixed <= set(listed(row))


def test_words_headers_clocks_and_angles_are_read():
    assert all(factor(unit, "rad") > 0.0 for unit in listed("angles"))
    dimensions = {si for word in listed("units in words and capitals") for si in "mNs" if _fits(word, si)}
    assert dimensions == set("mNs")
    for cell in listed("headers"):
        if cell not in ("Y_Unit_Label",):
            assert split_unit(cell) == ("Load", "N"), cell
    for cell in listed("times of a clock"):
        assert is_clock(cell) or stamp_unit(float(cell)) or are_days(float(cell) + 1e-6 * np.arange(9.0)), cell


def _fits(word, si):
    try:
        return factor(word, si) > 0.0
    except ValueError as error:
        assert "is that of" in str(error), word  # known, of another dimension
        return False


def test_names_of_columns_are_those_of_the_readers():
    assert {name.lower() for name in listed("names of quantities")} == {
        name for names in (*NAMES.values(), *OTHERS.values()) for name in names
    }
    ends, specimens = {"ID", "No.", "label"}, "columns whose values are a specimen each, which is fitted alone"
    assert set(listed(specimens)) - ends == set(SPECIMENS)
    repeats = set(listed("columns whose values are a press each of the same specimen")) - ends
    assert repeats | set(SPECIMENS) == set(PRESSES) and not repeats & set(SPECIMENS)
    assert set(listed("columns whose values must be one")) == set(INDENTERS)


def test_files_that_are_refused_are_listed_with_their_kind():
    kinds = " ".join(BINARY.values())
    for name in (".tdms", ".xls", "HDF5", "NanoScope"):
        assert name in ROWS["refused, with how to export them"] and name in kinds


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1", "shift-jis"])
@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
def test_encodings_and_separators_are_read(tmp_path, encoding, separator):
    assert encoding.lower() in ROWS["text"].lower()
    depth = np.linspace(-0.2, 0.4, 60)
    head = {"latin-1": "Prüfkraft", "shift-jis": "荷重試験"}.get(encoding, "Kraft") + "\n"
    rows = [f"{d:.4f}{separator}{max(d, 0) ** 1.5 + 1e-5 * (k % 3):.7f}" for k, d in enumerate(depth)]
    path = tmp_path / "press.csv"
    path.write_bytes((head + separator.join(["depth_mm", "load_N"]) + "\n" + "\n".join(rows)).encode(encoding))
    (press,) = PressReader([], [], False)(path)
    assert press.depth == approx(1e-3 * depth, abs=1e-7)
