"""Error of a sampled body on touches that were not used for its basis."""

import numpy as np

from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.reduce.snapshots import PressSolution
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, answer, bear, sampled_body

YOUNG = 1e4  # [Pa] Modulus of the body; its error does not depend on it
RADIUS = 1e-2  # [m] Of the patch of an unloaded body, which is not used here
CALLS = 6  # Most calls of the body until it reaches equilibrium under a constant load


def equilibrium(
    body: SampledBody, press: PressSolution, nodes: np.ndarray, force: float
) -> tuple[float, float, float, float]:
    """K, n, s_free and indentation [m] of an elastic body under a constant force [N], see `sampled_body.answer`.

    nodes  (k,) loaded by the touch
    """
    push, foot, normal = press.touch.load[nodes], tuple(press.touch.foot), tuple(press.touch.normal)
    laws = np.zeros((1, 5))
    for _ in range(CALLS):
        bear(body, 0, nodes, force * push, foot, normal)
        _, settled = answer(body, laws, np.eye(1), 1e6)
        if settled:
            break
    k, n, _, free, now = laws[0].tolist()
    return k, n, free, now


def errors(body: Reducible, basis: SampledBasis, pressed: list[PressSolution]) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors (S,) of the indentation at every load of these touches, of the sampled body and of its linear
    compliance at rest."""
    sampled, linear = [], []
    for press in pressed:
        fast, touch = sampled_body(basis, body.surface, YOUNG, 0.0, RADIUS, RADIUS), press.touch
        nodes = np.flatnonzero(np.abs(touch.load).max(axis=1) > 0.0).astype(np.int32)
        along = touch.normal * (touch.load @ touch.normal)[:, None]
        measure, unit = along.ravel(), touch.load.ravel()
        compliance = measure @ (basis.residual_compliance @ unit) + (measure @ basis.modes) @ (basis.modes.T @ unit)
        for level, u in zip(touch.levels, press.solutions, strict=False):
            indentation = float(np.sum((body.hats @ along) * u))
            sampled.append(equilibrium(fast, press, nodes, float(level) * YOUNG)[3] / indentation - 1.0)
            linear.append(float(level) * compliance / indentation - 1.0)
    return np.array(sampled), np.array(linear)
