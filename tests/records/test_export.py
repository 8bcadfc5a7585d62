"""Exports can be opened with the standard tools of the formats and contain the exact values of the recording."""

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.messages import fields
from palpate.records.export import export
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

TOUCH = Path(__file__).parents[1] / "golden" / "plane.mcap"


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording(TOUCH)


def test_foxglove_reads_json_channels_with_their_schemas(recording, tmp_path):
    (path,) = export(recording, "foxglove", tmp_path / "a.mcap")
    topics: dict[str, list] = {}
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        for schema, channel, record in reader.iter_messages():
            assert channel.message_encoding == "json" and schema.encoding == "jsonschema"
            topics.setdefault(channel.topic, []).append((json.loads(record.data), json.loads(schema.data), record))
    assert set(topics) >= {f"/{name}" for name in recording.streams}
    for name in recording.streams:
        for message, (data, schema, record) in zip(recording.messages(name), topics[f"/{name}"], strict=True):
            assert set(data) == set(schema["properties"]) and schema["type"] == "object"
            assert record.log_time == message.time and record.sequence == message.tick
            for field in fields(type(message)):
                assert np.array_equal(
                    np.array(data[field.name]).ravel(), np.array(getattr(message, field.name)).ravel()
                )
                assert schema["properties"][field.name]["title"] == field.label


def test_each_json_message_fits_its_schema(recording, tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    (path,) = export(recording, "foxglove", tmp_path / "a.mcap")
    fits = {}
    with open(path, "rb") as file:
        for schema, _, record in make_reader(file).iter_messages():
            if schema.id not in fits:
                printed = json.loads(schema.data)
                kind = jsonschema.validators.validator_for(printed)
                kind.check_schema(printed)
                fits[schema.id] = kind(printed)
            fits[schema.id].validate(json.loads(record.data))
    assert fits


def test_pyarrow_reads_parquet_with_units_and_provenance(recording, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    paths = export(recording, "parquet", tmp_path)
    assert {p.stem for p in paths} == set(recording.streams)
    for name in recording.streams:
        table = pq.read_table(tmp_path / f"{name}.parquet")
        messages = list(recording.messages(name))
        assert table.num_rows == len(messages)
        assert json.loads(table.schema.metadata[b"about"])["clock"] == "simulated"
        assert table.column("time [s]").to_pylist() == [message.time / 1e9 for message in messages]
        assert table.column("time [ns]").to_pylist() == [message.time for message in messages]
        assert table.column("time [s]").to_pylist() == recording.columns(name)["time"].tolist()
        for field in fields(recording.streams[name].type):
            columns = [c for c in table.column_names if c == field.label or c.startswith(f"{field.name}[")]
            assert columns or not any(getattr(m, field.name) for m in messages)
            assert all(table.schema.field(c).metadata[b"unit"].decode() == field.unit for c in columns)
            assert all(c.endswith(f" [{field.unit}]") for c in columns)
            for message, *values in zip(messages, *(table.column(c).to_pylist() for c in columns), strict=True):
                printed = [x for x in np.ravel(np.array(values, dtype=object)).tolist() if x is not None]
                flat = np.concatenate([np.ravel(x) for x in printed]) if printed else np.zeros(0)
                assert np.array_equal(flat, np.ravel(getattr(message, field.name)))


def test_units_and_times_are_the_same_in_pandas_from_parquet_and_csv(recording, tmp_path):
    pandas = pytest.importorskip("pandas")
    export(recording, "parquet", tmp_path)
    export(recording, "csv", tmp_path)
    for name in recording.streams:
        one, other = pandas.read_parquet(tmp_path / f"{name}.parquet"), pandas.read_csv(tmp_path / f"{name}.csv")
        assert list(other.columns) == list(one.columns)[: len(other.columns)]
        assert np.array_equal(one["time [s]"], other["time [s]"])


def test_csv_has_a_column_per_number_with_its_unit_and_loses_no_digit(recording, tmp_path):
    export(recording, "csv", tmp_path, ["contact", "spread"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["contact.csv", "spread-k.csv", "spread.csv"]
    with open(tmp_path / "contact.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    for row, message in zip(rows, recording.messages("contact"), strict=True):
        assert float(row["force [N]"]) == message.force
        assert tuple(float(row[f"normal[{i}] [1]"]) for i in range(3)) == message.normal
        assert float(row["time [s]"]) == pytest.approx(message.time * 1e-9, abs=1e-12)
    for name in ("contact", "spread", "spread-k"):
        lines = (tmp_path / f"{name}.csv").read_text().splitlines()
        assert not any("," in cell for row in csv.reader(lines) for cell in row)  # no list as text
    with open(tmp_path / "spread-k.csv", newline="") as file:
        rows = [[float(x) for x in row.values()] for row in csv.DictReader(file)]
    expected = [
        [m.tick, m.time / 1e9, m.time, k, node, *force]
        for m in recording.messages("spread")
        for k, (node, force) in enumerate(zip(m.nodes.tolist(), m.forces.tolist(), strict=True))
    ]
    assert rows == expected and len(rows) > 100


def test_every_exports_each_nth_message(recording, tmp_path):
    export(recording, "csv", tmp_path, ["contact"], every=50)
    with open(tmp_path / "contact.csv", newline="") as file:
        assert [row["tick"] for row in csv.DictReader(file)] == ["0", "50", "100"]


def test_streams_that_cannot_be_exported_are_errors(recording, tmp_path):
    for args, words in (
        (("xls",), "expected one of foxglove, parquet, csv"),
        (("csv", tmp_path, ["contct"]), "Did you mean 'contact'"),
        (("foxglove", TOUCH), "is the recording itself"),
    ):
        with pytest.raises(RecordingError, match=re.escape(words)):
            export(recording, *args)


def test_a_missing_package_is_an_error_with_the_install_command(recording, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordingError, match=r'pip install "palpate\[export\]"'):
        export(recording, "parquet", tmp_path)


def test_the_command_exports_a_truncated_file(tmp_path):
    data = TOUCH.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: len(data) - 400])
    result = CliRunner().invoke(app, ["export", str(cut), "--to", "csv"], env={"COLUMNS": "200"})
    assert result.exit_code == 0 and " files" in result.stdout and "cut off" in result.stdout
