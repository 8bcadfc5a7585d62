"""Error of a sampled body on touches that were not used for its basis."""

import numpy as np

from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.reduce.snapshots import PressSolution
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody, answer, bear, sampled_body

YOUNG = 1e4  # [Pa] Modulus that the body is pressed with; its error does not depend on it
RADIUS = 1e-2  # [m] Of the patch of an unloaded body, which is not asked for
CALLS = 6  # Steps in which a held load is settled


def settled(
    body: SampledBody, own: PressSolution, nodes: np.ndarray, force: float
) -> tuple[float, float, float, float]:
    """K, n, s_free and indentation [m], see `sampled_body.answer`, of a body without memory under a held force [N];
    nodes (k,) are those that the touch loads."""
    push, foot, normal = own.touch.load[nodes], tuple(own.touch.foot), tuple(own.touch.normal)
    laws = np.zeros((1, 5))
    for _ in range(CALLS):
        bear(body, 0, nodes, force * push, foot, normal)
        _, settled = answer(body, laws, np.eye(1), 1e6)
        if settled:
            break
    k, n, _, free, now = laws[0].tolist()
    return k, n, free, now


def errors(body: Reducible, basis: SampledBasis, pressed: list[PressSolution]) -> tuple[np.ndarray, np.ndarray]:
    """Relative errors (S,) of the indentation at every load of these touches: of the sampled body, and of the linear
    one, whose compliance it has at rest."""
    sampled, linear = [], []
    for own in pressed:
        it = sampled_body(basis, body.surface, YOUNG, 0.0, RADIUS, RADIUS)
        nodes = np.flatnonzero(np.abs(own.touch.load).max(axis=1) > 0.0).astype(np.int32)
        along = own.touch.normal * (own.touch.load @ own.touch.normal)[:, None]
        measure, unit = along.ravel(), own.touch.load.ravel()
        answer = measure @ (basis.residual_compliance @ unit) + (measure @ basis.modes) @ (basis.modes.T @ unit)
        for level, u in zip(own.touch.levels, own.solutions, strict=False):
            deep = float(np.sum((body.hats @ along) * u))
            sampled.append(settled(it, own, nodes, float(level) * YOUNG)[3] / deep - 1.0)
            linear.append(float(level) * answer / deep - 1.0)
    return np.array(sampled), np.array(linear)
