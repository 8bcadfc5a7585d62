"""What became of a study: its rows, numbers and indices."""

from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.errors import ArgumentError, RunError
from palpate.studies.sweeps.axes import Space
from palpate.studies.sweeps.keep import RECORDING, Kept
from palpate.studies.sweeps.point import Point
from palpate.studies.sweeps.sensitivity import indices

LONG = 32  # letters of a value that tables and legends show


class Results:
    """A study as its folder has it.

    name         of the graph
    space        what varies
    keep         what is kept;  recorded  whether the whole runs are
    points       all points in order
    sensitivity  sobol or morris, where the points were drawn for it
    folder       None before it was run
    units        SI, of what varies as numbers, by path
    """

    name: str
    space: Space
    keep: tuple[Kept, ...]
    recorded: bool
    points: list[Point]
    sensitivity: str | None
    units: dict[str, str]
    folder: Path | None = None

    def __len__(self) -> int:
        return len(self.space)

    @property
    def numbers(self) -> list[Kept]:
        return [one for one in self.keep if one.how != "curve"]

    @property
    def curves(self) -> list[Kept]:
        return [one for one in self.keep if one.how == "curve"]

    def rows(self) -> list[dict[str, Any]]:
        """A row for each point, in order: what was varied, numbers, error; "not computed" where there is none yet."""
        from palpate.studies.sweeps.store import Store

        stored = Store(self.home(), write=False).rows
        nothing = {"error": "not computed"}
        return [{**stored.get(point.key, nothing), **point.labels} for point in self.points]

    def labelled(self, path: str) -> str:
        """A path as axes and legends name it: with its unit."""
        return f"{path} [{self.units[path]}]" if path in self.units else path

    def shown(self, path: str, value: Any) -> str:
        """A value as people see it in tables and legends: a long one, such as a motion, by its number."""
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        if len(text) <= LONG or path not in self.space.paths:
            return text
        axis = next(one for one in self.space.axes if path in one.paths)
        return f"#{[row[axis.paths.index(path)] for row in axis.labels].index(value) + 1}"

    def table(self) -> Any:
        """A pandas DataFrame with a row for each point: what was varied, numbers, error; the units are in its
        `attrs`."""
        import pandas

        numbers = [one.text for one in self.numbers]
        extra = [RECORDING] if self.recorded else []
        table = pandas.DataFrame(self.rows()).reindex(columns=[*self.space.paths, *numbers, *extra, "error"])
        table.attrs["units"] = self.units | {one.text: one.unit for one in self.numbers}
        return table

    def indices(self) -> Any:
        """A pandas DataFrame of the sensitivity indices: a row for each number that is kept and each parameter, and
        for each combination of the crossed axes. ArgumentError: the study was not drawn for that, or points failed."""
        import pandas

        if self.sensitivity is None:
            raise ArgumentError("indices: this study has no `sensitivity`, expected sobol or morris")
        rows = self.rows()
        failed = [row["error"] for row in rows if row["error"]]
        if failed:
            raise ArgumentError(f"indices: {len(failed)} of {len(rows)} points have no result, the first: {failed[0]}")
        names, count, out = [one.paths[0] for one in self.space.sampled], len(self.space.cube), []
        for start in range(0, len(rows), count):
            group = rows[start : start + count]
            where = {path: group[0][path] for path in self.space.paths if path not in names}
            for one in self.numbers:
                values = np.array([row[one.text] for row in group])
                found = indices(self.sensitivity, names, self.space.cube, values, self.space.seed)
                out += [{**where, "of": one.text, "parameter": n, **f} for n, f in zip(names, found, strict=True)]
        return pandas.DataFrame(out)

    def home(self) -> Path:
        if self.folder is None:
            raise RunError("this study was not run; `study.run('out/')` computes what the folder lacks, and opens it")
        return self.folder
