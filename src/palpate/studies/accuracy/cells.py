"""The matrix of results: one cell per test case, method and fidelity. Cells are cached by all that they depend on."""

import hashlib
import json
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from palpate.compiler.trust import make_folder, may_read
from palpate.physics.archive import replacing
from palpate.studies.accuracy import UnsupportedError
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.outcome import Fidelity, Method
from palpate.studies.accuracy.reference import reference_solution
from palpate.studies.accuracy.score import CHARGED_STEP, missing_score, score
from palpate.studies.accuracy.sites import SHIPPED, cache
from palpate.studies.meeting.stored import PATH as MEETINGS_PATH


@dataclass
class Cell:
    """One result.

    status          "ok", "refused" or "failed", with the reason in `why`
    errors          by quantity, see `score.Score`
    p50, p99        [s] processor time of a step;  steps: number of timed steps
    memory          [byte];  offline [s]
    law             whether the method is a contact law without a body
    kept            whether the result is cached from an earlier run
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
        """Whether the error is below the uncertainty of the reference."""
        error = self.errors.get(quantity)
        return error is not None and self.status == "ok" and error["rms"] <= error["band"]


def matrix(
    touches: Iterable[BenchCase], methods: Iterable[Method], quick: bool = False
) -> list[tuple[BenchCase, Method, Fidelity]]:
    """All cells to compute; a method that does not support a test case has one cell for it."""
    rows = []
    for touch in touches:
        for method in methods:
            fidelities = [f for f in method.fidelities if f.quick or not quick]
            rows += [(touch, method, f) for f in (fidelities[:1] if method.refuses(touch) else fidelities)]
    return rows


def compute(
    cells: list[tuple[BenchCase, Method, Fidelity]],
    repeats: int = 3,
    fresh: bool = False,
    machine: str = "",
    show: Callable[[str], None] = lambda what: None,
) -> list[Cell]:
    """Compute all cells, or read them from the cache unless `fresh`. `machine` names the processor, part of the key."""
    computed = []
    for touch, method, fidelity in cells:
        path = cache() / "cells" / f"{_key(touch, method, fidelity, repeats, machine)}.json"
        cell = None if fresh else _read(path)
        if cell is None:
            cell = one(touch, method, fidelity, repeats)
            make_folder(path.parent)
            with replacing(path, cached=True) as part:
                part.write_text(json.dumps(asdict(cell)), encoding="utf-8")
        computed.append(cell)
        show(f"{touch.name}: {method.title}, {fidelity.name}")
    return computed


def one(touch: BenchCase, method: Method, fidelity: Fidelity, repeats: int = 1) -> Cell:
    """Compute one cell. An exception of the method becomes the status `failed`."""
    cell = Cell(touch.name, method.name, method.title, fidelity.name, fidelity.rate, law=method.law)
    solution = reference_solution(touch)
    try:
        if why := method.refuses(touch):
            raise UnsupportedError(why)
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            outcome = method.compute(touch, fidelity, repeats)
        cell.errors = score(outcome, solution)
        if not all(np.isfinite(v) for error in cell.errors.values() for v in error.values()):
            raise ArithmeticError("its results are not finite")
        cell.p50, cell.p99 = (float(np.percentile(outcome.steps, p)) for p in (50, 99))
        cell.steps, cell.memory, cell.offline = len(outcome.steps), outcome.memory, outcome.offline
    except UnsupportedError as error:
        cell.status, cell.why, cell.errors = "refused", str(error), missing_score()
    except Exception as error:  # a custom class may raise anything; the benchmark continues
        cell.status, cell.why, cell.errors = "failed", f"{type(error).__name__}: {error}", missing_score()
    return cell


def _key(touch: BenchCase, method: Method, fidelity: Fidelity, repeats: int, machine: str) -> str:
    parts = (repr(touch), method.name, method.source, repr(fidelity), repeats, _sources(), machine, np.__version__)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:24]


def _read(path: Path) -> Cell | None:
    if not may_read(path):
        return None
    try:
        return Cell(**json.loads(path.read_text(encoding="utf-8")) | {"kept": True})
    except (OSError, ValueError, TypeError):
        return None


@lru_cache(maxsize=1)
def _sources() -> str:
    """Hash of the code that computes cells and of the references."""
    digest = hashlib.sha256()
    packages = (
        "compiler",
        "physics",
        "nodes",
        "messages",
        "models.fe",
        "studies.accuracy",
        "studies.meeting",
        "studies.peers",
    )
    for package in (f"palpate.{name}" for name in packages):
        spec = find_spec(package)
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            for file in sorted(Path(folder).rglob("*.py")):
                if package != "palpate.studies.accuracy" or file.parent.name != "output":
                    digest.update(f"{package}/{file.relative_to(folder)}".encode() + file.read_bytes())
    for file in (*sorted(SHIPPED.glob("*.npz")), MEETINGS_PATH):
        digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
