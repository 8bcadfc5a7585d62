"""Plots fields of a recording over time or over another field, one axis each."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.physics.extras import missing
from palpate.records.samples import RecordedStream
from palpate.views.errors import PictureError
from palpate.views.pictures.style import ENERGY, FRICTION, INK, NORMAL, TISSUE, figure, look

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PREFIXES = {"m": (1e3, "mm"), "m^2": (1e6, "mm^2"), "m/s": (1e3, "mm/s"), "J": (1e3, "mJ"), "Pa": (1e-3, "kPa")}
"""Units in figures instead of SI units, and the factors to them."""


def plot(run: Any, names: Sequence[str], over: str | None = None) -> Figure:
    """A figure of fields `stream.field` of a `views.run.Run` over time, or over another field at common ticks.

    PictureError, RecordingError: a field cannot be drawn.
    """
    if importlib.util.find_spec("matplotlib") is None:
        raise PictureError(missing("plots", "matplotlib", "view"))
    if not names:
        raise PictureError(
            f"nothing to plot; name fields of {run.path} as STREAM.FIELD; streams: {', '.join(run.streams)}"
        )
    across = None if over is None else _drawable(run, over)
    if across is not None and across[0].ndim > 1:
        raise PictureError(f"{over!r} is a vector; expected a number to plot over, such as contact.indentation")
    with look():
        out = figure(9.0, 1.2 + 2.1 * len(names), run.path.name, current=True)
        panels = out.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, names, strict=True):
            plain, unit, where, ticks = _drawable(run, name)
            if across is not None:
                _, mine, other = np.intersect1d(ticks, across[3], return_indices=True)
                where, plain = across[0][other], plain[mine]
            if plain.ndim == 1:
                axes.plot(where, plain, color=NORMAL, linewidth=1.2)
            else:
                palette = (NORMAL, FRICTION, ENERGY, TISSUE, INK)
                for i in range(plain.shape[1]):
                    label = "xyz"[i] if plain.shape[1] == 3 else str(i)
                    axes.plot(where, plain[:, i], color=palette[i % 5], linewidth=1.2, label=label)
                if plain.shape[1] <= 5:
                    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=plain.shape[1])
            axes.set(title=name, ylabel=f"[{unit}]")
        panels[-1].set_xlabel("time [s]" if across is None else f"{over} [{across[1]}]")
    return out


def _drawable(run: Any, name: str) -> tuple[np.ndarray, str, np.ndarray, np.ndarray]:
    """Values of a field in the unit of figures, this unit, times [s] and ticks."""
    values = run[name]
    if isinstance(values, RecordedStream):
        raise PictureError(f"{name!r} is a stream; name one of its fields: "
                        f"{', '.join(f'{name}.{field}' for field in values.columns)}")  # fmt: skip
    if isinstance(values, list):
        raise PictureError(f"{name!r} has arrays of changing length; `palpate picture` draws the shape")
    if not len(values):
        raise PictureError(f"{name!r}: no message was recorded")
    plain, stream = np.asarray(values), name.rpartition(".")[0]
    if plain.dtype.kind not in "bif" or plain.ndim > 2:
        raise PictureError(f"{name!r} is not a number or vector; `palpate echo {run.path} {stream}` shows it")
    factor, unit = PREFIXES.get(values.unit, (1.0, values.unit))
    return plain * factor, unit, values.time, run[stream].tick
