"""Fits of several specimens: presses grouped by specimen, a folder and a row of the table for each."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.fit import TissueFit
from palpate.models.fit.tissue.measured import MeasuredPress

LONGEST = 60  # characters of the name of a folder


@dataclass
class SpecimenFits:
    """The fit of each specimen by its label, the folder that it is written to, and why some were not fitted."""

    fits: dict[str, TissueFit]
    folders: dict[str, str]
    refused: dict[str, str]


def by_specimen(presses: Sequence[MeasuredPress]) -> dict[str, list[MeasuredPress]]:
    """Label of a specimen -> its presses, "" if no file names two. SessionError: some presses have no label."""
    labels = dict.fromkeys(press.specimen for press in presses if press.specimen)
    if len(labels) < 2:
        return {"": list(presses)}
    if unnamed := [press.name for press in presses if not press.specimen]:
        raise SessionError(
            f"{', '.join(unnamed)}: names no specimen, but the other presses are of {', '.join(labels)}; name it in a "
            "column `specimen`, or fit all as one specimen with --columns specimen="
        )
    return {label: [press for press in presses if press.specimen == label] for label in labels}


def fit_each(
    groups: Mapping[str, Sequence[MeasuredPress]],
    held_out: Sequence[MeasuredPress],
    fit: Callable[[str, Sequence[MeasuredPress], Sequence[MeasuredPress]], TissueFit],
) -> SpecimenFits:
    """Fit every specimen alone. A held-out press is predicted by its specimen, or by each if it is of none of them.

    fit  label, presses and held-out presses -> the fit

    SessionError: no specimen can be fitted, with the reason for each.
    """
    fits, refused = {}, {}
    for label, presses in groups.items():
        others = [press for press in held_out if press.specimen == label or press.specimen not in groups]
        try:
            fits[label] = fit(label, presses, others)
        except SessionError as error:
            refused[label] = str(error)
    if not fits:
        raise SessionError("\n".join(f"specimen {label}: {text}" for label, text in refused.items()))
    return SpecimenFits(fits, folders_of(groups), refused)


def folders_of(labels: Iterable[str]) -> dict[str, str]:
    """Label -> name of a folder: the letters, digits, points and signs of the label, different for each in any case."""
    folders: dict[str, str] = {}
    for number, label in enumerate(labels, 1):
        plain = re.sub(r"[^\w.+]+", "-", label).strip("-.")[:LONGEST]
        name = f"specimen-{plain or number}"
        taken = {folder.casefold() for folder in folders.values()}
        folders[label] = f"{name}-no-{number}" if name.casefold() in taken else name
    return folders


def table_of_fits(found: SpecimenFits) -> tuple[list[str], list[list[str]]]:
    """Heads, and one row per specimen: its label, number of presses, and each parameter with its interval."""
    first = next(iter(found.fits.values()))
    heads = ["specimen", "presses", *(f"{p.name} [{p.unit}]" for p in first.estimate.parameters)]
    rows = []
    for label, fit in found.fits.items():
        cells = [
            f"{i.value:.4g} ({'withheld' if fit.estimate.withheld else f'{i.low:.4g} to {i.high:.4g}'})"
            for i in fit.estimate.intervals.values()
        ]
        rows.append([label, str(len(fit.presses)), *cells])
    return heads, rows + [[label, *["not fitted"] * (len(heads) - 1)] for label in found.refused]


def texts_of_fits(texts: Mapping[str, Sequence[str]]) -> list[str]:
    """The texts (notes) of each specimen, with the labels in front of those that not all have."""
    owners: dict[str, list[str]] = {}
    for label, each in texts.items():
        for text in dict.fromkeys(each):
            owners.setdefault(text, []).append(label)
    return [
        text if len(labels) == len(texts) else f"{', '.join(labels)}: {text}" for text, labels in owners.items()
    ]  # fmt: skip


def overview(found: SpecimenFits) -> str:
    """The table of all specimens as Markdown, with links to their reports."""
    heads, rows = table_of_fits(found)
    lines = ["# Specimens", "", "Each is fitted alone, with 95 % intervals; its notes are in its report.", ""]
    lines += [f"| {' | '.join([*heads, 'report'])} |", "|---" * (len(heads) + 1) + "|"]
    for row in rows:
        link = f"[report]({found.folders[row[0]]}/report.md)" if row[0] in found.fits else found.refused[row[0]]
        cells = [cell.replace("|", "\\|") for cell in (*row, link)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])
