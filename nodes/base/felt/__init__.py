"""The width of the finger, and the surface that a finger of this width can touch, for collision and spread."""

from functools import lru_cache
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from palpate.messages import Contact, Proximity
from palpate.nodes.base.effect import Agrees
from palpate.nodes.base.felt.organs import Part, shared_part
from palpate.nodes.base.node import Node, SettingError
from palpate.nodes.base.stored.surfaces import arrays_of_felt, felt_of_arrays, makers, stored
from palpate.nodes.base.surface import (
    LEVEL,
    SURFACES,
    OnSurface,
    OnThinnedSurface,
    content_of,
    inputs_of,
    surface_mesh,
)
from palpate.physics.errors import MeshError
from palpate.physics.extras import missing
from palpate.physics.geometry.felt.bearing import Bearing, bearing_part
from palpate.physics.geometry.felt.bridge import Felt, close_surface
from palpate.units.header import factor

SAMPLES = 3000  # vertices of a NURBS surface that are tested
WIDTH = 16e-3  # [m] twice the radius of the patch of spread.Kernel
NO_AREA = 1e-8  # [m²] of bridges below which none is noted: inner walls of pieces that overlap are under none


class WithWidth(Node):
    """Setting of the width of the finger, for collision and spread; a body whose vertices have areas takes that of the
    widest finger on it."""

    width: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.1), Agrees(Proximity, Contact, twice="radius")] = WIDTH
    """Diameter of the ball for which gaps, grooves and fissures of a mesh are bridged: twice the radius of the patch
    where that is set. 0: a needle or stylus, which enters all of them."""
    organs: Annotated[str, "1"] = ""
    """Surfaces of all organs that this finger touches, as JSON: determined when the graph is loaded."""


class Bridged(NamedTuple):
    """The felt surface of a mesh, None: the mesh itself; and why it could not be made, "" if it could."""

    felt: Felt | None
    fault: str


def felt_surface(node: OnSurface, width: float) -> Bridged:
    """The felt surface in the frame of the surface, the same object for all nodes of a process with these settings.

    SettingError: the finger fits nowhere."""
    name, vertices, _, _, *more = node._surface
    return _felt_surface(name, vertices, *more, content_of(name), width)


def is_bridged(surface: str, width: float) -> bool:
    """Whether a finger of this width [m] cannot touch all of a built-in surface, or this is not known.

    SettingError: the finger fits nowhere."""
    felt, fault = _felt_surface(surface, SAMPLES, "m", 0, 0.0, b"", width)
    return felt is not None or fault != ""


def has_gaps(node: OnSurface, width: float) -> bool:
    """Whether the surface of a node has parts that a finger of this width [m] does not touch."""
    try:
        return felt_surface(node, width).felt is not None
    except SettingError:  # nor does it fit
        return True


@lru_cache(maxsize=4)
def _felt_surface(
    surface: str, vertices: int, file_unit: str, piece: int, refine: float, content: bytes, width: float
) -> Bridged:
    if width == 0.0 or (surface in SURFACES and width <= WIDTH):  # which a finger of this width touches everywhere
        return Bridged(None, "")
    mesh = surface_mesh(surface, vertices, LEVEL, LEVEL, file_unit, piece, refine)

    def arrays() -> dict[str, np.ndarray]:
        given = surface_mesh(surface, vertices, LEVEL, LEVEL, file_unit, piece) if content else None
        return arrays_of_felt(close_surface(mesh, 0.5 * width, given=given))

    try:
        if content:
            inputs = inputs_of(surface, content, factor(file_unit, "m"), piece, refine)
            inputs |= {"width": width, "made by": makers()}
            felt = felt_of_arrays(
                stored("felt", inputs, arrays, f"{Path(surface).name}, surface that the finger can touch")
            )
        else:
            felt = felt_of_arrays(arrays())
    except MeshError as error:
        return Bridged(None, str(error))
    except ImportError as error:
        return Bridged(None, missing("collision.Mesh", error.name, "mesh"))
    longest = float(np.ptp(mesh.vertices, axis=0).max())
    if felt is not None and width > longest:
        raise SettingError(
            f"setting 'width': found {1e3 * width:.3g} mm, and {surface} is {1e3 * longest:.3g} mm across, so that the "
            "finger bridges all of it. Expected less, or 0 for a needle or stylus"
        )
    return Bridged(felt, "")


def felt_part(node: WithWidth) -> tuple[Part | None, str]:
    """What a node feels of several organs together, and why they are felt one by one, "" if they are far apart.

    SettingError: setting `organs`."""
    return shared_part(node.organs, node.width) if node.organs and node.width > 0.0 else (None, "")


def bearing(node: OnThinnedSurface, width: float) -> Bearing | None:
    """The part of the node's mesh that bears the load of a finger of this width [m]; None: all of it. It is computed
    once for all nodes of a process.

    SettingError: the finger fits nowhere."""
    felt: Felt | Part | None = felt_part(node)[0] if isinstance(node, WithWidth) else None
    if felt is None:
        felt = felt_surface(node, width).felt
    if felt is None:
        return None
    mesh = node.mesh()
    key = bearing_part, felt.touchable.tobytes()  # the whole surface is that of the mesh
    if key not in mesh.kept:
        mesh.kept[key] = bearing_part(mesh, node.whole(), felt.touchable)
    found: Bearing = mesh.kept[key]
    return found


def bridge_notes(surface: str, width: float, bridged: Bridged) -> list[str]:
    """A note on the bridges of a felt surface, if any."""
    felt, fault = bridged
    wide = f"narrower than the finger ({1e3 * width:.3g} mm)"
    if fault:
        return [
            f"{surface}: gaps and grooves {wide} are not bridged, because {fault}. If it has any, the finger is drawn "
            "in there, and the force is too small"
        ]
    if felt is None or felt.area < NO_AREA:
        return []
    at = _in_mm(felt.place)
    return [
        f"{surface}: gaps and grooves {wide} are bridged: {1e4 * felt.area:.2g} cm² over parts up to "
        f"{1e3 * felt.depth:.2g} mm deep, the deepest at ({at}) mm of the surface. With MassSpring the tissue there is "
        "as stiff as without the gap. scene.finger.width=0 is a needle or stylus, which enters them"
    ]


def _in_mm(place: np.ndarray) -> str:
    return ", ".join(f"{round(1e3 * x, 3) + 0.0:.3g}" for x in place)  # no -0, and no 7e-05


def shared_notes(surface: str, width: float, part: Part | None, fault: str) -> list[str]:
    """A note on the bridges between organs, if any."""
    wide = f"narrower than the finger ({1e3 * width:.3g} mm)"
    if fault:
        return [f"{surface}: gaps between it and other organs {wide} are not bridged, because {fault}"]
    if part is None:
        return []
    at = _in_mm(part.place)
    return [
        f"{surface}: it and organs that are nearer than the finger is wide ({1e3 * width:.3g} mm) are felt as one "
        f"surface, with {1e4 * part.area:.2g} cm² of bridges over gaps up to {1e3 * part.depth:.2g} mm deep, the "
        f"deepest at ({at}) mm. Each bears its part of the patch. The bridges stay where they are at rest. "
        "scene.finger.width=0 is a needle or stylus"
    ]
