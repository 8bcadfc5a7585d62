"""The study of a device: walls, and if asked for bodies; tables and pictures."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from palpate.nodes.base import Node
from palpate.physics.device.wall_loop import WallDevice
from palpate.studies.stability import body_wall, walls


@dataclass(frozen=True)
class StabilityStudy:
    """What is asked for: rates [Hz], delays [1] and dampings [N s/m] of the wall, how the velocity is taken and what
    goes wrong (see `walls.row`), and bodies by name."""

    device: WallDevice
    rates: Sequence[float]
    delays: Sequence[int]
    dampings: Sequence[float]
    order: int = 1
    lost: float = 0.0
    jitter: float = 0.0
    seed: int = 0
    bodies: Sequence[str] = ()

    @property
    def cases(self) -> list[tuple[float, int, float]]:
        return list(product(sorted(self.rates), sorted(self.delays), sorted(self.dampings)))

    @property
    def loops(self) -> list[tuple[str, float, int]]:
        return list(product(self.bodies, sorted(self.rates), sorted(self.delays)))

    def check(self) -> dict[str, type[Node]]:
        """The bodies by name. ClassError, ArgumentError: options that describe no device, loop or body."""
        walls.check(self.device, self.rates, self.delays, self.dampings, self.order, self.lost, self.jitter)
        return body_wall.classes(self.bodies)

    def run(self, folder: Path, show: Callable[[str, float], None]) -> dict[str, Any]:
        """Rows of walls and bodies, and the files written; `show` has each loop and its rate [Hz].

        ClassError, ArgumentError: as of `check`. OSError: the folder cannot be written.
        """
        classes, rows = self.check(), list[dict[str, Any]]()
        for f, d, b in self.cases:
            rows.append(walls.row(self.device, f, d, b, self.order, self.lost, self.jitter, self.seed))
            show(f"{f:g} Hz, {d} samples late, damping {b:g} N s/m", f)
        files = [written(rows, walls.COLUMNS, folder / "stability.csv"), drawn(rows, folder / "stability.png")]
        told: dict[str, Any] = {"table": files[0], "picture": files[1], "rows": rows, "files": files}
        if classes:
            told["bodies"] = bodies = []
            for name, f, d in self.loops:
                bodies.append({"body": name, **body_wall.row(self.device, classes[name], f, d)})
                show(f"{name}, {f:g} Hz, {d} samples late", f)
            files.append(written(bodies, body_wall.COLUMNS, folder / "bodies.csv"))
        return told


def written(rows: list[dict[str, Any]], columns: dict[str, str], path: Path) -> str:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        write = csv.writer(file)
        write.writerow([f"{name} [{unit}]" if unit else name for name, unit in columns.items()])
        write.writerows([[row[n] if n == "body" else f"{row[n]:.6g}" for n in columns] for row in rows])
    return str(path)


def drawn(rows: list[dict[str, Any]], path: Path) -> str:
    """The path of the picture, "" where matplotlib is missing."""
    try:
        from palpate.studies.stability.pictures import draw_walls
    except ModuleNotFoundError:
        return ""
    draw_walls(rows, path)
    return str(path)
