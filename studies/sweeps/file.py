"""Studies as YAML files.

graph: kidney                     # or a launch file or graph; `scene`, `duration`, `set` as there
over:                             # what varies
  tissue.stiffness: {linspace: [2e3, 4e3, 5]}
  tissue.use: [deformation.MassSpring, deformation.Rigid]
keep: [peak contact.force, curve contact.force]
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from palpate.engine.faults import Faults
from palpate.launch.load.files import GRAPHS, find_file
from palpate.launch.load.values.lines import fill, quantity
from palpate.launch.load.values.source import read
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.point import overrides
from palpate.studies.sweeps.study import Study

STUDIES = GRAPHS / "studies"
_Text = Annotated[str, msgspec.Meta(description="a text")]
_Mapping = Annotated[dict[str, Any], msgspec.Meta(description="a mapping")]
_Whole = Annotated[int, msgspec.Meta(ge=0, description="a whole number from 0")]


class _File(msgspec.Struct, kw_only=True):
    """What the file says: the arguments of `Study`, and where it runs."""

    graph: _Text = "kidney"
    over: Annotated[_Mapping, msgspec.Meta(description="a mapping such as {tissue.stiffness: [2e3, 4e3]}")]
    keep: Annotated[list[str], msgspec.Meta(description="a list such as [peak contact.force]")]
    scene: str | dict[str, Any] | None = None
    duration: Annotated[float, quantity("s", 1e-9, 1e9)] | None = None
    set: Annotated[dict[str, Any], msgspec.Meta(description="a mapping such as {tissue.damping: 4}")] = {}
    samples: _Whole = 0
    design: _Text = "sobol"
    seed: _Whole = 0
    sensitivity: _Text | None = None
    limit: Annotated[float, quantity("s", 1e-3, 1e9)] | Literal["none"] = 600.0
    slurm: _Mapping = {}


def find(name: str) -> Path:
    """The file of a study that ships, or of a path. GraphError: there is none."""
    shipped = STUDIES / f"{name}.yaml"
    return shipped if "/" not in name and shipped.is_file() else find_file(name, STUDIES, what="study")


def load(path: Path, sensitivity: str | None = None, samples: int | None = None) -> tuple[Study, dict[str, Any]]:
    """The study that a file describes, and its `slurm:`. The other arguments replace what it says.

    GraphError: what is wrong with the file. ArgumentError: what is wrong with the study.
    """
    source, faults = read(path), Faults()
    if not isinstance(source.data, dict):
        faults.add("expected a mapping with graph, over and keep", "", source.place())
        faults.done()
    given = fill(_File, source, faults)
    faults.done()
    assert given is not None
    beside = path.parent / given.graph
    study = Study(
        beside if beside.is_file() else given.graph,
        given.over,
        given.keep,
        scene=given.scene,
        duration=given.duration,
        sets=overrides(given.set, "set"),
        samples=given.samples if samples is None else samples,
        design=given.design,
        seed=given.seed,
        sensitivity=sensitivity or given.sensitivity,
        limit=None if given.limit == "none" else given.limit,
    )
    jobs = given.slurm.get("jobs", 1)
    if not isinstance(jobs, int) or jobs < 1:
        raise ArgumentError(f"{path}: slurm: jobs: found {jobs!r}, expected a whole number from 1")
    return study, given.slurm
