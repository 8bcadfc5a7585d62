"""Finds organs that lie in each other, where the forces of one finger on them would be added (contact.Sum)."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np

from palpate.engine.graph import NodeSpec
from palpate.launch.load.contact_paths import ContactPaths
from palpate.launch.load.wiring import Wire
from palpate.messages import Contact, Pose, Proximity
from palpate.physics.errors import PalpateError

TOUCHES = 1e-4  # [m] depth up to which organs only touch
VERTICES = 10_000  # of a smooth surface


SurfaceAt = tuple[Any, ...]
"""Arguments of `surface_mesh`, and the digest of the file."""


@dataclass(frozen=True)
class Overlap:
    """Two organs that lie in each other: whether they coincide, what to report, and the second one."""

    same: bool
    text: str
    cure: str
    organ: "Organ"


def overlaps(nodes: dict[str, NodeSpec], wires: Iterable[Wire]) -> Iterator[Overlap]:
    """Each pair of organs in which one finger would feel the tissue twice.

    The surfaces are those of the nodes of collision. Organs that only touch, or that different fingers touch, are left
    out, as are surfaces that cannot be read, which their node reports.
    """
    wires = list(wires)
    added = [name for name in nodes if sum(w.consumer == name and _adds(w) for w in wires) > 1]
    if not added:
        return
    paths = ContactPaths({name: spec.cls for name, spec in nodes.items()}, wires)
    done = set()
    for name in added:
        touched = [
            organ for wire in paths.incoming.get(name, ()) if _adds(wire) for organ in _organ(paths, wire.producer)
        ]
        for one, other in combinations(touched, 2):
            if one.finger == other.finger and one.body != other.body and (one.body, other.body) not in done:
                done.add((one.body, other.body))
                yield from _pair(one, other, nodes)


@dataclass(frozen=True)
class Organ:
    """What a contact presses: names of the sender of the finger's pose, of the collision and of the body."""

    finger: str
    collision: str
    body: str


def _adds(wire: Wire) -> bool:
    """Whether an input adds the contacts of several senders."""
    return wire.port.many and issubclass(wire.port.type, Contact)


def _organ(paths: ContactPaths, contact: str) -> Iterator[Organ]:
    for approach in paths.incoming.get(contact, ()):
        if issubclass(approach.port.type, Proximity):
            collision = approach.producer
            poses = [w.producer for w in paths.incoming.get(collision, ()) if issubclass(w.port.type, Pose)]
            if poses:
                yield Organ(poses[0], collision, next(iter(paths.bodies(contact)), collision))


def _pair(one: Organ, other: Organ, nodes: dict[str, NodeSpec]) -> Iterator[Overlap]:
    """The overlap of two organs, if there is one."""
    given = [_settings(nodes[organ.collision].settings) for organ in (one, other)]
    if None in given:
        return
    found = _find(*given)
    if found is None:
        return
    depth, (x, y, z), same = found
    cure = f"Move one of them: `position` of {one.collision} or of {other.collision} in the scene."
    if same:
        text = f"{one.body} and {other.body} lie at the same place: the finger would feel the sum of their forces"
        yield Overlap(True, text, f"{cure} Or remove one.", other)
    else:
        text = (
            f"{one.body} and {other.body} overlap by {1e3 * depth:.2g} mm at ({x:.4g}, {y:.4g}, {z:.4g}) m. The finger "
            f"feels both there, and the force, their sum, is too large. {cure}"
        )
        yield Overlap(False, text, "", other)


def _settings(given: dict[str, Any]) -> SurfaceAt | None:
    """The surface of a collision, as arguments of `surface_mesh`; None: it has none, or one with a fault."""
    from palpate.nodes.base.surface import content_of  # numba and scipy, which few graphs need

    names = "surface", "position", "rotation"
    if any(given.get(name) is None for name in names):
        return None
    more = given.get("file_unit", "m"), given.get("piece", 0), given.get("refine", 0.0), content_of(given["surface"])
    return given["surface"], given.get("vertices", VERTICES), tuple(given["position"]), tuple(given["rotation"]), *more


@lru_cache(maxsize=64)
def _find(one: SurfaceAt, other: SurfaceAt) -> tuple[float, tuple[float, float, float], bool] | None:
    """The thickness [m] of the overlap of two surfaces, its place [m], and whether they coincide; None: they do not
    overlap, or one of them cannot be read."""
    from palpate.nodes.base.surface import rotation_matrix
    from palpate.physics.geometry.overlap import Solid, coincide, overlap

    try:
        solids = [
            Solid(_shape(name, count, *more), rotation_matrix(turn), np.asarray(place))
            for name, count, place, turn, *more in (one, other)
        ]
        same = coincide(*solids)
        depth, (x, y, z) = overlap(*solids)
    except (PalpateError, ValueError):
        return None
    return (depth, (float(x), float(y), float(z)), same) if depth > TOUCHES or same else None


@lru_cache(maxsize=8)
def _shape(surface: str, vertices: int, file_unit: str, piece: int, refine: float, content: bytes) -> Any:
    """A surface in its frame, whose tables are kept: the places of lanes differ, their surfaces rarely.

    content  digest of its file
    """
    from palpate.nodes.base.surface import surface_mesh
    from palpate.physics.geometry.overlap import Shape

    return Shape(surface_mesh(surface, vertices, file_unit=file_unit, piece=piece, refine=refine))
