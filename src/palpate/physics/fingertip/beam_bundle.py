"""The beam bundle: a fingertip as parallel viscoelastic beams between nail and skin, pressed on a plate and slid.

The beams are parallel to the plate's normal on a square grid, one per cell. At the depth d of the fingertip, beam i is
shortened by d - z_i, with the height z_i of its skin end at first touch. Normal force: the stress of the beam's Voigt
chain (`voigt`) times the cell area. Lateral force: an elastic spring per beam, in shear because beams confine one
another (1/k = sum L_j / (G_j A)), or that of a free cantilever (3 E I / L^3). The sheet (`skin`) couples the skin ends
to each other, friction (`stick_slip`) to the plate. Published and assumed parameters: docs/equations/beam-bundle.md.
"""

import math
from typing import NamedTuple

import numpy as np

from palpate.physics.fingertip.bundle_step import BundleMotion, BundleWorkspace, Nodes, StepSummary, bundle_step
from palpate.physics.fingertip.skin import Sheet, grid_triangles, sheet
from palpate.physics.fingertip.stick_slip import workspace
from palpate.physics.materials.voigt import SKIN, STRAIN_LIMIT, TISSUE, ViscoelasticMaterial

LATERAL = ("shear", "cantilever")
MOST_BEAMS = 20_000
SHORTEST_STEP = 1e-5  # [s] Lower limit of a step: the force of a damper is unbounded as the step approaches 0
FARTHEST = 1.0  # [m] Upper limit of a shift: all nodes slip long before, and larger numbers only lose precision
FADE = 0.03
"""[1] Static strain of the softest element at whose pressure a node acts fully on the sheet. Below it the weight of the
node falls with the cube of the pressure: a linear fade would act as a switch, as the sheet is 40 times stiffer than a
beam."""


class Bundle(NamedTuple):
    """Beams on a square grid: all that are in contact at the largest depth."""

    points: np.ndarray  # [m] (N,2) skin ends in the plate's plane
    heights: np.ndarray  # [m] (N) of the skin ends over the plate at first touch; the smallest is 0
    lengths: np.ndarray  # [m] (N,h) of the elements, from the skin inwards; 0 where a beam lacks one
    length: np.ndarray  # [m] (N) of each beam
    shares: np.ndarray  # [1] (N,h) of its elements in it
    reach: np.ndarray  # [m] (N) largest shortening of each beam, at which its softest element is at the strain limit
    moduli: np.ndarray  # [Pa] (h)
    viscosities: np.ndarray  # [Pa s] (h)
    lateral: np.ndarray  # [N/m] (N) lateral stiffness of each beam
    cell: float  # [m²] () area of a beam's grid cell
    fade: float  # [Pa] () pressure from which a node acts fully on the sheet
    sheet: Sheet  # the skin's triangles; none act where its thickness is 0
    retardation: float  # [s] () viscosity / modulus of the sheet


def bundle(
    index: np.ndarray,
    pitch: float,
    heights: np.ndarray,
    lengths: np.ndarray,
    materials: tuple[ViscoelasticMaterial, ...] = (TISSUE,),
    lateral: str = "shear",
    lateral_elements: int | None = None,
    skin: float = 0.0,
    skin_material: ViscoelasticMaterial = SKIN,
) -> Bundle:
    """The bundle of beams at grid coordinates `index` (N,2) int with a pitch [m].

    heights           [m]  (N)    of the skin ends; any origin
    lengths           [m]  (N,h)  of the elements, from the skin inwards, one column per material, 0 where absent
    lateral           "shear" or "cantilever"
    lateral_elements  number of columns, from the skin inwards, that are soft in shear, up to the bone; None: all
    skin              [m]  thickness of the sheet; 0: none

    ValueError: no beams, a beam without length, an unknown lateral law.
    """
    index = np.asarray(index, dtype=np.int64).reshape(-1, 2)
    heights, lengths = np.asarray(heights, float), np.asarray(lengths, float)
    if lateral not in LATERAL:
        raise ValueError(f"lateral: found {lateral!r}, expected one of {', '.join(LATERAL)}")
    if len(index) == 0:
        raise ValueError("bundle: found no beams; increase the depth or decrease the pitch")
    if lengths.shape != (len(index), len(materials)):
        raise ValueError(
            f"lengths: found shape {lengths.shape}, expected {(len(index), len(materials))}: beams, materials"
        )
    # order along the longer side of the grid, which gives the solver a narrow band
    long, short = (0, 1) if np.ptp(index[:, 0]) >= np.ptp(index[:, 1]) else (1, 0)
    order = np.lexsort((index[:, short], index[:, long]))
    index, heights, lengths = index[order], heights[order] - heights.min(), lengths[order]
    cell = pitch * pitch
    bends = lengths[:, :lateral_elements]
    if np.any(lengths < 0) or np.any(bends.sum(axis=1) <= 0) or not np.all(np.isfinite(lengths)):
        bad = int(np.argmin(np.nan_to_num(bends).sum(axis=1)))
        raise ValueError(f"beam {bad}: lengths {lengths[bad]} m, expected >= 0 and a soft part")
    # lateral stiffness: springs in series, k = A / sum(L/G); or a cantilever, 3 E I / L^3
    shear = np.array([m.shear_modulus for m in materials])[: bends.shape[1]]
    moduli = np.array([m.modulus for m in materials])
    if lateral == "shear":
        stiffness = cell / (bends / shear).sum(axis=1)
    else:
        length = bends.sum(axis=1)
        mean = length / (bends / moduli[: bends.shape[1]]).sum(axis=1)
        stiffness = 3 * mean * (math.pi * (pitch * pitch) * (pitch * pitch) / 64) / (length * length * length)
    # the sheet on the skin ends
    points, length = index * pitch, lengths.sum(axis=1)
    softest = np.where(lengths > 0, moduli, np.inf).min(axis=1, keepdims=True)
    triangles = grid_triangles(index) if skin > 0 else np.zeros((0, 3), dtype=np.int64)
    return Bundle(
        points=points,
        heights=heights,
        lengths=lengths,
        length=length,
        shares=lengths / length[:, None],
        reach=STRAIN_LIMIT * (lengths * softest / moduli).sum(axis=1),
        moduli=moduli,
        viscosities=np.array([m.viscosity for m in materials]),
        lateral=stiffness,
        cell=cell,
        fade=FADE * float(np.min(moduli)),
        sheet=sheet(points, triangles, skin_material.modulus, skin_material.poisson, skin),
        retardation=skin_material.relaxation,
    )


