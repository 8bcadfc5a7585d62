"""Bodies with gaps, grooves and fissures narrower than the finger, and bodies of the zoo cut by planes.

The name of a cut body says how it is cut: `box@0.2@7` is the box without a slab 0.2 mm thick, in the plane number 7.
Its other points are those of the whole body, which is the reference.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from palpate.physics.geometry.felt.solid import mesh_of_solid, solid_of
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.organs.shapes import boxes, star, together

MM = 1e-3
GAPS = (0.05, 0.2, 0.5, 2.0)  # [mm]
GROOVES = (1.0, 2.0, 4.0, 8.0, 16.0)  # [mm]
LONG, WIDE, HIGH, DEEP = 40 * MM, 60 * MM, 24 * MM, 10 * MM  # [m] of a block, and the depth of a groove
SLOT, COMB = 1.5 * MM, tuple(y * MM for y in (-16.0, -8.0, 0.0, 8.0, 16.0))  # [m] width and starts of the slots
FISSURE = 3 * MM  # [m] wide at the surface
LOBED = 45 * MM, 35 * MM, 25 * MM  # [m] half axes of an ellipsoid like a liver
APART = "@"
OF_BLOCK = {"block", "comb", *(f"cut-{gap:g}" for gap in GAPS), *(f"groove-{width:g}" for width in GROOVES)}
POINTS = 2001  # across a patch
THINNER = 0.75  # [1] of the layers of BeamBundle on the block, 30 mm in the scene
LAYERS = {"layers": (3 * MM, 27 * MM), "moduli": (257.6e3, 64.4e3)}  # [m], [Pa] of the scene


def block(count: int) -> Mesh:
    """The block without a gap."""
    x, y, z = ((-0.5 * a, 0.5 * a) for a in (LONG, WIDE, HIGH))
    return boxes(x, y, z, np.ones((1, 1, 1), bool), count)


def slotted(width: float, starts: tuple[float, ...], deep: float, count: int) -> Mesh:
    """The block with slots along x of a width and depth [m], which start at these y [m]."""
    lines = [-0.5 * WIDE, *sorted(y + d for y in starts for d in (0.0, width)), 0.5 * WIDE]
    full = np.ones((1, len(lines) - 1, 2), bool)
    full[0, 1::2, 1] = False
    levels = (-0.5 * HIGH, 0.5 * HIGH - deep, 0.5 * HIGH)
    return boxes((-0.5 * LONG, 0.5 * LONG), lines, levels, full, count)


def cut_block(width: float, count: int) -> Mesh:
    """The block in two pieces with a gap [m] between them."""
    lines = (-0.5 * WIDE, -0.5 * width, 0.5 * width, 0.5 * WIDE)
    full = np.array([[[True], [False], [True]]])
    return boxes((-0.5 * LONG, 0.5 * LONG), lines, (-0.5 * HIGH, 0.5 * HIGH), full, count)


def cut_mesh(mesh: Mesh, gap: float, number: int) -> Mesh:
    """A closed mesh without a slab of the thickness `gap` [m] in a random plane through its inner half.

    MeshError: the mesh does not enclose a solid. ImportError: a package is missing.
    """
    solid = solid_of(mesh.vertices, mesh.triangles)
    normal, offset = plane_of(mesh, number)
    return together(
        *(mesh_of_solid(solid.trim_by_plane(tuple(s * normal), s * offset + 0.5 * gap)) for s in (1.0, -1.0))
    )


def plane_of(mesh: Mesh, number: int) -> tuple[np.ndarray, float]:
    """The normal [1] (3) and the distance from the origin [m] of the plane with a number, in the frame of the mesh."""
    rng = np.random.default_rng(number)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    along = mesh.vertices @ normal
    low, high = along.min(), along.max()
    return normal, float(low + (high - low) * rng.uniform(0.3, 0.7))


def name_of_cut(name: str, gap: float, number: int) -> str:
    """The name of a body with a gap [mm]."""
    return f"{name}{APART}{gap:g}{APART}{number}"


def read_cut(name: str) -> tuple[str, float, int] | None:
    """Body, gap [mm] and plane of a name; None: it is not that of a cut body."""
    parts = name.split(APART)
    return (parts[0], float(parts[1]), int(parts[2])) if len(parts) == 3 else None


def _two_balls(apart: float, count: int) -> tuple[Mesh, Mesh]:
    ball = star(lambda unit: np.full(len(unit), 20 * MM), count // 2)
    return ball, Mesh(ball.vertices + (apart, 0.0, 0.0), ball.triangles)


def _overlapping(count: int) -> Mesh:
    return together(*_two_balls(18 * MM, count))


def _joined(count: int) -> Mesh:
    """The surface of both balls that overlap."""
    low, high = (solid_of(ball.vertices, ball.triangles) for ball in _two_balls(18 * MM, count))
    return mesh_of_solid(low + high)


def _near(count: int) -> Mesh:
    return together(*_two_balls(40.2 * MM, count))


def _unfissured(count: int) -> Mesh:
    body = star(lambda unit: np.ones(len(unit)), count)
    return Mesh(body.vertices * LOBED, body.triangles)


def _fissured(count: int) -> Mesh:
    """A liver's lobes: an ellipsoid with a wedge-like fissure, 3 mm wide at the surface and 15 mm deep."""
    from manifold3d import Manifold  # its package is an extra

    body = _unfissured(count)
    solid = solid_of(body.vertices, body.triangles)
    corners = [(a * 60 * MM, b * 0.5 * FISSURE * 22 / 17, 30 * MM) for a in (-1, 1) for b in (-1, 1)]
    corners += [(a * 60 * MM, 0.0, 8 * MM) for a in (-1, 1)]
    return mesh_of_solid(solid - Manifold.hull_points(np.array(corners)))


