"""The folder of an experiment: rows, recovery after a power cut, participants."""

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from palpate.physics.errors import ArgumentError
from palpate.studies.psychophysics.cells import decode_row
from palpate.studies.psychophysics.file import ANSWERS, stored_answer
from palpate.studies.psychophysics.store import COLUMNS, Table, begin, parse, sessions

ROW = {"block": "main", "track": 1, "level": 4e3, "interval": 2, "response": "first", "hit": 1, "response_time": "0.5"}


@pytest.fixture
def filled(tmp_path):
    """The path of a table with three rows."""
    table = Table(tmp_path, "soft", "01", 1)
    for number in (1, 2, 3):
        table.add({"trial": number, **ROW})
    table.close()
    return table.path


def test_a_table_has_a_row_for_each_trial_in_the_order_of_bids(filled, tmp_path):
    assert filled == tmp_path / "sub-01/ses-01/beh/sub-01_ses-01_task-soft_beh.tsv"
    head, *rows = filled.read_text().splitlines()
    assert head.split("\t") == list(COLUMNS) and len(rows) == 3
    assert rows[1].split("\t")[:8] == ["2", "main", "1", "4000.0", "n/a", "2", "first", "1"]


@pytest.mark.parametrize("cut", range(1, 60, 3))
def test_after_a_power_cut_all_complete_trials_are_recovered(filled, tmp_path, cut):
    whole = filled.read_bytes()
    filled.write_bytes(whole[:-cut])
    table = Table(tmp_path, "soft", "01", 1)
    rows = [line for line in whole[:-cut].split(b"\n")[1:-1] if line]
    assert [row["trial"] for row in table.rows] == [str(n + 1) for n in range(len(rows))]
    assert table.recovered is not None and table.recovered.read_bytes() == whole[:-cut]
    table.add({"trial": len(rows) + 1, **ROW})
    table.close()
    assert parse(filled.read_bytes())[1] == len(filled.read_bytes())


@pytest.mark.parametrize("left", [b"\0" * 40, b"4\tmain\n", b"\xff\xfe", b"9\t" + b"\t" * 11 + b"\n"])
def test_invalid_bytes_are_moved_to_another_file(filled, tmp_path, left):
    filled.write_bytes(filled.read_bytes() + left)
    table = Table(tmp_path, "soft", "01", 1)
    assert len(table.rows) == 3 and table.recovered is not None
    table.close()
    again = Table(tmp_path, "soft", "01", 1)
    assert again.recovered is None
    again.close()


def test_a_session_can_be_opened_by_one_process_only(filled, tmp_path):
    table = Table(tmp_path, "soft", "01", 1)
    with pytest.raises(ArgumentError, match="another `palpate experiment` has this session open"):
        Table(tmp_path, "soft", "01", 1)
    table.close()


def test_the_data_dictionary_describes_each_column(filled, tmp_path):
    table = Table(tmp_path, "soft", "01", 1)
    table.describe({"level": {"Units": "m"}})
    table.close()
    printed = json.loads(filled.with_suffix(".json").read_text())
    assert list(printed) == list(COLUMNS) and all(entry["Description"] for entry in printed.values())
    assert printed["level"]["Units"] == "m" and printed["response_time"]["Units"] == "s"


def test_participants_are_listed_once_and_columns_are_added(tmp_path):
    begin(tmp_path, "soft", b"a", "01", {"age": 30})
    begin(tmp_path, "soft", b"a", "02", {"hand": "left"})
    begin(tmp_path, "soft", b"a", "01", {"age": 99})
    lines = (tmp_path / "participants.tsv").read_text().splitlines()
    assert lines == ["participant_id\tage\thand", "sub-01\t30\tn/a", "sub-02\tn/a\tleft"]
    assert json.loads((tmp_path / "dataset_description.json").read_text())["DatasetType"] == "raw"


def test_an_experiment_with_trials_is_not_replaced(filled, tmp_path):
    begin(tmp_path, "soft", b"a", "01", {})
    begin(tmp_path, "other", b"b", "01", {})
    with pytest.raises(ArgumentError, match="another version of this experiment"):
        begin(tmp_path, "soft", b"b", "01", {})


def test_sessions_of_a_task_are_found(filled, tmp_path):
    Table(tmp_path, "soft", "01", 7).close()
    Table(tmp_path, "other", "01", 3).close()
    assert sessions(tmp_path, "soft", "01") == [1, 7] and sessions(tmp_path, "soft", "02") == []


ANY = st.text(st.characters(codec=None), max_size=8)  # with surrogates, tabs and line breaks
NUMBERS = st.tuples(st.sampled_from(["", " ", "\t", "\n", "\u2003"]), st.floats().map(repr), ANY).map("".join)
WORDS = st.sampled_from([word for answers in ANSWERS.values() for word in answers])


def read_back(folder):
    table = Table(folder, "soft", "01", 1)
    table.close()
    assert table.recovered is None
    return table.rows


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(list(ANSWERS)), st.one_of(ANY, NUMBERS, WORDS))
@example("magnitude", "5\t")
@example("magnitude", "\n5")
@example("magnitude", "1_000")
@example("magnitude", "\uff15")
@example("magnitude", "1e400")
@example("2afc", "first\t")
def test_an_answer_that_is_accepted_is_read_back_equal(response, answer):
    try:
        stored = stored_answer(response, answer)
    except ArgumentError as error:
        assert f"found {answer!r}, expected" in str(error)
        return
    with TemporaryDirectory() as folder:
        table = Table(Path(folder), "soft", "01", 1)
        for number in (1, 2):
            table.add({"trial": number, **ROW, "response": stored})
        table.close()
        assert read_back(Path(folder)) == table.rows and [row["response"] for row in table.rows] == [stored] * 2
    assert stored_answer(response, stored) == stored
    if response == "magnitude":
        assert float(stored) == float(answer) and 0.0 < float(answer) < math.inf


@settings(max_examples=400, deadline=None)
@given(st.fixed_dictionaries({}, optional={name: ANY for name in COLUMNS if not name.startswith("recording")}))
def test_a_row_of_any_texts_is_refused_or_read_back_equal(texts):
    with TemporaryDirectory() as folder:
        table = Table(Path(folder), "soft", "01", 1)
        before = table.path.read_bytes()
        try:
            table.add({"trial": 1, **ROW, **texts})
        except ValueError as error:
            assert "found" in str(error) or "read back" in str(error)
            assert table.path.read_bytes() == before and not table.rows
        table.close()
        assert read_back(Path(folder)) == table.rows


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(ANY, ANY, max_size=3))
def test_attributes_of_a_participant_are_refused_or_read_back_equal(about):
    with TemporaryDirectory() as folder:
        try:
            begin(Path(folder), "soft", b"a", "01", about)
        except ValueError:
            return
        begin(Path(folder), "soft", b"a", "02", about)
        lines = (Path(folder) / "participants.tsv").read_bytes().split(b"\n")[:-1]
        heads, *rows = map(decode_row, lines)
        assert heads == list({"participant_id": ""} | about)
        found = [dict(zip(heads, row, strict=True)) for row in rows]
        assert found == [about | {"participant_id": f"sub-{number}"} for number in ("01", "02")]


def test_an_experiment_without_trials_is_replaced_by_its_corrected_version(tmp_path):
    begin(tmp_path, "soft", b"a", "01", {})
    Table(tmp_path, "soft", "01", 1).close()
    begin(tmp_path, "soft", b"b", "01", {})
    assert (tmp_path / "code" / "task-soft.yaml").read_bytes() == b"b"
