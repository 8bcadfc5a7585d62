"""The block of `studies.peers.continuum` as a MuJoCo flex: linear tetrahedra, stepped to rest.

Each node is a body with one sliding joint per free direction; joint springs on the underside are the elastic
foundation. MuJoCo has no static solver, so the load stays on until the indentation is at rest. The integrator
`discrete` treats the elasticity implicitly. Mass and damping are chosen to need few steps; they do not change the rest
state.

MuJoCo: E. Todorov et al., IEEE/RSJ IROS (2012) 5026-5033; https://mujoco.readthedocs.io, `deformable/flex`.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from palpate.models.fe.element.mesh import edge_nodes, six_volumes
from palpate.models.fe.meshing.organ import SLAB
from palpate.physics.extras import install, require_extra
from palpate.studies.peers import MissingError, continuum
from palpate.studies.peers.continuum import BED, LEVELS, POISSON, YOUNG, ContinuumCurve, Tetrahedra, TissueBlock

INSTALL = install("bench")
MATERIALS = {"Saint Venant-Kirchhoff": 0, "neo-Hookean": 1}
"""Values of `elastic3d` of a flex. The first is the default of MuJoCo; MuJoCo calls the second experimental."""
STEP, DAMPING, DENSITY = 0.01, 0.01, 1000.0  # [s], [s] Rayleigh's, [kg/m³]
REST, STILL = 1e-5, 3
"""At rest, the indentation changes by less than the share `REST` [1] in each of `STILL` successive steps."""
LONGEST = 1000  # Maximum number of steps to come to rest


def version() -> str | None:
    """Version of MuJoCo; None if it is not installed or too old."""
    try:
        import mujoco
    except ImportError:
        return None
    return str(mujoco.__version__) if hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE") else None


def library() -> Any:
    """The module `mujoco`. MissingError: it is not installed or too old."""
    with require_extra("MuJoCo 4", "bench", MissingError):
        import mujoco
    if version() is None:
        raise MissingError(f"MuJoCo: found {mujoco.__version__}, expected 4 or newer; {INSTALL}")
    return mujoco


def press_block(block: TissueBlock, levels: np.ndarray = LEVELS, material: str = "neo-Hookean") -> ContinuumCurve:
    """Press the block with MuJoCo.

    MissingError: MuJoCo is not installed. ArithmeticError: it does not come to rest, or elements are inverted.
    """
    mujoco, cut = library(), continuum.tetrahedra(block)
    corners = cut.mesh.elements[:, :4]
    count = int(corners.max()) + 1
    points, edges = cut.mesh.points[:count], edge_nodes(count, corners)[1]
    unit = _on_corners(cut.unit, edges)
    with _quiet(mujoco):
        model, joint = _model(mujoco, cut, points, corners, MATERIALS[material])
        data = mujoco.MjData(model)
        free = joint >= 0
        pull = np.zeros(model.nv)
        pull[joint[free]] = unit[free]

        def reach(level: float) -> np.ndarray:
            data.qfrc_applied[:] = 0.5 * level * pull
            _rest(partial(mujoco.mj_step, model, data), lambda: float(pull @ data.qpos), level)
            moved = np.zeros(points.shape)
            moved[free] = data.qpos[joint[free]]
            _upright(points + moved, corners, level, material)
            return moved

        return continuum.press_mesh(reach, levels, unit, (cut.x[::2], cut.y[::2], cut.top[::2, ::2]))


def _rest(step: Callable[[], None], depth: Callable[[], float], level: float) -> None:
    """Step until the indentation [m] is at rest. ArithmeticError: it moves after `LONGEST` steps."""
    still, last = 0, depth()
    for _ in range(LONGEST):
        step()
        now = depth()
        still = still + 1 if abs(now - last) < REST * abs(now) else 0
        if still == STILL:
            return
        last = now
    raise ArithmeticError(f"MuJoCo did not come to rest at {level:g} N within {LONGEST} steps of {STEP:g} s")


def _upright(points: np.ndarray, corners: np.ndarray, level: float, material: str) -> None:
    """Check the volumes of all elements. ArithmeticError: elements are inverted."""
    turned = int((six_volumes(points, corners) <= 0.0).sum())
    if turned or not np.isfinite(points).all():
        raise ArithmeticError(f"at {level:g} N {turned} of {len(corners)} {material} elements of MuJoCo are inside out")


def _on_corners(quadratic: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Nodal forces of linear elements from those of quadratic ones. A linear shape function is that of its corner plus
    half of those of the mid-side nodes next to it; `edges` (M,2) has the corners of each mid-side node."""
    count = len(quadratic) - len(edges)
    linear = quadratic[:count].copy()
    for end in (0, 1):
        np.add.at(linear, edges[:, end], 0.5 * quadratic[count:])
    return linear


def _model(
    mujoco: Any, cut: Tetrahedra, points: np.ndarray, corners: np.ndarray, elastic: int
) -> tuple[Any, np.ndarray]:
    """The model, and the joint (N,3) that moves each node in each direction; -1: fixed."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = STEP, (0.0, 0.0, 0.0)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    spec.option.solver = mujoco.mjtSolver.mjSOL_CG
    bed = np.zeros(len(points))
    np.add.at(bed, cut.under[:, :3], BED * YOUNG * cut.areas()[:, None] / 3.0)
    mass = DENSITY * SLAB * float(np.prod(np.ptp(points[:, :2], axis=0))) / len(points)
    joint = np.full(points.shape, -1)
    joint[~cut.fixed[: len(points)]] = np.arange(int((~cut.fixed[: len(points)]).sum()))
    for k, at in enumerate(points):
        body = spec.worldbody.add_body(name=f"n{k}", pos=at)
        body.mass, body.inertia, body.explicitinertial = mass, [1e-6 * mass] * 3, True
        for axis in np.flatnonzero(joint[k] >= 0):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=np.eye(3)[axis], stiffness=bed[k])
    for region, ratio in enumerate(cut.ratios):
        elements = corners[cut.mesh.region == region]
        used, numbers = np.unique(elements, return_inverse=True)
        flex = spec.add_flex(name=f"r{region}", dim=3, contype=0, conaffinity=0)
        flex.vertbody, flex.elem = [f"n{k}" for k in used], numbers.ravel().astype(int)
        flex.vert = np.zeros(3 * len(used))
        flex.young, flex.poisson, flex.damping, flex.elastic3d = YOUNG * float(ratio), POISSON, DAMPING, elastic
    return spec.compile(), joint


@contextmanager
def _quiet(mujoco: Any) -> Iterator[None]:
    """Suppress warnings of MuJoCo, which it writes to a file in the working folder; `_rest` checks the state itself."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)
