"""The folder with the results of a study, for one writer at a time.

    points.parquet    one row per point, in order: key, varied settings, numbers, notes (JSON), error
    curves.zarr       one array (points, samples) per curve and one for its times [s]; NaN after the end of a curve
    recordings/       kept recordings
    study.json        graph, scene, versions and arithmetic of the stored points, by the `base` of the rows
    log.jsonl         date and duration of each computed point, and a checksum of its curves
    unwritten.jsonl   rows that are not in points.parquet yet, after a kill

Rows are looked up by key and never removed: a study that is changed back finds its old points. Files are written under
another name and then renamed, so that a full disk or a kill leaves the old files intact. The table is written now and
then; the curves of a block of points, and then its rows in unwritten.jsonl, when it is computed, so that a kill loses
no finished block. A point whose curves do not have the checksum of the log is computed again, because zarr reads a
missing file as NaN.
"""

import contextlib
import datetime
import itertools
import json
import math
import time
import warnings
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.claims import check_claim, stored_bytes
from palpate.physics.errors import RunError
from palpate.physics.extras import require_extra
from palpate.physics.readable import MOST_TEXT, check_readable
from palpate.physics.writable import lock_file
from palpate.records.disk import disk_errors
from palpate.studies.files import refuse, replace
from palpate.studies.sweeps.point import Computed, Point

with require_extra("studies", "study", RunError):
    import pyarrow
    import pyarrow.parquet
    import zarr

FIXED = ("key", "base", "slot", "error")
SHARE = 20.0
"""Rows are written if writing takes at most 1/SHARE of the time since the last write."""
LARGEST = 1 << 32  # [bytes] of a table: more points than a study can compute
AT_LEAST = 1.0  # [s] Minimum time between two writes
CELL, BLOCK = 100, 1024  # [bytes] of a cell in memory; rows that are read at once
CHUNK, LARGE = 32, 1 << 16  # Maximum number of curves, and of samples, in a file of several curves


