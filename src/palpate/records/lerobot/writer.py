"""Writes a data set in the format of LeRobot, version 3.0: the lerobot package 0.4 to 0.6 reads it.

    meta/info.json                        features, rates, numbers of episodes and frames
    meta/stats.json                       statistics of all frames
    meta/tasks.parquet                    the task, as text
    meta/episodes/chunk-000/file-000.parquet  a row for each episode: where it is, its statistics, its settings
    data/chunk-000/file-000.parquet       a row for each frame
    meta/palpate.json                     where the touches are from

Source of the format: https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and the package, `lerobot.datasets`.
"""

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.extras import require_extra
from palpate.records.lerobot.features import Feature
from palpate.records.lerobot.pictures import Pictures
from palpate.records.lerobot.statistics import Totals, of_episodes

VERSION = "v3.0"
FILES = 1000  # in a folder `chunk-NNN`
PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
DATA, EPISODES = f"data/{PLACE}", f"meta/episodes/{PLACE}"
COLUMNS = {"timestamp": "float32"} | dict.fromkeys(["frame_index", "episode_index", "index", "task_index"], "int64")
"""The columns that every set has, and their types."""
STAGE = ".writing"  # folder of incomplete files, which no reader opens


class LeRobotSet:
    """A data set that grows by whole episodes; after each `add` it is complete.

    folder    to make; ArgumentError: it has files, or pyarrow is missing
    rate      of the frames [Hz]
    features  by name; float32, or pictures
    task      what the episodes show, as text
    about     origin of the touches, as plain data
    frames    that the set will have, at most
    """

    def __init__(
        self, folder: Path, rate: int, features: Mapping[str, Feature], task: str, about: Mapping[str, Any], frames: int
    ) -> None:
        with require_extra("a data set of LeRobot", "export", ArgumentError):
            import pyarrow
        check_empty(folder)
        self._made = not folder.exists()
        self.folder, self._rate, self._features, self._task = folder, rate, dict(features), task
        self._arrow, self._about, self._totals = pyarrow, dict(about), Totals(frames)
        self.episodes = self.frames = self._files = 0
        """Numbers of complete episodes, frames and files."""

    def add(
        self, values: Mapping[str, np.ndarray], settings: Mapping[str, Sequence[Any]] | None = None,
        pictures: Mapping[str, Pictures] | None = None,
    ) -> list[Path]:  # fmt: skip
        """Write episodes of equal length into new files; returns these.

        values    by feature, float32 (episodes, frames, ...)
        pictures  by feature
        settings  columns of the table of episodes, by name: a number or text for each episode

        ArgumentError: a value is not finite. RunError: the disk is full or unavailable; the set is as before.
        """
        for name, given in values.items():
            if not np.isfinite(given).all():
                raise ArgumentError(f"{self.folder}: feature {name!r} has values that are not finite; expected numbers")
        stage = self.folder / STAGE
        try:
            stage.mkdir(parents=True)
            return self._add(stage, values, settings or {}, pictures or {})
        except OSError as error:
            kept = f"its {self.episodes} complete episodes stay readable" if self.episodes else "nothing is kept"
            raise RunError(f"{self.folder}: {error.strerror or error}; {kept}. Free some space, or write to another "
                           "folder") from None  # fmt: skip
        finally:
            shutil.rmtree(stage, ignore_errors=True)
            if self._made and not self.episodes:  # it has no complete episode
                shutil.rmtree(self.folder, ignore_errors=True)

    def _add(
        self, stage: Path, values: Mapping[str, np.ndarray], settings: Mapping[str, Sequence[Any]],
        pictures: Mapping[str, Pictures],
    ) -> list[Path]:  # fmt: skip
        import pyarrow.parquet as pq

        episodes, length = values["action"].shape[:2]
        whole = dict(values) | self._counters(episodes, length)
        counted = {name: given if given.ndim > 2 else given[..., None] for name, given in whole.items()}
        counted |= {name: given.thinned for name, given in pictures.items()}
        each = {name: of_episodes(given) for name, given in counted.items()}
        totals = self._totals.with_more(counted, each, self.frames)
        spot = {"chunk_index": self._files // FILES, "file_index": self._files % FILES}
        tables = {
            DATA.format(**spot): self._frames(whole, pictures),
            EPISODES.format(**spot): self._rows(length, each, settings, spot),
        }
        if not self._files:
            tables["meta/tasks.parquet"] = self._tasks()
        texts = {"meta/stats.json": self._shaped(totals.statistics()), "meta/palpate.json": self._about,
                 "meta/info.json": self._info(self.episodes + episodes, self.frames + episodes * length)}  # fmt: skip
        # Everything is written before anything appears under its name, the head last.
        for name in (*tables, *texts):
            (stage / name).parent.mkdir(parents=True, exist_ok=True)
        for name, table in tables.items():
            pq.write_table(table, stage / name, compression="zstd", use_dictionary=False)
        for name, data in texts.items():
            (stage / name).write_text(json.dumps(data, indent=1), encoding="utf-8")
        for name in (*tables, *texts):
            (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(stage / name, self.folder / name)
        self._totals, self._files = totals, self._files + 1
        self.episodes, self.frames = self.episodes + episodes, self.frames + episodes * length
        return [self.folder / name for name in (*tables, *texts)]

    def _counters(self, episodes: int, length: int) -> dict[str, np.ndarray]:
        """The columns that every set has, (episodes, frames)."""
        frame = np.tile(np.arange(length), (episodes, 1))
        return {
            "timestamp": (frame / self._rate).astype(np.float32),
            "frame_index": frame,
            "episode_index": np.tile(self.episodes + np.arange(episodes)[:, None], length),
            "index": self.frames + np.arange(episodes * length).reshape(episodes, length),
            "task_index": np.zeros((episodes, length), np.int64),
        }

    def _shaped(self, statistics: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        """Statistics by feature and name, those of pictures with the axes (3,1,1) of LeRobot's channels."""
        found = {}
        for feature, given in statistics.items():
            pictured = feature in self._features and self._features[feature].kind == "image"
            found[feature] = {
                name: np.reshape(value, (*np.shape(value), 1, 1)).tolist() if pictured and name != "count" else value
                for name, value in given.items()
            }
        return found

    def _frames(self, values: Mapping[str, np.ndarray], pictures: Mapping[str, Pictures]) -> Any:
        """The table of frames."""
        columns = {}
        for name, given in values.items():
            rows = given.reshape(-1, *given.shape[2:])
            columns[name] = self._column(rows, fixed=rows.ndim == 2)
        picture = self._arrow.struct({"bytes": self._arrow.binary(), "path": self._arrow.string()})
        for name, drawn in pictures.items():
            files = [{"bytes": each, "path": None} for each in drawn.encoded]
            columns[name] = self._arrow.array(files, picture)
        return self._arrow.table(columns)

    def _column(self, rows: np.ndarray, fixed: bool = False) -> Any:
        """An array (n, ...) as lists of lists; `fixed`: of a type with the length."""
        column = self._arrow.array(np.ascontiguousarray(rows).ravel())
        for axis in range(rows.ndim - 1, 0, -1):
            if fixed:
                column = self._arrow.FixedSizeListArray.from_arrays(column, rows.shape[axis])
            else:
                ends = np.arange(0, len(column) + 1, rows.shape[axis], dtype=np.int32)
                column = self._arrow.ListArray.from_arrays(ends, column)
        return column

    def _rows(
        self, length: int, each: Mapping[str, Mapping[str, np.ndarray]], settings: Mapping[str, Sequence[Any]],
        spot: Mapping[str, int],
    ) -> Any:  # fmt: skip
        """The table of episodes."""
        count = len(each["action"]["count"])
        begin = self.frames + length * np.arange(count)
        columns: dict[str, Any] = {
            "episode_index": self.episodes + np.arange(count),
            "tasks": [[self._task]] * count,
            "length": np.full(count, length),
            "dataset_from_index": begin,
            "dataset_to_index": begin + length,
        }
        for head in ("data", "meta/episodes"):
            columns |= {f"{head}/{name}": np.full(count, value) for name, value in spot.items()}
        for feature, statistics in each.items():
            pictured = feature in self._features and self._features[feature].kind == "image"
            for name, value in statistics.items():
                shaped = value[..., None, None] if pictured and name != "count" else value
                columns[f"stats/{feature}/{name}"] = self._column(shaped)
        columns |= {f"settings/{name}": list(given) for name, given in settings.items()}
        return self._arrow.table(columns)

    def _tasks(self) -> Any:
        """The table of tasks, whose index is the text, for pandas."""
        plain = {"metadata": None}
        index = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object"} | plain
        kind = {"pandas_type": "int64", "numpy_type": "int64"}
        number = {"name": "task_index", "field_name": "task_index"} | kind | plain
        notes = {"index_columns": ["task"], "column_indexes": [], "columns": [number, index]}
        table = self._arrow.table({"task_index": np.array([0]), "task": [self._task]})
        return table.replace_schema_metadata({"pandas": json.dumps(notes)})

    def _info(self, episodes: int, frames: int) -> dict[str, Any]:
        features: dict[str, Any] = {
            name: {"dtype": f.kind, "shape": list(f.shape), "names": list(f.names), "units": list(f.units)}
            for name, f in self._features.items()
        }
        features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in COLUMNS.items()}
        return {
            "codebase_version": VERSION, "robot_type": "palpate", "total_episodes": episodes, "total_frames": frames,
            "total_tasks": 1, "chunks_size": FILES, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200,
            "fps": self._rate, "splits": {"train": f"0:{episodes}"}, "data_path": DATA, "video_path": None,
            "features": features,
        }  # fmt: skip


def check_empty(folder: Path) -> None:
    """ArgumentError: the folder of a new set has files, or cannot be one."""
    try:
        found = sorted(folder.iterdir()) if folder.exists() else []
    except OSError as error:
        raise ArgumentError(f"out: {folder}: {error.strerror}; expected an empty or missing folder") from None
    if found:
        others = f" and {len(found) - 1} more" if len(found) > 1 else ""
        raise ArgumentError(f"out: found {found[0].name}{others} in {folder}, expected an empty or missing folder")
