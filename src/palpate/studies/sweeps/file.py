"""Studies as YAML files.

graph: kidney               # or a launch file or graph; with `scene`, `duration`, `organ`, `set` as in a launch file
over:                             # varied settings
  tissue.stiffness: {linspace: [200, 400, 5]}
  tissue.use: [deformation.MassSpring, deformation.Rigid]
keep: [peak contact.force, curve contact.force]
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from palpate.engine.faults import Location
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.organ_file import OrganFile, organ_of
from palpate.launch.load.values.lines import quantity
from palpate.launch.load.values.source import read
from palpate.studies.files import Text, Whole, fill_struct, graph_of, locate_file
from palpate.studies.sweeps.point import overrides
from palpate.studies.sweeps.study import Study

STUDIES = GRAPHS / "studies"
_Mapping = Annotated[dict[str, Any], msgspec.Meta(description="a mapping")]


class _File(msgspec.Struct, kw_only=True):
    """Content of the file: the arguments of `Study`."""

    graph: Text = "kidney"
    over: Annotated[_Mapping, msgspec.Meta(description="a mapping such as {tissue.stiffness: [200, 400]}")]
    keep: Annotated[list[str], msgspec.Meta(description="a list such as [peak contact.force]")]
    scene: str | dict[str, Any] | None = None
    duration: Annotated[float, quantity("s", 1e-9, 1e9)] | None = None
    organ: str | dict[str, Any] | None = None
    set: Annotated[dict[str, Any], msgspec.Meta(description="a mapping such as {tissue.damping: 4}")] = {}
    samples: Whole = 0
    design: Text = "sobol"
    seed: Whole = 0
    sensitivity: Text | None = None
    limit: Annotated[float, quantity("s", 1e-3, 1e9)] | Literal["none"] = 600.0


def find(name: str) -> Path:
    """The file of a shipped study, or at a path. GraphError: it does not exist."""
    return locate_file(name, STUDIES, "study")


def load(
    path: Path, sensitivity: str | None = None, samples: int | None = None, organ: OrganFile | None = None
) -> Study:
    """The study that a file describes. The other arguments replace its entries.

    GraphError: the file is invalid. ArgumentError: the study is invalid.
    """
    given = fill_struct(_File, read(path), "graph, over and keep")
    values = msgspec.structs.asdict(given)
    sets = overrides(values.pop("set"), "set")
    values["organ"] = organ or (None if given.organ is None else organ_of(given.organ, Location(str(path))))
    values |= {"graph": graph_of(path, given.graph), "limit": None if given.limit == "none" else given.limit}
    values |= {
        "sensitivity": sensitivity or given.sensitivity,
        "samples": given.samples if samples is None else samples,
    }
    return Study(**values, sets=sets)
