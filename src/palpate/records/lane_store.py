"""Results of an ensemble in a zarr store that grows block by block, so that an interrupted run can be continued.

zarr reads a missing file as fill values, and another program may have cut or changed one. So the head of the store has
a checksum of the files of each block: when a run continues, blocks with other files are computed again.
"""

import contextlib
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.physics.extras import require_extra
from palpate.physics.writable import opened_alone
from palpate.records.disk import disk_errors

LOCK, STORE = "palpate.lock", "zarr.json"  # files in the folder: that of the lock, and the head of a store
PARTIAL = ".partial"  # ending of files that zarr writes, and renames when they are complete
NOTES = "notes"  # variable with the notes of each lane
CHUNK = 1 << 16  # values of a coordinate in a file
EXPECTED = "expected an empty or missing folder, or the unfinished results of the same ensemble"


class KeptField(NamedTuple):
    """A field of every lane: its name, the dtype and shape (rows, ...) of one lane, its unit, and its words, if any."""

    name: str
    dtype: np.dtype
    shape: tuple[int, ...]
    unit: str
    words: tuple[str, ...] = ()

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Names of the dimensions, that of lanes first."""
        return ("lane", "time", *(f"axis{n if n != 3 else ''}" for n in self.shape[1:]))

    def decode_words(self, column: np.ndarray) -> np.ndarray:
        """The values of lanes as results: words in place of their index."""
        return np.array(self.words, object)[column] if self.words else column


def is_numeric(values: Any) -> bool:
    """Whether the values of a setting are numbers or flags."""
    if isinstance(values, np.ndarray):
        return values.ndim == 1
    return all(isinstance(one, bool | int | float) for one in values)


def as_texts(values: Any) -> np.ndarray:
    """The values of a setting as texts."""
    return np.array([str(one.tolist() if isinstance(one, np.ndarray) else one) for one in values], object)


def as_coordinate(values: Any) -> np.ndarray:
    """The values of a setting: numbers, or texts."""
    return np.asarray(values) if is_numeric(values) else as_texts(values)


def _is_of_store(file: Path) -> bool:
    """Whether the creation of a store leaves this file if a kill ends it."""
    return file.name == LOCK or file.suffix == PARTIAL


class LaneStore:
    """A zarr store (format 3) that xarray reads without palpate: `xarray.open_zarr(path, consolidated=False)`.

    path      its folder; it is made, or continued if it belongs to the same ensemble
    identity  hash of everything that determines the results
    lanes, size, time  number of lanes, of lanes in a block; times [s] of the rows
    settings  varied settings by path: a value for each lane, and units

    ArgumentError: the folder has something else, or another process writes to it; zarr is missing. RunError: the disk
    is full or unavailable, also in `write`.
    """

    def __init__(
        self, path: Path, identity: str, lanes: int, size: int, time: np.ndarray, fields: Sequence[KeptField],
        settings: Mapping[str, tuple[Any, str]], graph: str,
    ) -> None:  # fmt: skip
        with require_extra("run(out=...)", "study", ArgumentError):
            import zarr
        self.path, self._fields, self._lanes, self._size = path, fields, lanes, size
        try:
            if path.exists() and not (path / STORE).exists() and not all(map(_is_of_store, path.iterdir())):
                raise ArgumentError(f"out: found other files in {path}, {EXPECTED}")
            path.mkdir(parents=True, exist_ok=True)
            lock = opened_alone(path / LOCK)
        except OSError as error:
            raise ArgumentError(f"out: {path} cannot be written: {error.strerror}; expected a folder") from None
        if lock is None:
            raise ArgumentError(f"out: another run writes to {path}; expected another folder, or wait for its end")
        self._lock = lock
        self._names = (*(field.name for field in fields), "error", NOTES)
        self._coordinates = ("lane", "time", *settings)
        try:
            with self._disk_errors():
                self._open(zarr, {"graph": graph, "coordinates": " ".join(settings), "identity": identity})
                if "lanes_done" not in self._group.attrs:  # new, or its creation was ended
                    self._create(lanes, time, settings)
                    self._set({"lanes_done": [], "checksums": "", "created": self._coordinate_sum()})
                else:
                    self._check()
        except BaseException:
            self.close()
            raise

    def _disk_errors(self) -> contextlib.AbstractContextManager[None]:
        return disk_errors(f"out: {self.path}", "Whole blocks of lanes stay")

    def _open(self, zarr: Any, about: Mapping[str, str]) -> None:
        if (self.path / STORE).exists():
            self._group = self._open_store(zarr, about["identity"])
        else:
            self._group = zarr.create_group(self.path, attributes=about)
        for left in self.path.rglob(f"*{PARTIAL}"):  # by a kill or a full disk
            left.unlink()

    def _open_store(self, zarr: Any, identity: str) -> Any:
        try:
            group = zarr.open_group(self.path, mode="r+")
            kept = group.attrs["identity"]
        except Exception:  # zarr raises many types for a damaged store, and KeyError is that of another program
            raise ArgumentError(f"out: found a store of another program in {self.path}, {EXPECTED}") from None
        if kept != identity:
            raise ArgumentError(f"out: {self.path} has results of other settings, lanes, fields or sources; {EXPECTED}")
        if "lanes_done" in group.attrs:
            self._check_shapes(group)
        return group

    def _check_shapes(self, group: Any) -> None:
        """ArgumentError: arrays or ranges of finished lanes of another shape than this ensemble writes; reading them
        could take any memory and time."""
        try:
            ends = [np.asarray(pair) for pair in group.attrs["lanes_done"]]
            wrong = any(pair.shape != (2,) or not 0 <= pair[0] < pair[1] <= self._lanes for pair in ends)
            shapes = {field.name: tuple(field.shape) for field in self._fields} | {"error": (), NOTES: ()}
            for name, shape in shapes.items():
                found = group[name].shape, group[name].chunks
                wrong = wrong or found != ((self._lanes, *shape), (self._size, *shape))
        except Exception:  # zarr raises many types for a damaged store
            wrong = True
        if wrong:
            raise ArgumentError(f"out: the store in {self.path} is damaged: its arrays have other shapes; {EXPECTED}")

    def _create(self, lanes: int, time: np.ndarray, settings: Mapping[str, tuple[Any, str]]) -> None:
        make = partial(self._group.create_array, overwrite=True)
        for field in self._fields:
            kind: Any = str if field.words else field.dtype
            empty = "" if field.words else np.nan if field.dtype.kind == "f" else 0
            make(field.name, shape=(lanes, *field.shape), chunks=(self._size, *field.shape), dtype=kind,
                 fill_value=empty, dimension_names=field.dimensions, attributes={"units": field.unit})  # fmt: skip
        for name in ("error", NOTES):
            make(name, shape=(lanes,), chunks=(self._size,), dtype=str, fill_value="", dimension_names=("lane",))
        known: dict[str, tuple[Any, str, tuple[str, ...]]] = {
            "lane": (np.arange(lanes), "", ("lane",)), "time": (time, "s", ("time",)),
        }  # fmt: skip
        known |= {path: (values, unit, ("lane",)) for path, (values, unit) in settings.items()}
        for name, (values, unit, dimensions) in known.items():
            kind = as_coordinate(values).dtype if is_numeric(values) else str
            array = make(name, shape=(len(values),), chunks=(min(len(values), CHUNK),), dtype=kind,
                         dimension_names=dimensions, attributes={"units": unit} if unit else {})  # fmt: skip
            for first in range(0, len(values), CHUNK):
                part = values[first : first + CHUNK]
                array[first : first + CHUNK] = as_texts(part) if kind is str else as_coordinate(part)

    def _check(self) -> None:
        """Count blocks whose files were changed since they were written as missing. ArgumentError: the coordinates were
        changed."""
        if self._group.attrs.get("created") != self._coordinate_sum():
            raise ArgumentError(
                f"out: {self.path}: the files of its coordinates were changed or removed since they were written; "
                "expected them unchanged. Remove the folder to compute all lanes"
            )
        known = self._sums()
        blocks = [first for first in range(0, self._lanes, self._size) if first not in set(self.missing)]
        wrong = [first for first in blocks if known.get(first) != self._block_sum(first)]
        if not wrong:
            return
        for first in wrong:
            for name in self._names:
                for file in self._files(name, first):
                    file.unlink()
        self._note_done([first for first in blocks if first not in wrong], known)
        warnings.warn(
            f"{self.path}: the files of {len(wrong)} of {len(blocks)} blocks of lanes, the first at lane {wrong[0]}, "
            "were changed or removed since they were written. These lanes are computed again",
            RuntimeWarning,
            stacklevel=2,
        )

    def _files(self, name: str, first: int) -> list[Path]:
        """The files of a variable with the block that begins with this lane: at most one."""
        folder = self.path / name / "c" / str(first // self._size)
        return [folder] if folder.is_file() else sorted(file for file in folder.rglob("*") if file.is_file())

    def _block_sum(self, first: int) -> str:
        """Checksum of the files of a block: their names, lengths and bytes. zarr writes no file of fill values."""
        return self._sum_of(file for name in self._names for file in self._files(name, first))

    def _coordinate_sum(self) -> str:
        return self._sum_of(
            file for name in self._coordinates for file in sorted((self.path / name / "c").rglob("*")) if file.is_file()
        )

    def _sum_of(self, files: Iterable[Path]) -> str:
        total = 0
        for file in files:
            content = file.read_bytes()
            total = zlib.crc32(f"{file.relative_to(self.path).as_posix()} {len(content)} ".encode(), total)
            total = zlib.crc32(content, total)
        return f"{total:08x}"

    def _sums(self) -> dict[int, str]:
        """The stored checksum of each block, by its first lane."""
        pairs = (word.partition(":") for word in str(self._group.attrs.get("checksums", "")).split())
        return {int(first): value for first, _, value in pairs if first.isdecimal()}

    def _note_done(self, firsts: Iterable[int], sums: Mapping[int, str]) -> None:
        """Count these blocks as done: `lanes_done` has the ranges, each from a lane up to another one."""
        joined: list[list[int]] = []
        for first in sorted(firsts):
            end = min(first + self._size, self._lanes)
            if joined and first == joined[-1][1]:
                joined[-1][1] = end
            else:
                joined.append([first, end])
        text = " ".join(f"{first}:{sums[first]}" for first in sorted(firsts) if first in sums)
        self._set({"lanes_done": joined, "checksums": text})

    def _set(self, attributes: Mapping[str, Any]) -> None:
        """Set attributes of the head in one write: `attrs.update` makes one of each."""
        self._group = self._group.update_attributes(dict(attributes))

    @property
    def missing(self) -> list[int]:
        """First lanes of the blocks without results."""
        done = self._group.attrs["lanes_done"]
        return [
            first for first in range(0, self._lanes, self._size) if not any(begin <= first < end for begin, end in done)
        ]

    @property
    def notes(self) -> Iterator[tuple[int, str]]:
        """Lane and text of the stored notes."""
        for first, end in self._group.attrs["lanes_done"]:
            for begin in range(first, end, self._size):
                texts = self._group[NOTES][begin : min(end, begin + self._size)]
                yield from ((begin + place, text) for place, text in enumerate(texts.tolist()) if text)

    def write(
        self, first: int, columns: Sequence[np.ndarray], errors: Mapping[int, str], notes: Mapping[int, str]
    ) -> None:
        """Write the results of a block, then count its lanes as done."""
        with self._disk_errors():
            end = first + len(columns[0])
            for field, column in zip(self._fields, columns, strict=True):
                self._group[field.name][first:end] = field.decode_words(column)
            for name, texts in (("error", errors), (NOTES, notes)):
                self._group[name][first:end] = np.array([texts.get(lane, "") for lane in range(first, end)], object)
            sums = self._sums() | {first: self._block_sum(first)}
            missing = set(self.missing) - {first}
            self._note_done([each for each in range(0, self._lanes, self._size) if each not in missing], sums)

    def close(self) -> None:
        """Let other processes write to the store."""
        with contextlib.suppress(OSError):  # Windows removes no open file
            (self.path / LOCK).unlink()
        self._lock.close()
