"""The folder of an experiment in the layout of BIDS for behaviour (bids-specification 1.10, "Behavioral experiments").

FOLDER/dataset_description.json, participants.tsv, participants.json, README
FOLDER/code/task-<task>.yaml                                              the experiment
FOLDER/sub-01/ses-01/beh/sub-01_ses-01_task-<task>_beh.tsv (.json)        one row per trial
FOLDER/sourcedata/sub-01/ses-01/beh/...trial-003_interval-1.mcap          the recordings

Each row is on the disk before the next trial begins. An incomplete last row, as after a power failure, is moved aside.
"""

import itertools
import json
import os
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from palpate.physics.errors import ArgumentError
from palpate.physics.readable import MOST_TEXT, check_file
from palpate.physics.writable import lock_file
from palpate.studies.files import replace
from palpate.studies.psychophysics.cells import decode_row, encode_row

NONE = "n/a"
COLUMNS: dict[str, dict[str, Any]] = {
    "trial": {"Description": "Number of the trial in this session."},
    "block": {"Description": "Block of the experiment."},
    "track": {"Description": "Number of the interleaved staircase."},
    "level": {"Description": "Value of the path that varies, in the comparison; n/a: a trial without signal."},
    "reference": {"Description": "The same in the reference; n/a: the reference differs elsewhere, or does not exist."},
    "interval": {"Description": "Number of the interval with the comparison."},
    "response": {"Description": "The answer."},
    "hit": {"Description": "1: right, or yes; 0: wrong, or no; n/a: neither."},
    "response_time": {"Description": "From the question to the answer.", "Units": "s"},
    "repeats": {"Description": "Number of disturbed attempts before this one."},
    "time": {"Description": "When the answer was stored (UTC, ISO 8601)."},
    "recording_1": {"Description": "Recording of the first interval, relative to the folder of the data set."},
    "recording_2": {"Description": "Recording of the second interval, likewise."},
}
README = """Data of `palpate experiment` in the Brain Imaging Data Structure (https://bids.neuroimaging.io).

Tables: sub-*/ses-*/beh/*_beh.tsv, one row per trial; the .json file with the same name describes the columns.
Recordings: sourcedata/; `palpate replay FILE --check` recomputes one. The experiment: code/.
`palpate experiment --analyse FOLDER` computes thresholds.
"""
Row = dict[str, str]


class Table:
    """The rows of one session; only one process can open it.

    rows       the stored rows, as text
    recovered  file with the incomplete row that was moved aside; None: the table was intact
    """

    def __init__(self, folder: Path, task: str, participant: str, session: int) -> None:
        self.folder, self.path = folder, table_path(folder, task, participant, session)
        self.name = self.path.stem.removesuffix("_beh")
        self.recordings = folder / "sourcedata" / self.path.parent.relative_to(folder)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.recordings.mkdir(parents=True, exist_ok=True)
        self.recovered: Path | None = None
        if self.path.exists():
            check_file(self.path, MOST_TEXT)
        self._file = open(self.path, "a+b", buffering=0)  # noqa: SIM115 - open during the session
        if not lock_file(self._file):
            self._file.close()
            raise ArgumentError(f"{self.path}: another `palpate experiment` has this session open")
        self.rows = self._recover()

    def close(self) -> None:
        self._file.close()

    def add(self, row: Mapping[str, Any]) -> None:
        """Store a row and the recordings that it lists. OSError: the disk is full. ValueError: a text cannot be read
        back as it is, so nothing is stored."""
        texts = {name: NONE if row.get(name) is None else str(row[name]) for name in COLUMNS}
        line = encode_row(list(texts.values()))
        if (found := _parse_row(line, len(self.rows) + 1)) != texts:
            raise ValueError(f"{self.path}: the row {texts} would be read back as {found}")
        for name in ("recording_1", "recording_2"):
            if row.get(name, NONE) != NONE:
                with open(self.folder / row[name], "rb") as recording:
                    os.fsync(recording.fileno())
        self._write(line)
        self.rows.append(texts)

    def recording(self, trial: int, interval: int, repeat: int) -> Path:
        """The file of an interval; each attempt at a disturbed trial has a separate file."""
        name = f"{self.name}_trial-{trial:03d}_interval-{interval}{f'_repeat-{repeat}' if repeat else ''}.mcap"
        return self.recordings / name

    def count_attempts(self, trial: int) -> int:
        """Number of earlier attempts at a trial."""
        return next(repeat for repeat in itertools.count() if not self.recording(trial, 1, repeat).exists())

    def describe(self, about: dict[str, dict[str, Any]]) -> None:
        """Write the data dictionary of the columns, with the additions in `about`."""
        write_json(self.path.with_suffix(".json"), {name: text | about.get(name, {}) for name, text in COLUMNS.items()})

    def _write(self, line: bytes) -> None:
        data = line + b"\n"
        if os.write(self._file.fileno(), data) < len(data):
            raise OSError(f"{self.path}: the row was stored incompletely: the disk is full")
        os.fsync(self._file.fileno())

    def _recover(self) -> list[Row]:
        self._file.seek(0)
        data = self._file.read()
        rows, length = parse(data)
        if length < len(data):
            number = sum(1 for _ in self.recordings.glob("*_broken-*.tsv")) + 1
            self.recovered = self.recordings / f"{self.name}_broken-{number}.tsv"
            replace(self.recovered, data)
            os.ftruncate(self._file.fileno(), length)
        if not length:
            self._write(encode_row(list(COLUMNS)))
        return rows


