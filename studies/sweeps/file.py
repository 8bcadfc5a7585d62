"""Studies as YAML files.

graph: kidney                     # or a launch file or graph; `scene`, `duration`, `set` as there
over:                             # what varies
  tissue.stiffness: {linspace: [200, 400, 5]}
  tissue.use: [deformation.MassSpring, deformation.Rigid]
keep: [peak contact.force, curve contact.force]
"""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from palpate.launch.load.files import GRAPHS
from palpate.launch.load.values.lines import quantity
from palpate.studies.files import Text, Whole, filled, found, graph_of
from palpate.studies.sweeps.point import overrides
from palpate.studies.sweeps.study import Study

STUDIES = GRAPHS / "studies"
_Mapping = Annotated[dict[str, Any], msgspec.Meta(description="a mapping")]


class _File(msgspec.Struct, kw_only=True):
    """What the file says: the arguments of `Study`."""

    graph: Text = "kidney"
    over: Annotated[_Mapping, msgspec.Meta(description="a mapping such as {tissue.stiffness: [200, 400]}")]
    keep: Annotated[list[str], msgspec.Meta(description="a list such as [peak contact.force]")]
    scene: str | dict[str, Any] | None = None
    duration: Annotated[float, quantity("s", 1e-9, 1e9)] | None = None
    set: Annotated[dict[str, Any], msgspec.Meta(description="a mapping such as {tissue.damping: 4}")] = {}
    samples: Whole = 0
    design: Text = "sobol"
    seed: Whole = 0
    sensitivity: Text | None = None
    limit: Annotated[float, quantity("s", 1e-3, 1e9)] | Literal["none"] = 600.0


def find(name: str) -> Path:
    """The file of a study that ships, or of a path. GraphError: there is none."""
    return found(name, STUDIES, "study")


def load(path: Path, sensitivity: str | None = None, samples: int | None = None) -> Study:
    """The study that a file describes. The other arguments replace what it says.

    GraphError: what is wrong with the file. ArgumentError: what is wrong with the study.
    """
    given, _ = filled(_File, path, "graph, over and keep")
    own = msgspec.structs.asdict(given)
    sets = overrides(own.pop("set"), "set")
    own |= {"graph": graph_of(path, given.graph), "limit": None if given.limit == "none" else given.limit}
    own |= {"sensitivity": sensitivity or given.sensitivity, "samples": given.samples if samples is None else samples}
    return Study(**own, sets=sets)
