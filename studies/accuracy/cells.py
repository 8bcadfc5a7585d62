"""The matrix: each touch by each method at each fidelity, one cell each. A cell is kept by what it depends on."""

import hashlib
import json
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from palpate.physics.archive import replacing
from palpate.studies.accuracy import UnsupportedError
from palpate.studies.accuracy.outcome import Fidelity, Method
from palpate.studies.accuracy.places import SHIPPED, cache
from palpate.studies.accuracy.score import CHARGED_STEP, charged, score
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.accuracy.truth import truth


@dataclass
class Cell:
    """One result.

    status          "ok", "refused" or "failed"; why says more
    errors          by quantity, see `score.Score`
    p50, p99        [s] processor time of a step;  steps how many were timed
    memory          [byte];  offline [s]
    law             whether the method is a law of contact alone
    kept            whether it is of an earlier run
    """

    touch: str
    method: str
    title: str
    fidelity: str
    rate: float
    status: str = "ok"
    why: str = ""
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    p50: float = CHARGED_STEP
    p99: float = CHARGED_STEP
    steps: int = 0
    memory: int | None = None
    offline: float = 0.0
    law: bool = False
    kept: bool = field(default=False, compare=False)

    def at_reference(self, quantity: str = "force") -> bool:
        """Whether the error is below what the reference itself may be off by."""
        own = self.errors.get(quantity)
        return own is not None and self.status == "ok" and own["rms"] <= own["band"]


def matrix(
    touches: Iterable[BenchCase], methods: Iterable[Method], quick: bool = False
) -> list[tuple[BenchCase, Method, Fidelity]]:
    """All cells to compute; a method that refuses a touch has one there."""
    rows = []
    for touch in touches:
        for method in methods:
            own = [f for f in method.fidelities if f.quick or not quick]
            rows += [(touch, method, f) for f in (own[:1] if method.refuses(touch) else own)]
    return rows


def compute(
    cells: list[tuple[BenchCase, Method, Fidelity]],
    repeats: int = 3,
    fresh: bool = False,
    machine: str = "",
    show: Callable[[str], None] = lambda what: None,
) -> list[Cell]:
    """All of them; what was kept is not computed again unless `fresh`. `machine` names the processor: times are its."""
    computed = []
    for touch, method, fidelity in cells:
        path = cache() / "cells" / f"{_key(touch, method, fidelity, repeats, machine)}.json"
        cell = None if fresh else _read(path)
        if cell is None:
            cell = one(touch, method, fidelity, repeats)
            with replacing(path) as part:
                part.write_text(json.dumps(asdict(cell)), encoding="utf-8")
        computed.append(cell)
        show(f"{touch.name}: {method.title}, {fidelity.name}")
    return computed


def one(touch: BenchCase, method: Method, fidelity: Fidelity, repeats: int = 1) -> Cell:
    """One cell. Whatever a method raises is its failure, and is charged."""
    cell = Cell(touch.name, method.name, method.title, fidelity.name, fidelity.rate, law=method.law)
    why = method.refuses(touch)
    right = truth(touch)
    if not why:
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                outcome = method.compute(touch, fidelity, repeats)
            cell.errors = score(outcome, right)
            if not all(np.isfinite(v) for own in cell.errors.values() for v in own.values()):
                raise ArithmeticError("what it tells is not finite")
            cell.p50, cell.p99 = (float(np.percentile(outcome.steps, p)) for p in (50, 99))
            cell.steps, cell.memory, cell.offline = len(outcome.steps), outcome.memory, outcome.offline
            return cell
        except UnsupportedError as error:
            why = str(error)
        except Exception as error:  # a user's class may raise anything; that is a point on the chart, not an end
            cell.status, cell.why, cell.errors = "failed", f"{type(error).__name__}: {error}", charged()
            return cell
    cell.status, cell.why, cell.errors = "refused", why, charged()
    return cell


def _key(touch: BenchCase, method: Method, fidelity: Fidelity, repeats: int, machine: str) -> str:
    told = (repr(touch), method.name, method.source, repr(fidelity), repeats, _sources(), machine, np.__version__)
    return hashlib.sha256(repr(told).encode()).hexdigest()[:24]


def _read(path: Path) -> Cell | None:
    try:
        return Cell(**json.loads(path.read_text(encoding="utf-8")) | {"kept": True})
    except (OSError, ValueError, TypeError):
        return None


@lru_cache(maxsize=1)
def _sources() -> str:
    """A hash of what any cell depends on: the code that computes, and the references."""
    digest = hashlib.sha256()
    packages = ("physics", "nodes", "messages", "models.fe", "studies.accuracy", "studies.peers")
    for package in (f"palpate.{name}" for name in packages):
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                if package != "palpate.studies.accuracy" or file.parent.name != "output":
                    digest.update(f"{package}/{file.relative_to(folder)}".encode() + file.read_bytes())
    for file in sorted(SHIPPED.glob("*.npz")):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