def makers() -> dict[str, tuple[Callable[[int], Mesh], str]]:
    """How to make each body with a gap, and what it is, by name."""
    found: dict[str, tuple[Callable[[int], Mesh], str]] = {"block": (block, "40 x 60 x 24 mm")}
    for gap in GAPS:
        found[f"cut-{gap:g}"] = partial(cut_block, gap * MM), f"the block in two pieces, {gap:g} mm apart"
    for width in GROOVES:
        start = (-0.5 * width * MM,)
        found[f"groove-{width:g}"] = partial(slotted, width * MM, start, DEEP), f"a groove {width:g} mm wide"
    found["comb"] = partial(slotted, SLOT, COMB, DEEP), "five slots, 1.5 mm wide"
    found["fissure"] = _fissured, "an ellipsoid with a fissure, 3 mm wide"
    found["unfissured"] = _unfissured, "the ellipsoid without the fissure"
    found["near"] = _near, "two balls, 0.2 mm apart"
    found["overlap"] = _overlapping, "two balls that overlap"
    found["union"] = _joined, "the surface of both"
    return found


def layers_of(body: str, surface: str) -> tuple[str, ...]:
    """The values of `--set` with which a body fits into a surface: the layers of BeamBundle are thinner and softer by
    the same factor on the block and its parts, which keeps their compliance."""
    if body != "BeamBundle" or surface not in OF_BLOCK:
        return ()
    return tuple(f"tissue.{name}={[THINNER * value for value in values]}" for name, values in LAYERS.items())


def slots_of(surface: str) -> tuple[tuple[float, ...], float]:
    """Middles across the gaps of a body [m] in any frame, and their width [m]; 0: it has none."""
    if (cut := read_cut(surface)) is not None:
        return (0.0,), cut[1] * MM
    if surface == "comb":
        return tuple(y + 0.5 * SLOT for y in COMB), SLOT
    kind, _, width = surface.partition("-")
    gap = float(width) * MM if kind in ("cut", "groove") and width else FISSURE if surface == "fissure" else 0.0
    return (0.0,), gap


def stiffness_left(middles: tuple[float, ...], width: float, radius: float) -> float:
    """Least stiffness over that without slots [1], of a patch of this radius [m] on independent beams, at any distance
    from slots of a width [m] with these middles [m]; 0: it is over nothing else.

    A patch with the weights w(x,y) = (1 - (x² + y²)/R²)² shares a force over the beams that it can touch in proportion
    to w, and its indentation is the mean of theirs with the weights w. So the stiffness is proportional to

        (integral of w)²/(integral of w²),

    without what lies over a slot. Across a slot along x, the integrals of w and w² over x are (1 - y²/R²)^{5/2} and
    (1 - y²/R²)^{9/2}. Linear beams have this stiffness, stiffening ones more. A block in full FE, whose parts are not
    independent, keeps 0.72, 0.68, 0.61 and 0.44 over grooves 1, 2, 4 and 8 mm wide, with R = 8 mm.
    """
    y = np.linspace(-1.0, 1.0, POINTS)
    far = max(map(abs, middles)) + radius + width
    at = np.arange(-far, far, 0.02 * radius)
    ends = [(middle - at + sense * width) / radius for middle in middles for sense in (-0.5, 0.5)]
    left = []
    for power in (2.5, 4.5):
        part = np.cumsum((1.0 - y * y) ** power)
        over = [np.interp(end, y, part / part[-1]) for end in ends]
        left.append(1.0 - sum(over[1::2]) + sum(over[::2]))
    return float(np.min(left[0] ** 2 / np.maximum(left[1], 1e-12)))


def force_left(body: str, surface: str, radius: float) -> float:
    """Least part [1] of a force that a body keeps over its gaps, under a patch of this radius [m]: the stiffness that
    beams lose with those that are missing; other bodies do not feel a gap that the finger does not."""
    return stiffness_left(*slots_of(surface), radius) if body == "BeamBundle" else 1.0
