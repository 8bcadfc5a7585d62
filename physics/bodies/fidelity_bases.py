"""Bodies of fewer modes, cut from a sampled basis, and how far each can be off.

The modes of a basis come by what they are worth, and are orthonormal in the stiffness at rest. So the first r of them
are a body of r modes, with the same sampled points; what the others did at rest goes to what is missed,

    R_r = R + D D',    D the surface's displacement in the modes that are dropped

so that a light touch is answered exactly by each. Under load R_r gives way as gamma of that level says, fitted anew.

The error of a level against the whole basis is estimated of a state by two numbers: how far it is from linear, and how
much of the load goes into modes that were dropped:

    estimate = kappa_r(nu) sqrt(|p_D|²/|p|²),    nu = s_linear/s - 1

p = Phi'h/E over all modes, whose squares are twice the energies at rest; s the indentation, s_linear that of the linear
body. kappa_r holds above all errors seen at states of about that nu (`palpate reduce --levels`). It is fitted,
not a bound that could be proven. At rest (nu = 0) all levels are the same.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays, replacing
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.exact import log, product

FIELDS = ("modes", "bends", "knots", "kappa")


def cut(basis: SampledBasis, count: int, bend: tuple[float, float, float]) -> SampledBasis:
    """The basis of the first `count` modes, with gamma of the parameters `bend` (scale, power, most; see
    `sampled_body.gamma`); the basis itself where these are all."""
    if count >= basis.modes.shape[1]:
        return basis
    dropped, points = basis.modes[:, count:], basis.points
    fewer = points._replace(
        modes=np.ascontiguousarray(points.modes[:, :count]),
        springs=np.ascontiguousarray(points.springs[:count, :count]),
    )
    missed = (basis.residual_compliance + product(dropped, dropped.T)).astype(np.float32)
    modes = np.ascontiguousarray(basis.modes[:, :count])
    return SampledBasis(basis.vertices, basis.triangles, missed, modes, fewer, bend)


@dataclass(frozen=True)
class FidelityBases:
    """What the levels of a basis are, the cheapest first; the whole basis, which comes last, is not among them.

    modes   [1] (k,)    of each
    bends   [1] (k,3)   of its gamma, see `SampledBasis`
    knots   [1] (n,)    ln nu, rising, at which kappa is known; between them ln kappa is linear, above them it is
                        constant, and below them estimates are in proportion to nu
    kappa   [1] (k,n)
    """

    modes: np.ndarray
    bends: np.ndarray
    knots: np.ndarray
    kappa: np.ndarray

    @cached_property
    def _logs(self) -> np.ndarray:
        """ln kappa, which is asked for in every step."""
        return log(self.kappa)

    def cut(self, basis: SampledBasis) -> list[SampledBasis]:
        """The basis of each level, and the whole one."""
        fewer = [cut(basis, int(r), tuple(b)) for r, b in zip(self.modes, self.bends.tolist(), strict=True)]
        return [*fewer, basis]

    def estimated_errors(self, p: np.ndarray, linear: float, now: float) -> np.ndarray:
        """Estimated relative error (k + 1,) of the indentation by each level and by the whole basis, of which it is 0.

        p       [m]  (r,) the load in all modes, Phi'h/E
        linear  [m]  indentation of the linear body;  now [m] that of a level, > 0
        """
        energy = np.cumsum((p * p)[::-1])[::-1]
        estimates = np.zeros(len(self.modes) + 1)
        if not energy[0] > 0.0:
            return estimates
        nu = abs(linear / now - 1.0)
        at = math.log(max(nu, 1e-300))
        for k, r in enumerate(self.modes):
            kappa = math.exp(np.interp(at, self.knots, self._logs[k]))
            estimates[k] = kappa * min(nu / math.exp(self.knots[0]), 1.0) * np.sqrt(energy[r] / energy[0])
        return estimates

    def save(self, path: Path, about: dict[str, Any]) -> None:
        """Write them, and what they were made from."""
        own = {name: getattr(self, name) for name in FIELDS}
        with replacing(path) as part, part.open("wb") as file:
            np.savez_compressed(file, **own, about=np.array(json.dumps(about)))

    @classmethod
    def load(cls, path: Path) -> tuple[FidelityBases, dict[str, Any]]:
        """Read them, and what they say they were made from.

        ArchiveError: not such a file, or a damaged one.
        """
        try:
            archive = read_arrays(path)
            about = json.loads(str(archive["about"]))
            levels = cls(*(archive[name] for name in FIELDS))
            k, n = len(levels.modes), len(levels.knots)
            if levels.bends.shape != (k, 3) or levels.kappa.shape != (k, n) or not isinstance(about, dict):
                raise ValueError(f"bends {levels.bends.shape}, kappa {levels.kappa.shape} of {k} levels and {n} knots")
        except (KeyError, ValueError, TypeError, RecursionError) as error:
            raise ArchiveError(f"{path}: not the fidelity levels of a sampled basis: {error}") from None
        return levels, about
