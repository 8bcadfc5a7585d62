"""Picture of `palpate fit run`: each measured field with the fit, and its residuals."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.views.pictures.style import figure, look, saved

AXES = "xyz"


class FittedField(NamedTuple):
    """A field of a recording: time [s] (n), measured and fitted values (n, k), and its label."""

    label: str
    time: np.ndarray
    measured: np.ndarray
    fitted: np.ndarray


@look()
def draw_fit_run(fields: Sequence[FittedField], title: str, folder: Path) -> list[Path]:
    """A row for each field: values, and the fit minus the measured values."""
    out = figure(11.0, 2.6 * len(fields) + 0.6, title)
    axes = out.subplots(len(fields), 2, squeeze=False)
    for row, each in zip(axes, fields, strict=True):
        for k in range(each.measured.shape[1]):
            part = f" {AXES[k]}" if each.measured.shape[1] == 3 else ""
            row[0].plot(each.time, each.measured[:, k], ".", ms=2, color=f"C{k}", label=f"measured{part}")
            row[0].plot(each.time, each.fitted[:, k], "k-", lw=0.8, label=None if k else "fit")
            row[1].plot(each.time, each.fitted[:, k] - each.measured[:, k], ".", ms=1.5, color=f"C{k}")
        row[0].set(xlabel="time [s]", ylabel=each.label)
        row[1].axhline(0.0, color="k", lw=0.5)
        row[1].set(xlabel="time [s]", ylabel="fit minus measured")
        row[0].legend(fontsize=7)
    return saved(folder, fit=out)