def parse(data: bytes) -> tuple[list[Row], int]:
    """The complete rows at the beginning of a table, and the number of bytes of header and rows."""
    head, *lines = data.split(b"\n")[:-1] or [b""]
    if decode_row(head) != list(COLUMNS):
        return [], 0
    rows, length = list[Row](), len(head) + 1
    for line in lines:
        if (row := _parse_row(line, len(rows) + 1)) is None:
            break
        rows.append(row)
        length += len(line) + 1
    return rows, length


def _parse_row(line: bytes, number: int) -> Row | None:
    """The row of a trial; None: the line is incomplete, or of another trial."""
    texts = decode_row(line)
    if len(texts) != len(COLUMNS) or texts[0] != str(number) or not texts[6]:
        return None
    return dict(zip(COLUMNS, texts, strict=True))


def table_path(folder: Path, task: str, participant: str, session: int) -> Path:
    sub, ses = f"sub-{participant}", f"ses-{session:02d}"
    return folder / sub / ses / "beh" / f"{sub}_{ses}_task-{task}_beh.tsv"


def sessions(folder: Path, task: str, participant: str) -> list[int]:
    """Sessions of a participant with a table of this task."""
    found = folder.glob(f"sub-{participant}/ses-*/beh/sub-{participant}_ses-*_task-{task}_beh.tsv")
    return sorted(int(path.parts[-3].removeprefix("ses-")) for path in found if path.parts[-3][4:].isdigit())


def read_content(path: Path) -> bytes:
    """The bytes of a file. ArgumentError: it cannot be read."""
    try:
        check_file(path, MOST_TEXT)
        return path.read_bytes()
    except OSError as error:
        raise ArgumentError(f"{path}: {error.strerror}; expected a file of `palpate experiment`") from None


def begin(folder: Path, task: str, text: bytes, participant: str, about: Mapping[str, Any]) -> None:
    """Write the files of a data set other than the tables. ArgumentError: the folder belongs to another experiment of
    this name, or cannot be written. An experiment without stored trials is replaced: it may have been corrected."""
    try:
        (folder / "code").mkdir(parents=True, exist_ok=True)
        copy = folder / "code" / f"task-{task}.yaml"
        if copy.exists() and (check_file(copy) != len(text) or copy.read_bytes() != text) and _has_trials(folder, task):
            raise ArgumentError(
                f"{folder}: its data are of another version of this experiment ({copy}). Use another folder (--out), "
                "or another `task:`."
            )
        replace(copy, text)
        replace(folder / "README", README.encode())
        description = folder / "dataset_description.json"
        if not description.exists():
            made = {"Name": "palpate", "Version": version("palpate")}
            write_json(description, {"Name": folder.resolve().name, "BIDSVersion": "1.10.0", "DatasetType": "raw",
                                     "GeneratedBy": [made]})  # fmt: skip
        _participant(folder, participant, about)
    except OSError as error:
        raise ArgumentError(f"{folder}: cannot be written: {error.strerror}; --out takes another folder") from None


def _participant(folder: Path, participant: str, about: Mapping[str, Any]) -> None:
    """Add a participant to the list, once, with the attributes that the experiment gives."""
    file = folder / "participants.tsv"
    if file.exists():
        check_file(file, MOST_TEXT)
    lines = [decode_row(line) for line in file.read_bytes().splitlines()] if file.exists() else []
    heads, *rows = lines or [["participant_id"]]
    heads = list(dict.fromkeys([*heads, *about]))
    known = {row[0]: dict(zip(heads, row, strict=False)) for row in rows}
    row = {"participant_id": "", **{key: str(value) for key, value in about.items()}}
    row["participant_id"] = f"sub-{participant}"
    known.setdefault(row["participant_id"], row)
    encode_row([*row, *row.values()])  # other rows, which the user may have edited, may have empty cells
    table = [heads, *([row.get(head, NONE) for head in heads] for row in known.values())]
    replace(file, "".join("\t".join(texts) + "\n" for texts in table).encode())
    write_json(file.with_suffix(".json"), {head: {"Description": "See the experiment."} for head in heads[1:]})


def tables(folder: Path, task: str | None = None) -> Iterable[Path]:
    return sorted(folder.glob(f"sub-*/ses-*/beh/*_task-{task or '*'}_beh.tsv"))


def _has_trials(folder: Path, task: str) -> bool:
    return any(parse(path.read_bytes())[0] for path in tables(folder, task))


def write_json(file: Path, data: Mapping[str, Any]) -> None:
    replace(file, (json.dumps(data, indent=2, ensure_ascii=False) + "\n").encode())
