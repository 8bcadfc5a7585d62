"""`palpate fit force`: read sessions, choose models, write the result."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from rich.table import Table
from scipy.special import ndtr

from palpate.models.fit import report
from palpate.models.fit.crossvalidation import Protocol, choose
from palpate.models.fit.curve_fit import FitError
from palpate.models.fit.sessions import SessionError, Subject, check_stiffness, read_sessions
from palpate.physics.archive import replace_text
from palpate.physics.contact.force_band import PUBLISHED, truncated_quantile
from palpate.physics.contact.force_models import MODELS
from palpate.physics.writable import check_file

DEPTHS = np.linspace(0.0, 5.0e-3, 11)  # [m] Depths of the published experiment


@dataclass(frozen=True)
class SessionsFit:
    """Result of `fit_sessions`: plain data by subject, tables, notes, the file written, and the chosen models."""

    data: dict[str, Any]
    tables: list[Table]
    notes: list[str]
    file: Path
    chosen: list[report.Chosen]


def fit_sessions(
    sessions: Path,
    *,
    subjects: list[str],
    out: Path | None,
    mean: str | None,
    deviation: str | None,
    folds: int,
    depth_limit: float | None,
    protocol: str = "whole",
    any_stiffness: bool = False,
    dialect: str = "",
) -> SessionsFit:
    """Fit the models of the force to a file of sessions; arguments as in `palpate fit force`.

    SessionError: faults of the file, with row and column, or of the arguments.
    """
    _check_name(mean, MODELS, "--mean")
    _check_name(deviation, MODELS, "--deviation")
    _check_name(protocol, get_args(Protocol), "--protocol")
    if depth_limit is not None and not depth_limit > 0:
        raise SessionError(f"--depth-limit: found {depth_limit:g}, expected a depth > 0 [mm]")
    all_subjects, ignored = read_sessions(sessions, np.inf if depth_limit is None else depth_limit * 1e-3, dialect)
    wanted = _select(all_subjects, subjects, sessions)
    if not any_stiffness:
        check_stiffness(wanted)
    target = out or sessions.with_suffix(".model.yaml")
    with _writing(target):
        check_file(target, folders=False)
    chosen = [_choose(s, folds, mean, deviation, cast(Protocol, protocol)) for s in wanted]
    notes = report.choice_notes(chosen)
    notes += [f"Ignored columns: {', '.join(ignored)}."] if ignored else []
    with _writing(target):
        replace_text(target, report.model_yaml(chosen, sessions))
    return SessionsFit(report.choice_data(chosen), list(report.model_tables(chosen)), notes, target, chosen)


def write_example(path: Path) -> None:
    """Write synthetic sessions of two subjects, 20 sessions each. SessionError: the file exists."""
    if path.exists():
        raise SessionError(f"{path}: file exists; --example writes a new file only")
    lines = [
        "# Synthetic sessions, not measurements: the published mean and deviation of one subject, and a scaled copy.",
        "subject,session,depth [mm],force [N]",
    ]
    for seed, (name, scale) in enumerate({"A": 1.0, "B": 1.3}.items()):
        forces = scale * synthetic_sessions(seed)
        for session, row in enumerate(forces, 1):
            lines += [f"{name},{session},{d * 1e3:g},{f:.4f}" for d, f in zip(DEPTHS, row, strict=True)]
    with _writing(path):
        replace_text(path, "\n".join(lines) + "\n")


def synthetic_sessions(seed: int, sessions: int = 20, together: float = 0.5) -> np.ndarray:
    """Forces [N] (sessions,D) by the published laws at `DEPTHS`: 0 at depth 0, else drawn from N(F(d), sigma(d)²)
    truncated to f >= 0.

    seed      [1]     the same seed gives the same forces
    together  [1]     correlation of two forces of one session, in [0, 1]
    """
    random = np.random.Generator(np.random.Philox(seed))
    mean = MODELS[PUBLISHED.mean](DEPTHS, PUBLISHED.mean_parameters)
    deviation = MODELS[PUBLISHED.deviation](DEPTHS, PUBLISHED.deviation_parameters)
    whole = random.standard_normal((sessions, 1))
    single = random.standard_normal((sessions, len(DEPTHS)))
    z = np.sqrt(together) * whole + np.sqrt(1.0 - together) * single
    return np.where(DEPTHS > 0, truncated_quantile(ndtr(z), mean, deviation), 0.0)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """SessionError: the file cannot be written."""
    try:
        yield
    except OSError as error:
        raise SessionError(f"{path}: cannot be written: {error.strerror}") from None


def _check_name(name: str | None, names: Iterable[str], option: str) -> None:
    if name is not None and name not in names:
        raise SessionError(f"{option}: found {name!r}, expected one of {', '.join(names)}")


def _select(subjects: list[Subject], names: list[str], path: Path) -> list[Subject]:
    known = {s.name: s for s in subjects}
    missing = [name for name in names if name not in known]
    if missing:
        raise SessionError(
            f"{path}, column 'subject': no {', '.join(map(repr, missing))}; the file has {', '.join(known)}"
        )
    return [known[name] for name in names] or subjects


def _choose(subject: Subject, folds: int, mean: str | None, deviation: str | None, protocol: Protocol) -> report.Chosen:
    depths, forces = subject.grid()
    needed = folds + 2 if protocol == "published" else folds
    if len(subject.sessions) < needed:
        after = " after the two with the smallest and the largest sum of force are dropped"
        raise SessionError(
            f"{subject.file}, row {subject.rows[-1]}, column 'session': subject {subject.name!r} has"
            f" {len(subject.sessions)} sessions, expected at least {needed}: {folds} folds"
            f"{after if protocol == 'published' else ''} (--folds takes fewer)"
        )
    where = f"{subject.file}, from row {subject.rows[0]}"
    pressed = int(np.count_nonzero(depths > 0))
    if pressed < 6:
        raise SessionError(
            f"{where}, column 'depth': subject {subject.name!r} has {pressed} depths above 0, expected at least 6"
        )
    try:
        return report.Chosen(subject, depths, forces, choose(depths, forces, folds, mean, deviation, protocol))
    except FitError as error:
        raise SessionError(f"{where}, column 'force': subject {subject.name!r}: {error}") from None