class Store:
    """The folder of a study.

    rows  by key: the `FIXED` columns, varied settings and numbers

    RunError: another process writes to the folder. OSError: the folder cannot be written.
    """

    def __init__(self, folder: Path, *, write: bool = True) -> None:
        self.folder = folder
        self._table, self._about = folder / "points.parquet", folder / "study.json"
        self._unwritten = folder / "unwritten.jsonl"
        self._lock = None
        if write:
            refuse(folder, "dataset_description.json", "the data of an experiment")
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = open(folder / ".lock", "w")  # noqa: SIM115 - until `close`
            if not lock_file(self._lock):
                self._lock.close()
                raise RunError(f"{folder}: another process writes this study; wait for it, or take another folder")
        try:
            rows, self.about = self._read()
        except (pyarrow.ArrowException, OSError, ValueError, TypeError, LookupError, RecursionError) as error:
            self.close()
            why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
            raise RunError(
                f"{folder}: {self._table.name} or {self._about.name} is not of a study, or damaged ({why}); move the "
                "folder away, or name another one with --out"
            ) from None
        self.rows = {row["key"]: {k: v for k, v in row.items() if v is not None} for row in rows}
        self._written, self._took, self._changed = time.monotonic(), 0.0, write and self._unwritten.exists()
        self._drop_damaged()
        self.flush()

    def _read(self) -> tuple[list[dict[str, Any]], dict[str, Any]]:
        """The rows, and what describes them. An exception of the libraries, ValueError: damaged."""
        rows: list[dict[str, Any]] = []
        about: dict[str, Any] = {"bases": {}}
        if self._table.exists():
            check_readable(self._table, LARGEST)
            rows = _rows(self._table)
        if self._unwritten.exists():
            check_readable(self._unwritten, LARGEST)
            *lines, _ = self._unwritten.read_text(encoding="utf-8").split("\n")  # the last one is empty, or torn
            rows += map(json.loads, lines)
        if self._about.exists():
            check_readable(self._about, MOST_TEXT)
            about = json.loads(self._about.read_text(encoding="utf-8"))
        kinds = {"key": str, "base": str, "slot": int, "error": str}
        for number, row in enumerate(rows):
            for name, kind in kinds.items():
                if not isinstance(row[name], kind):
                    raise ValueError(f"row {number}: {name}: found {row[name]!r}, expected {kind.__name__}")
        if not isinstance(about, dict) or not isinstance(about["bases"], dict):
            raise ValueError("expected a mapping with `bases`")
        return rows, about

    def free(self, wanted: Iterable[int]) -> list[int]:
        """An unused slot for each number of a point: the number itself if it is free."""
        taken, wanted = {row["slot"] for row in self.rows.values()}, list(wanted)
        fresh = itertools.count(max([*taken, *wanted], default=-1) + 1)
        return [next(fresh) if number in taken else number for number in wanted]

    def describe(self, base: str, about: Mapping[str, Any], study: Mapping[str, Any]) -> None:
        """Store the origin of the rows of a base, and the current study."""
        self.about["bases"][base] = dict(about)
        self.about |= {"base": base, "study": dict(study)}
        with self._disk_errors():
            replace(self._about, json.dumps(self.about, indent=1, default=str).encode())

    def add(self, base: str, done: Sequence[tuple[Point, Computed]]) -> None:
        """Store points; they count as stored only when all of it is written. RunError: the disk is full or
        unavailable."""
        when = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        curves: dict[str, dict[int, np.ndarray]] = {}
        rows: dict[str, dict[str, Any]] = {}
        logged, added = "", ""
        for point, one in done:
            for name, (times, values) in one.curves.items():
                curves.setdefault(f"{name} time", {})[point.slot] = times
                curves.setdefault(name, {})[point.slot] = values
            entry = {"key": point.key, "seconds": round(one.seconds, 3), "date": when, "curves": _curve_sum(one.curves)}
            logged += json.dumps(entry) + "\n"
            row = rows[point.key] = {
                "key": point.key, "base": base, "slot": point.slot, **point.labels, **one.numbers,
                **({"recording": point.recording.name} if point.recording and not one.error else {}),
                **({"notes": json.dumps([[n.text, n.node, n.time] for n in one.notes])} if one.notes else {}),
                "error": one.error,
            }  # fmt: skip
            added += json.dumps(row) + "\n"
        with self._disk_errors():
            self._write_curves(curves)
            for name, text in (("log.jsonl", logged), (self._unwritten.name, added)):
                with open(self.folder / name, "a", encoding="utf-8") as file:
                    file.write(text)
        self.rows |= rows
        self._changed = True
        if time.monotonic() - self._written > max(AT_LEAST, SHARE * self._took):
            self.flush()

    def flush(self) -> None:
        """Write the table of all rows. RunError: the disk is full or unavailable; the old files are intact."""
        if not self._changed:
            return
        since = time.monotonic()
        rows = sorted(self.rows.values(), key=lambda row: row["slot"])
        names = dict.fromkeys((*FIXED[:3], *sorted({name for row in rows for name in row} - set(FIXED)), "error"))
        columns = {name: _column([row.get(name) for row in rows]) for name in names}
        sink = pyarrow.BufferOutputStream()
        pyarrow.parquet.write_table(pyarrow.table(columns), sink)
        with self._disk_errors():
            replace(self._table, sink.getvalue())
            self._unwritten.unlink(missing_ok=True)
        self._written, self._changed = time.monotonic(), False
        self._took = self._written - since

    def close(self) -> None:
        if self._lock is not None:
            self._lock.close()

    # -- curves --------------------------------------------------------------------------------------------------

    def _drop_damaged(self) -> None:
        """Forget the points whose curves are not those of the log."""
        logged = self._logged() if self.rows else {}
        wanted = {row["slot"]: sums for key, row in self.rows.items() if (sums := logged.get(key))}
        if not wanted:
            return
        found = self._stored_curves(wanted)
        damaged = {slot for slot, sums in wanted.items() if sums != _curve_sum(found[slot])}
        if damaged:
            self.rows = {key: row for key, row in self.rows.items() if row["slot"] not in damaged}
            self._changed = self._lock is not None
            warnings.warn(
                f"{self.folder}: the curves of {len(damaged)} points were changed or removed since they were written. "
                "Run the study again to compute these points",
                RuntimeWarning,
                stacklevel=2,
            )

    def _logged(self) -> dict[str, str]:
        """The checksum of the curves of each point that has curves, by key, from the log. Points of an older log have
        none."""
        sums: dict[str, str] = {}
        with contextlib.suppress(OSError, UnicodeDecodeError):
            check_readable(self.folder / "log.jsonl", LARGEST)
            for line in (self.folder / "log.jsonl").read_text(encoding="utf-8").splitlines():
                with contextlib.suppress(ValueError, KeyError, TypeError):  # the last line may be torn
                    entry = json.loads(line)
                    sums[entry["key"]] = entry.get("curves") or ""
        return sums

    def _stored_curves(self, slots: Iterable[int]) -> dict[int, dict[str, tuple[np.ndarray, np.ndarray]]]:
        """The stored curves of each slot; those that cannot be read are left out. Files that cannot be read are removed
        if this process may write, because zarr reads a file before it replaces a part of it."""
        found: dict[int, dict[str, tuple[np.ndarray, np.ndarray]]] = {slot: {} for slot in slots}
        with contextlib.suppress(Exception):  # zarr raises many types for a damaged store
            group: Any = zarr.open_group(self.folder / "curves.zarr", mode="r")
            for name in [name for name in group.array_keys() if f"{name} time" in group]:
                step = group[name].chunks[0]
                for first in sorted({slot - slot % step for slot in found}):
                    if (rows := self._rows(group, name, first, step)) is not None:
                        times, values = rows
                        for slot in set(found) & set(range(first, first + min(len(times), len(values)))):
                            count = int(np.isfinite(times[slot - first]).sum())
                            if count:
                                found[slot][name] = times[slot - first][:count], values[slot - first][:count]
        return found

    def _rows(self, group: Any, name: str, first: int, step: int) -> list[np.ndarray] | None:
        """Times and values of the curves in one file each, from a row; None if one cannot be read."""
        read: list[np.ndarray] = []
        for each in (f"{name} time", name):
            try:
                read.append(group[each][first : first + step])
            except Exception:  # of zarr or of a codec: a file that was cut
                folder = self.folder / "curves.zarr" / each / "c" / str(first // group[each].chunks[0])
                for file in list(folder.rglob("*")) if self._lock is not None else ():
                    with contextlib.suppress(OSError):
                        file.unlink()
        return read if len(read) == 2 else None

    def _write_curves(self, added: Mapping[str, Mapping[int, np.ndarray]]) -> None:
        group: Any = zarr.open_group(self.folder / "curves.zarr", mode="a") if added else {}
        for name, curves in added.items():
            longest = max(1, *map(len, curves.values()))
            if name not in group:
                chunk = max(1, min(CHUNK, LARGE // longest)), longest
                group.create_array(name, shape=(1, longest), chunks=chunk, dtype="float64", fill_value=math.nan)
            array = group[name]
            shape = max(array.shape[0], max(curves) + 1), max(array.shape[1], longest)
            if shape != array.shape:
                array.resize(shape)
            rows = np.full((len(curves), shape[1]), math.nan)
            for row, slot in zip(rows, sorted(curves), strict=True):
                row[: len(curves[slot])] = curves[slot]
            array.oindex[sorted(curves)] = rows

    def curves(self, name: str, slots: Iterable[int | None]) -> np.ndarray:
        """Curves (slots, samples), or with `NAME time` their times [s]; NaN for a slot without a curve."""
        folder = self.folder / "curves.zarr"
        stored: Any = zarr.open_group(folder, mode="r")[name]
        rows = [slot if slot is not None and 0 <= slot < stored.shape[0] else -1 for slot in slots]
        width = int(stored.shape[1])
        try:
            check_claim(
                f"{len(rows)} curves of {name}", 8 * width * max(len(rows), stored.chunks[0]), stored_bytes(folder)
            )
        except ValueError as error:
            raise RunError(f"{folder}: {error}") from None
        given = sorted({row for row in rows if row >= 0})
        values = np.full((len(given) + 1, width), math.nan)
        if given:
            values[:-1] = stored.oindex[given]
        at = {row: k for k, row in enumerate(given)}
        return values[[at.get(row, -1) for row in rows]]

    def _disk_errors(self) -> contextlib.AbstractContextManager[None]:
        return disk_errors(self.folder, f"All points in {self._table.name} stay")


def _curve_sum(curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """Checksum of the names, times and values of curves; empty without one."""
    total, given = 0, {name: curve for name, curve in curves.items() if len(curve[0])}
    for name in sorted(given):
        total = zlib.crc32(f"{name} {len(given[name][0])} ".encode(), total)
        for numbers in given[name]:
            total = zlib.crc32(np.ascontiguousarray(numbers, dtype="<f8").tobytes(), total)
    return f"{total:08x}" if given else ""


def _rows(table: Path) -> list[dict[str, Any]]:
    """The rows of a table, in blocks, because a few bytes may encode any number of equal rows. An exception of the
    library, ValueError: damaged, or too many rows for its length."""
    rows: list[dict[str, Any]] = []
    held, size = table.stat().st_size, 0
    with pyarrow.parquet.ParquetFile(table) as file:
        check_claim("its table", CELL * file.metadata.num_rows * file.metadata.num_columns, held)
        for block in file.iter_batches(batch_size=BLOCK):
            size += block.nbytes
            check_claim("its table", size, held)
            rows += block.to_pylist()
    return rows


def _column(values: list[Any]) -> Any:
    """The values unchanged if all are numbers; otherwise as text."""
    given = [value for value in values if value is not None]
    if given and all(isinstance(value, int | float) and not isinstance(value, bool) for value in given):
        whole = all(isinstance(value, int) for value in given)
        return pyarrow.array(values, pyarrow.int64() if whole else pyarrow.float64())
    texts = [value if value is None or isinstance(value, str) else json.dumps(value) for value in values]
    return pyarrow.array(texts, pyarrow.string())
