"""Scenes that differ by a motion of the whole, a reflection, a shift in time or an exchange of names."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from palpate.physics.geometry.mesh import Mesh, write_ply
from palpate.studies.organs.pairs import turn_touch
from palpate.studies.organs.score import Score
from palpate.studies.organs.touches import Finger, reachable
from palpate.studies.organs.zoo import FAR, specimen_of
from palpate.studies.relations.relation import Case, Claim, Relation, move_hand, same_force
from palpate.studies.relations.runs import Run, Trace

ROUNDING = 1e-6  # [1] of the peak
HELD = 1e-3
"""[1] of the peak. The device holds the torques of its motors for a tick, while its legs turn: in another direction the
grip is elsewhere after it, by 5 nm at 250 Hz."""
FAST = 1000.0  # [Hz]
MIRROR = np.diag([1.0, -1.0, 1.0])
FARTHEST = 0.5  # [m] of a shift
WAIT = 0.1  # [s]
DEVICE = ("device", "finger", "statics")


def _same(case: Case, other: Run, share: float = ROUNDING) -> Claim:
    """The forces of the case and of another run are the same."""
    return Claim((case.run, other, case.near), partial(same_force, share=share))


def _exact(case: Case, least: float = 0.0) -> Case:
    """The case with an exact encoder, at a rate [Hz] not below `least`."""
    return case.but(exact=True, rate=max(least, case.touch.setting.rate))


def turned(case: Case, rng: np.random.Generator) -> Claim | None:
    exact = _exact(case, FAST)
    touch = turn_touch(exact.touch, Rotation.random(random_state=case.batch))
    if not all(map(reachable, touch.fingers)):
        return None
    return _same(exact, exact.run_of(touch), HELD)


def shifted(case: Case, rng: np.random.Generator) -> Claim:
    exact, by = _exact(case), case.shared.uniform(-FARTHEST, FARTHEST, size=3)
    run = move_hand(exact.run, by)
    places = ["scene.surface.position", *(f"{node}.origin" for node in DEVICE)]
    moved = {name: (np.array(run.sets[name], dtype=float) + by).tolist() for name in places}
    return _same(exact, run.but(moved))


def mirrored(case: Case, rng: np.random.Generator) -> Claim | None:
    """The plane of the reflection is a plane of symmetry of the device."""
    setting = case.touch.setting
    if not setting.count:
        return None
    exact = _exact(case, FAST)
    finger = exact.touch.fingers[0]
    path = [s | {"to": (MIRROR @ s["to"]).tolist()} if "to" in s else s for s in finger.path]
    other = Finger(_three(MIRROR @ finger.begin), _three(MIRROR @ finger.origin), tuple(path))
    if not reachable(other):
        return None
    turn = -MIRROR @ np.array(setting.rotation)
    changes = {
        "scene.surface.surface": _changed_file(case, "mirrored", _reflect), "scene.surface.file_unit": "m",
        "scene.surface.position": (MIRROR @ setting.position).tolist(), "scene.surface.rotation": turn.tolist(),
        "scene.hand.begin": list(other.begin), "scene.hand.path": path,
    } | {f"{node}.origin": list(other.origin) for node in DEVICE}  # fmt: skip
    return _same(exact, exact.run.but(changes), HELD)


def _three(point: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(c) for c in point)
    return (x, y, z)


def _changed_file(case: Case, name: str, change: Callable[[Mesh], Mesh]) -> str:
    """The file of a changed mesh [m], in the frame of the file that `zoo.write_mesh` writes. It is written once."""
    setting = case.touch.setting
    file = case.folder / f"{setting.surface}-{setting.count}-{name}.ply"
    if not file.is_file():
        mesh = specimen_of(setting.surface).make(setting.count)
        case.folder.mkdir(parents=True, exist_ok=True)
        write_ply(file, change(Mesh(mesh.vertices + FAR, mesh.triangles)))
    return str(file)


def _reflect(mesh: Mesh) -> Mesh:
    return Mesh(mesh.vertices @ MIRROR, np.ascontiguousarray(mesh.triangles[:, ::-1]))


def _shuffle(mesh: Mesh) -> Mesh:
    rng = np.random.default_rng(0)
    order = rng.permutation(len(mesh.vertices))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    triangles = place[mesh.triangles][rng.permutation(len(mesh.triangles))]
    return Mesh(mesh.vertices[order], triangles.astype(np.int32))


def waited(case: Case, rng: np.random.Generator) -> Claim:
    """The hand rests first; the time is a whole number of ticks at every rate."""
    exact = _exact(case)
    path = [{"hold": WAIT}, *exact.run.sets["scene.hand.path"]]

    def judge(one: Trace, two: Trace, near: Trace) -> Score:
        ticks = round(WAIT / one.step)
        return same_force(one.between(0, -ticks), two.between(ticks, None), near.between(0, -ticks), ROUNDING)

    return Claim((exact.run, exact.run.but({"scene.hand.path": path}), exact.near), judge)


def numbered(case: Case, rng: np.random.Generator) -> Claim | None:
    """The same triangles in another order."""
    return _of_file(case, "shuffled", _shuffle)


def metres(case: Case, rng: np.random.Generator) -> Claim | None:
    """The mesh of the file in metres in place of millimetres."""
    return _of_file(case, "metres", lambda mesh: mesh)


def _of_file(case: Case, name: str, change: Callable[[Mesh], Mesh]) -> Claim | None:
    """A file of the same surface gives the same forces."""
    if not case.touch.setting.count:
        return None
    exact = _exact(case)
    changes = {"scene.surface.surface": _changed_file(case, name, change), "scene.surface.file_unit": "m"}
    return _same(exact, exact.run.but(changes))


EXACT = "1e-6 of the peak, or what 3 µm change"
TURNED = "1e-3 of the peak, or what 3 µm change"
RELATIONS = (
    Relation("turned", "organ and hand turned together: the same forces", TURNED, turned),
    Relation("shifted", "organ, hand and device moved together: the same forces", EXACT, shifted),
    Relation("mirrored", "organ and hand reflected: the same forces", TURNED, mirrored),
    Relation("waited", "a touch that begins later is the same", EXACT, waited),
    Relation("numbered", "vertices and triangles in another order: the same forces", EXACT, numbered),
    Relation("metres", "the mesh in metres in place of millimetres: the same forces", EXACT, metres),
)
