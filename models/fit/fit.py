"""What `palpate fit` does: read sessions, choose models or fit a law, write."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
from rich.table import Table

from palpate.models.fit import report
from palpate.models.fit.crossvalidation import Protocol, choose
from palpate.models.fit.curve_fit import FitError, fit_curve
from palpate.models.fit.sessions import SessionError, Subject, check_stiffness, read_sessions
from palpate.models.fit.synthetic_sessions import DEPTHS, synthetic_sessions
from palpate.physics.contact.force_models import LAWS, MODELS
from palpate.physics.writable import check_file


@dataclass(frozen=True)
class Told:
    """What a fit found: plain data by subject, tables, notes, the file written, and what can be drawn."""

    data: dict[str, Any]
    tables: list[Table]
    notes: list[str]
    file: Path
    chosen: list[report.Chosen]
    fitted: list[report.Fitted]


def fit_sessions(
    sessions: Path,
    *,
    law: str | None,
    subjects: list[str],
    out: Path | None,
    mean: str | None,
    deviation: str | None,
    folds: int,
    depth_limit: float | None,
    protocol: str = "whole",
    any_stiffness: bool = False,
) -> Told:
    """Fit the models of the force, or a contact law, to a file of sessions; arguments as of `palpate fit`.

    SessionError: what is wrong with the file or the arguments, by row and column.
    """
    _known(law, LAWS, "--law")
    _known(mean, MODELS, "--mean")
    _known(deviation, MODELS, "--deviation")
    _known(protocol, get_args(Protocol), "--protocol")
    if depth_limit is not None and not depth_limit > 0:
        raise SessionError(f"--depth-limit: found {depth_limit:g}, expected a depth > 0 [mm]")
    all_subjects, ignored = read_sessions(sessions, np.inf if depth_limit is None else depth_limit * 1e-3)
    wanted = _select(all_subjects, subjects, sessions)
    if not any_stiffness:
        check_stiffness(wanted)
    target = out or sessions.with_suffix(".model.yaml" if law is None else ".law.yaml")
    try:
        check_file(target, folders=False)
    except OSError as error:
        raise _unwritten(target, error) from None
    chosen: list[report.Chosen] = []
    fitted: list[report.Fitted] = []
    if law is None:
        chosen = [_choose(s, folds, mean, deviation, cast(Protocol, protocol)) for s in wanted]
        data, text = report.choice_data(chosen), report.model_yaml(chosen, sessions)
        tables, notes = list(report.model_tables(chosen)), report.choice_notes(chosen)
    else:
        fitted = [_fit_law(s, law) for s in wanted]
        data, text = {f.subject.name: report.plain(f.fit) for f in fitted}, report.law_yaml(fitted, sessions)
        tables = [report.parameters(f"Subject {f.subject.name}: ", f.fit) for f in fitted]
        notes = [f.note for f in fitted if f.note]
    notes += [f"Ignored columns: {', '.join(ignored)}."] if ignored else []
    _write(target, text)
    return Told(data, tables, notes, target, chosen, fitted)


def write_example(path: Path) -> None:
    """Write synthetic sessions of two subjects, 20 sessions each. SessionError: the file is there already."""
    if path.exists():
        raise SessionError(f"{path}: is there already; --example writes a new file only")
    lines = [
        "# Synthetic sessions, not measurements: the published mean and deviation of one subject, and the same scaled.",
        "subject,session,depth [mm],force [N]",
    ]
    for seed, (name, scale) in enumerate({"A": 1.0, "B": 1.3}.items()):
        forces = scale * synthetic_sessions(seed)
        for session, row in enumerate(forces, 1):
            lines += [f"{name},{session},{d * 1e3:g},{f:.4f}" for d, f in zip(DEPTHS, row, strict=True)]
    _write(path, "\n".join(lines) + "\n")


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise _unwritten(path, error) from None


def _unwritten(path: Path, error: OSError) -> SessionError:
    return SessionError(f"{path}: cannot be written: {error.strerror}")


def _known(name: str | None, names: Iterable[str], option: str) -> None:
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


def _fit_law(subject: Subject, law: str) -> report.Fitted:
    """Fit a law; without two speeds in the data, Hunt-Crossley's keeps its static part only, and a note says so."""
    model, columns, note = LAWS[law], [subject.depth], ""
    if model.columns == 2 and (subject.rate is None or np.ptp(subject.rate) == 0):
        model = LAWS["power"]
        note = (
            f"Subject {subject.name}: {'no' if subject.rate is None else 'only one'} speed in the data, so the damping"
            " is not determined, and the static part K d^n is fitted. For c, give a column rate [mm/s] or time [s]."
        )
    elif model.columns == 2 and subject.rate is not None:
        columns.append(subject.rate)
    labels = subject.session if len(subject.sessions) > 1 else None
    try:
        return report.Fitted(subject, fit_curve(model, np.stack(columns, axis=1), subject.force, labels), note)
    except FitError as error:
        raise SessionError(f"{subject.file}, from row {subject.rows[0]}: subject {subject.name!r}: {error}") from None