def check_count(expected: float) -> None:
    """ValueError: more beams than a bundle may have."""
    if not expected <= MOST_BEAMS:
        raise ValueError(
            f"about {expected:.3g} beams, expected at most {MOST_BEAMS}; increase the pitch or decrease the depth"
        )


class BundleState:
    """State of a bundle and results of the last step; initially at rest, out of contact.

    strains    [1]  (N,h)  of the elements
    reach      [m]  (N)    largest shortening of each beam
    deflection [m]  (N,2)  of the skin ends relative to the bone, in the plate's plane
    normal     [N]  (N)    normal force of the plate on each node
    tangent    [N]  (N,2)  friction of the plate on each node
    slip       [m]  (N,2)  over the plate in the last step
    path       [m]  (N)    length of the slip since first touch: the localized displacement
    slipping   [1]  (N)    bool, slides over the plate in the last step
    first      [s]  (N)    time of first slip since first touch; -1 if it has not slipped
    force      [N]  (3)    of the plate on all nodes
    summary                of the last step
    """

    def __init__(self, body: Bundle) -> None:
        count, h = body.lengths.shape
        self.nodes = Nodes(
            np.zeros((count, h)), np.zeros((count, 2)), np.zeros(count), np.zeros((count, 2)), np.zeros((count, 2)),
            np.zeros(count), np.zeros(count, dtype=np.bool_), np.full(count, -1.0), np.zeros(3),
        )  # fmt: skip
        (self.strains, self.deflection, self.normal, self.tangent, self.slip, self.path, self.slipping, self.first,
         self.force) = self.nodes  # fmt: skip
        self.reach = body.reach
        self.summary = StepSummary()
        self.time = 0.0
        self.scratch = BundleWorkspace(
            np.zeros((len(body.sheet.columns), 2, 2)), np.zeros((count, 2)), np.zeros((count, 2)), np.zeros(count),
            np.zeros(count), workspace(count, body.sheet.band),
        )  # fmt: skip


def step(
    body: Bundle,
    state: BundleState,
    depth: float,
    shift: tuple[float, float],
    friction: float,
    dt: float,
    tolerance: float = 1e-6,
    most: int = 50,
) -> np.ndarray:
    """Move the fingertip to a depth [m] and by a shift [m] along the plate in dt [s]; force of the plate on it [N] (3).

    Updates the state. The normal force never pulls; the tangential force never exceeds friction times the normal force.
    A beam is shortened by at most its reach; these beams are counted (`limited`). For dt <= 0 nothing changes. The
    summary has the number of iterations, at most `most`, and the residual.
    """
    far = math.hypot(*shift)
    if far > FARTHEST:
        shift = (shift[0] * (FARTHEST / far), shift[1] * (FARTHEST / far))
    if dt > 0:
        length = max(float(dt), SHORTEST_STEP)
        state.time += length
        motion = BundleMotion(
            float(depth), float(shift[0]), float(shift[1]), float(friction), length, state.time, state.summary.last_step
        )
        state.summary = bundle_step(body, state.nodes, state.scratch, motion, tolerance, most)
    return state.force.copy()
