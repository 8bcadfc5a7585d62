"""Nothing silent: a touch that is outside the range of a model must print a note.

Whether it is outside is decided by geometry alone: the tissue is indented by more than its thickness, the patch is
wider than the body, the nearest point of the surface jumps while the finger presses (both sides of a thin part, two
walls of a groove, a focal point), or two fingers press nearly the same place. Coarse triangles are refined when they
are loaded, which a note of the start reports.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np

from palpate.launch.load.placement import fuse_nodes
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.run.assign import jobs
from palpate.launch.run.reports import Note, Report
from palpate.launch.run.work.simulated import run_simulated
from palpate.launch.run.work.worker import Worker
from palpate.nodes import collision
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.organs.bounds.crowded import is_crowded
from palpate.studies.organs.bounds.side import EVERY, MOVES
from palpate.studies.organs.runs import launch
from palpate.studies.organs.touches import Touch
from palpate.studies.organs.trace import LEAST_FORCE, Trace, length

DEEP = 0.1  # [m] of the search for the other side
LEAPS = 3e-3  # [m] that a point moves more than the finger explains
WIDER = "wider than the organ"  # in the note of `nodes.spread`


def reasons(trace: Trace, mesh: Mesh, known: Collection[str] = ()) -> list[str]:
    """Why a touch is outside the range of the models: words; empty if it is inside.

    known  words that are left out
    """
    f = trace["contact.force"]
    if not f.max() > LEAST_FORCE:
        return []
    return [word for word, holds in REASONS.items() if word not in known and holds(trace, mesh)]


def _exceeds_thickness(trace: Trace, _: Mesh) -> bool:
    k = int(np.argmax(trace["contact.indentation"]))
    foot, normal = trace["contact.foot"][k], trace["contact.normal"][k]
    return bool(trace["contact.indentation"][k] > _thickness(foot, normal, trace.closest))


def _is_narrow(trace: Trace, mesh: Mesh) -> bool:
    return bool(0.5 * float(np.sort(np.ptp(mesh.vertices, axis=0))[1]) < trace.rest.radius)


def _jumps(trace: Trace, _: Mesh) -> bool:
    """Whether the nearest point leaps, unless the foot stays and the finger barely passes the middle of a thin part."""
    pressed = np.flatnonzero(trace["contact.force"] > LEAST_FORCE)[:: trace.ticks(EVERY)]
    place, foot = trace["finger.position"][pressed], trace["contact.foot"][pressed]
    nearest, _normals, _curvatures, distance = trace.closest(place)
    motion, leap, step = (length(np.diff(points, axis=0)) for points in (place, nearest, foot))
    farther = length(place - foot) - np.abs(distance) > collision.Mesh.hysteresis
    explained = MOVES * motion + LEAPS
    return bool((leap > explained).any() and (farther.any() or (step > explained).any()))


def _crowds(trace: Trace, _: Mesh) -> bool:
    return is_crowded(trace)


REASONS = {"thickness": _exceeds_thickness, "patch": _is_narrow, "jump": _jumps, "fingers": _crowds}


def _thickness(foot: np.ndarray, normal: np.ndarray, closest: Callable[..., tuple[np.ndarray, ...]]) -> float:
    """Distance [m] through the body from a point of its surface, against its normal."""
    deep = np.arange(2e-4, DEEP, 2e-4)
    outside = closest(foot - normal * deep[:, None])[3] > 0.0
    return float(deep[int(np.argmax(outside))]) if outside.any() else DEEP


def collect_notes(touch: Touch, folder: Path) -> list[str]:
    """The notes that a single run of the touch prints while it runs, and of those of its start the one on its patch:
    a patch wider than the body is known before the run.

    GraphError, NodeError: the setting is refused.
    """
    texts: list[str] = []

    def report(what: Report) -> None:
        if isinstance(what, Note):
            texts.append(what.text)

    graph = launch(touch.setting, folder, touch.duration, touch.hand_sets()).load()
    set_recording(graph, None)
    planned = plan(graph)
    (job,) = jobs(planned, fuse_nodes(planned), ticks=round(touch.duration * touch.setting.rate))
    worker = Worker(job, None, report)
    try:
        worker.start()
        worker.begin(0)
        for slot in worker.slots:
            texts += slot.node.notes()
        started = {text for text in texts if WIDER not in text}
        run_simulated(worker)
        for slot in worker.slots:
            texts += slot.node.notes()
    finally:
        worker.stop()
    return [text for text in dict.fromkeys(texts) if text not in started]
