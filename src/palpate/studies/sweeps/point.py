"""A point of a study, and its results."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.faults import GraphError, Location
from palpate.launch.load.files import Override
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.notes import RunNote, first_of_each_kind
from palpate.physics.errors import PalpateError
from palpate.studies.sweeps.keep import Kept, Streams
from palpate.views.run import Run


@dataclass(frozen=True)
class Point:
    """A point to compute.

    slot       number of its row and of its curves
    key        hash of everything that its results depend on
    values     value of each path of `over`
    labels     the same for tables
    recording  file of the recording; None: not kept
    """

    slot: int
    key: str
    values: dict[str, Any]
    labels: dict[str, Any]
    recording: Path | None = None


@dataclass
class Computed:
    """Results of a point.

    numbers  numbers by the text of the kept result
    curves   times [s] and values by the text of the kept result
    notes    lines for the user, the first of each kind
    error    why the point has no results; "" if it has
    seconds  duration [s], without compilation
    lost     why the study must stop, such as a full disk; "" if it can continue
    """

    numbers: dict[str, float] = field(default_factory=dict)
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    notes: list[RunNote] = field(default_factory=list)
    error: str = ""
    seconds: float = 0.0
    lost: str = ""


def overrides(values: Mapping[str, Any], key: str = "over") -> list[Override]:
    """The overrides of a point; faults in them are attributed to this key of the study."""
    return [
        Override(tuple(path.split(".")), YamlSource(value, {(): Location(f"{key} {path}")}))
        for path, value in values.items()
    ]


def kept_of(keep: Sequence[Kept], run: Run | Streams, notes: Sequence[RunNote]) -> Computed:
    """The kept results of a run."""
    done = Computed(notes=list(first_of_each_kind(notes)))
    for one in keep:
        if one.how == "curve":
            done.curves[one.text] = one.values(run)
        else:
            done.numbers[one.text] = one.number(run)
    return done


def text_of(error: Exception) -> str:
    """The error of a point, as a line."""
    if isinstance(error, GraphError):
        return " ".join(str(error).split())
    return str(error) if isinstance(error, PalpateError) else f"{type(error).__name__}: {error}"
