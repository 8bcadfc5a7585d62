"""The folder of an experiment: rows, recovery after a power cut, participants."""

import json

import pytest

from palpate.physics.errors import ArgumentError
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
    with pytest.raises(ArgumentError, match="another version of this experiment"):
        begin(tmp_path, "soft", b"b", "01", {})


def test_sessions_of_a_task_are_found(filled, tmp_path):
    Table(tmp_path, "soft", "01", 7).close()
    Table(tmp_path, "other", "01", 3).close()
    assert sessions(tmp_path, "soft", "01") == [1, 7] and sessions(tmp_path, "soft", "02") == []
