"""The study of a device: walls, table and picture."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from palpate.physics.device.wall_loop import WallDevice
from palpate.studies.stability import walls


@dataclass(frozen=True)
class StabilityStudy:
    """Settings of a study: rates [Hz], delays [1], wall dampings [N s/m], velocity estimate and faults (see
    `walls.row`)."""

    device: WallDevice
    rates: Sequence[float]
    delays: Sequence[int]
    dampings: Sequence[float]
    order: int = 1
    lost: float = 0.0
    jitter: float = 0.0
    seed: int = 0

    @property
    def cases(self) -> list[tuple[float, int, float]]:
        return list(product(sorted(self.rates), sorted(self.delays), sorted(self.dampings)))

    def check(self) -> None:
        """ArgumentError: an option is out of range."""
        walls.check(self.device, self.rates, self.delays, self.dampings, self.order, self.lost, self.jitter)

    def run(self, folder: Path, show: Callable[[str, float], None]) -> dict[str, Any]:
        """Compute and write all rows; returns rows and files. `show` is called with each loop and its rate [Hz].

        ArgumentError: see `check`. OSError: the folder cannot be written.
        """
        self.check()
        rows: list[dict[str, Any]] = []
        for f, d, b in self.cases:
            rows.append(walls.row(self.device, f, d, b, self.order, self.lost, self.jitter, self.seed))
            show(f"{f:g} Hz, {d} samples late, damping {b:g} N s/m", f)
        files = [written(rows, walls.COLUMNS, folder / "stability.csv"), drawn(rows, folder / "stability.png")]
        return {"table": files[0], "picture": files[1], "rows": rows}


def written(rows: list[dict[str, Any]], columns: dict[str, str], path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        write = csv.writer(file)
        write.writerow([f"{name} [{unit}]" if unit else name for name, unit in columns.items()])
        write.writerows([[f"{row[n]:.6g}" for n in columns] for row in rows])
    return str(path)


def drawn(rows: list[dict[str, Any]], path: Path) -> str:
    """The path of the picture; "" if matplotlib is missing."""
    try:
        from palpate.studies.stability.pictures import draw_walls
    except ModuleNotFoundError:
        return ""
    draw_walls(rows, path)
    return str(path)
