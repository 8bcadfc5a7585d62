"""`palpate.run`: run a graph with keyword arguments and open its recording."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.bases import build_missing
from palpate.launch.load.arguments import Organ, check_path, describe_run
from palpate.launch.load.placement import FUSED, find_place
from palpate.launch.load.recording import new_folder, recording_name
from palpate.launch.run.execute import execute
from palpate.launch.run.notes import warn
from palpate.launch.run.progress import preparing
from palpate.launch.run.work.shared import share_surfaces
from palpate.physics.errors import ArgumentError, RunError
from palpate.physics.scratch import ScratchFolder
from palpate.views.run import Run


def run(
    graph: str | Path = "kidney",
    *,
    record: str | Path | bool | None = True,
    force: bool = False,
    duration: float | str | None = None,
    scene: str | None = None,
    clock: str | None = None,
    place: str | Path | None = None,
    organ: Organ = None,
    sets: Sequence[str] | Mapping[str, Any] = (),
    **nodes: str | Mapping[str, Any],
) -> Run:
    """Run a graph to its end and open its recording; `palpate run` does the same from the shell.

    graph     name of a shipped launch file or graph, or a path
    record    file of the recording; True: a new file below runs/; False or None: no file is kept, the messages are in a
              temporary one as long as the returned run exists
    force     overwrite a file that is not a recording
    duration  [s] on the graph's clock, or a text with a unit
    scene     replaces the scene of the graph
    clock     "simulated" or "real"
    place     "fused", or a placement file. Default: on simulated time all nodes run in this process, which gives the
              same bytes as any other placement; on real time each node runs in a separate process
    organ     mesh file instead of the scene's organ, "liver.stl", or {"file": "liver.stl", "unit": "mm", "piece": 2};
              a label of a segmentation, {"file": "seg.nii.gz", "label": "liver"}
    sets      single values in the form of `--set`: ["tissue.stiffness=2e3"], or {"tissue.stiffness": 2e3}
    nodes     a model, tissue="deformation.ReducedFE", or settings, tissue={"stiffness": 2e3}

    The lines that `palpate run` prints about the run are in `notes`; the first of each kind is also a PalpateWarning.

    PalpateError: the graph is invalid, or a node failed. OSError: the recording cannot be written. KeyboardInterrupt:
    Ctrl-C; the file keeps everything recorded before it.
    """
    if clock not in (None, "simulated", "real"):
        raise ArgumentError(f"clock: found {clock!r}, expected 'simulated' or 'real'")
    quiet = not sys.stderr.isatty()
    with preparing(quiet):
        launch = describe_run(graph, scene=scene, duration=duration, sets=sets, nodes=nodes, organ=organ)
    launch = launch.but(clock=clock, place=find_place(place))
    if launch.duration is None:
        raise ArgumentError(f"{graph}: the graph has no duration, so the run would never end; pass duration=2.0 [s]")
    with preparing(quiet):
        loaded = launch.load()
        share_surfaces(loaded)
    build_missing(loaded, quiet=quiet)
    may_fuse = launch.place is None and launch.clock != "real"
    if may_fuse and not any(spec.cls.hardware for spec in loaded.nodes.values()):
        launch = launch.but(place=FUSED)  # same result, without starting processes
    temporary = None
    with contextlib.ExitStack() as ending:
        name = Path(graph).stem
        if record is True:
            file = ending.enter_context(new_folder(name)) / f"{name}.mcap"
        elif record is None or record is False:
            temporary = ScratchFolder("run")
            file = Path(temporary.name) / f"{name}.mcap"
        else:
            file = recording_name(check_path("record", record), "record")
        outcome = execute(launch.but(record=file), loaded, force=force)
    outcome.raise_signal()
    if not outcome.result.ok:
        kept = "" if temporary else f" What was recorded before is in {outcome.recording}."
        raise RunError("; ".join(map(str, outcome.result.deaths)) + kept)
    if not outcome.ok:
        raise RunError("; ".join(outcome.result.notes) or f"the recording {outcome.recording} is not whole")
    run = Run(file)
    run._recording.temporary = temporary
    run.notes = outcome.notes
    warn(run.notes)
    return run
