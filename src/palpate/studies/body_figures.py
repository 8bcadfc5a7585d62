"""Error and time of each body on the touch of a graph, as `palpate tune` measures them, for the slider of the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.deformation import bodies as known_bodies
from palpate.physics.errors import PalpateError
from palpate.physics.scratch import ScratchFolder
from palpate.records.changed import change_plan
from palpate.studies.model_error import body_of, known_error
from palpate.studies.search import Evaluation, record_touch
from palpate.studies.tune import Goal, evaluate_candidate, reference


def measure_bodies(
    launch: LaunchFile, bodies: Sequence[str], done: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Error and time of bodies on the touch of a run, as plain data.

    bodies  names for `use:`
    done    takes the finished share

    Returns `bodies`: for each that can compute the touch `error` [1], the RMS force error over the peak, the known
    error of the reference included, and `time` [s], the median of the processor time of a tick of all nodes as
    native code; `reference`, its name, and `known` [1], its known error. Or `why`: the reason, if the graph has no
    touch.
    """
    try:
        with ScratchFolder("figures") as folder:
            recording = record_touch(launch, Path(folder) / "touch.mcap")
            body = body_of(change_plan(recording).graph)
            base = reference(recording, [Evaluation({f"{body}.use": name}) for name in known_bodies()])
            known = known_error(change_plan(recording, base.texts).graph)
            found = {}
            for number, name in enumerate(bodies):
                one = evaluate_candidate(recording, Evaluation({f"{body}.use": name}), base, Goal(None, None), known)
                if not one.why:
                    found[name] = {"error": one.error, "time": one.p50}
                done((number + 1) / len(bodies))
    except PalpateError as error:
        return {"why": str(error)}
    return {"bodies": found, "reference": base.overrides[f"{body}.use"], "known": known}
