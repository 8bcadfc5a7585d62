"""Tables with several presses, specimens or indenters: a press for each, or a refusal that names the column."""

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.finger import read_presses as read_finger
from palpate.models.fit.probes.read import read_probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.specimens import plain_name
from palpate.models.fit.texture import fit_texture
from palpate.models.fit.tissue.measured import read_presses

TIME = 0.01 * np.arange(60)
DEPTH = 1e-2 * (np.arange(60) - 20.0)  # [mm]
HEAD = "time [s],depth [mm],force [N]"


def rows(stiff=1.0, back=False):
    """Cells of a press; `back`: it returns."""
    depth = np.concatenate([DEPTH, DEPTH[::-1]]) if back else DEPTH
    time = 0.01 * np.arange(len(depth))
    force = stiff * np.maximum(depth, 0.0) ** 1.5 + 1e-4 * np.sin(37.0 * np.arange(len(depth)))
    return [f"{t:.3f},{d:.4f},{f:.6f}" for t, d, f in zip(time, depth, force, strict=True)]


def saved(tmp_path, lines):
    path = tmp_path / "press.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def peaks(presses):
    return [float(np.ptp(p.force)) for p in presses]


@pytest.mark.parametrize(
    "name", ["Specimen", "Sample", "Sample ID", "sampleId", "Specimen No.", "specimen_label", "Test", "Run #", "Person"]
)  # fmt: skip
@pytest.mark.parametrize("labels", [("A", "B"), ("1", "2"), ("12 kPa", "24 kPa")])
def test_each_specimen_is_a_press(tmp_path, name, labels):
    lines = [f"{HEAD},{name}"] + [f"{r},{k}" for k, s in zip(labels, (1.0, 2.0), strict=True) for r in rows(s, True)]
    presses = read_presses(saved(tmp_path, lines), {}, {})
    assert [p.name for p in presses] == [f"press.csv:{k}" for k in labels]
    assert peaks(presses) == approx([0.2435, 0.487], rel=0.01)
    # one after the other in each row, and named in the first row of each only
    mixed = [lines[0], *(line for pair in zip(lines[1:121], lines[121:], strict=True) for line in pair)]
    assert peaks(read_presses(saved(tmp_path, mixed), {}, {})) == approx([0.2435, 0.487], rel=0.01)
    sparse = [line if k in (0, 1, 121) else line.rpartition(",")[0] + "," for k, line in enumerate(lines)]
    assert peaks(read_presses(saved(tmp_path, sparse), {}, {})) == approx([0.2435, 0.487], rel=0.01)


@pytest.mark.parametrize("name", ["Tip", "Tip ID", "Indenter", "Cantilever", "Ball no."])
def test_two_indenters_are_refused_with_the_column(tmp_path, name):
    lines = [f"{HEAD},{name}"] + [f"{r},{k}" for k in "AB" for r in rows()]
    with pytest.raises(SessionError, match=f"column '{name}': pressed by A, B: two indenters mixed"):
        read_presses(saved(tmp_path, lines), {}, {})


@pytest.mark.parametrize("name", ["Organ", "Mouse ID", "Material", "filename", "rate"])
@pytest.mark.parametrize("back", [False, True])
def test_a_column_of_another_name_with_a_press_for_each_value_is_refused_with_it(tmp_path, name, back):
    """The second press counted as rows after the deepest one, where each of them returns."""
    lines = [f"{HEAD},{name}"] + [f"{r},{k}" for k, s in (("A", 1.0), ("B", 2.0)) for r in rows(s, back)]
    path = saved(tmp_path, lines)
    chosen = name if name != "Mouse ID" else "4"
    with pytest.raises(SessionError, match=f"column '{name}': found A, B, .* --columns specimen={chosen} fits each"):
        read_presses(path, {}, {})
    assert peaks(read_presses(path, {"specimen": chosen}, {})) == approx([0.2435, 0.487], rel=0.01)


@pytest.mark.parametrize("name", ["Cycle", "Segment", "temperature"])
def test_a_column_that_divides_a_press_or_measures_something_is_no_specimen(tmp_path, name):
    """Cycles of one specimen; a slow sensor that changes in the middle of a press."""
    change, cells = 60 if name == "temperature" else 120, rows(1.0, True) + rows(1.0, True)
    lines = [f"{0.01 * k:.2f},{row.partition(',')[2]},{36 + (k >= change)}" for k, row in enumerate(cells)]
    (press,) = read_presses(saved(tmp_path, [f"{HEAD},{name}", *lines]), {}, {})
    assert np.ptp(press.force) == approx(0.2435, rel=0.01)


def test_a_repeated_header_begins_a_press_or_a_segment(tmp_path):
    two = [HEAD, *rows(1.0, True), "", "second specimen", HEAD, *rows(2.0, True)]
    presses = read_presses(saved(tmp_path, two), {}, {})
    assert [p.name for p in presses] == ["press.csv:block 1", "press.csv:block 2"]
    assert peaks(presses) == approx([0.2435, 0.487], rel=0.01)
    assert any("blocks are read as 2 presses" in text for text in presses[0].remarks)
    whole = rows(1.0, True)
    segments = [HEAD, *whole[:60], "retract", HEAD, *whole[60:]]
    (press,) = read_presses(saved(tmp_path, segments), {}, {})
    assert len(press.depth) == 120 and any("segments of one press" in text for text in press.remarks)


def test_a_column_that_counts_rows_is_no_label(tmp_path):
    lines = [f"Sample,{HEAD}", *(f"{k},{r}" for k, r in enumerate(rows()))]
    (press,) = read_presses(saved(tmp_path, lines), {}, {})
    assert len(press.depth) == 60
    assert plain_name("Sample rate") == "sample rate" and plain_name("Test time") == "test time"


def test_other_readers_refuse_two_bodies(tmp_path):
    travel = np.linspace(0.0, 2.0, 60)
    pressed = [f"{s:.4f},{0.03 * np.expm1(1.2 * s):.6f}" for s in travel]
    lines = ["travel [mm],force [N],person", *(f"{r},{k}" for k in "AB" for r in pressed)]
    with pytest.raises(SessionError, match="column 'person': found A, B, expected the presses of one finger"):
        read_finger(saved(tmp_path, lines))
    blocks = ["travel [mm],force [N]", *pressed, "travel [mm],force [N]", *pressed]
    assert len(read_finger(saved(tmp_path, blocks))) == 2
    lines = ["t,speed,normal,lateral,specimen", *(f"{k / 1000},0.1,0.5,0.1,{'AB'[k % 2]}" for k in range(2000))]
    with pytest.raises(SessionError, match=r"column 'specimen'.*strokes over one texture"):
        fit_texture(saved(tmp_path, lines))
    probes = [f"{s},{p},{d},{1e-3 * d**1.5:.6f}" for s in "AB" for p in range(8) for d in range(10)]
    with pytest.raises(SessionError, match="column 'specimen' names more than one specimen"):
        read_probes(saved(tmp_path, ["specimen,probe,depth [mm],force [N]", *probes]), {}, {})
