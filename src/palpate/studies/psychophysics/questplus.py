"""QUEST+: the next level is the one whose answer has the largest expected information on the psychometric function.

For a grid of parameters θ with posterior P(θ), and answers r of probability p_r(x, θ), the expected entropy of the next
posterior is H(θ) - I(x) with the mutual information

    I(x) = Σ_r [ Σ_θ P p_r ln p_r  -  <p_r> ln <p_r> ],   <p_r> = Σ_θ P p_r

(Watson, Journal of Vision 17(3):10, 2017, eqs. 3 to 8). The largest I(x) gives the lowest expected entropy.

An answer that every θ with a posterior excludes is a slip, a finger on the wrong key. It does not change the
posterior.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import xlogy

from palpate.studies.psychophysics.functions import proportion


class QuestPlus:
    """Chooses levels and updates the posterior.

    function                        name in `FUNCTIONS`
    levels                          (n) candidate levels
    thresholds, spreads, lapses     grids of a, b and λ, with a uniform prior
    guess                           γ
    """

    def __init__(
        self,
        function: str,
        levels: Sequence[float],
        thresholds: Sequence[float],
        spreads: Sequence[float],
        lapses: Sequence[float],
        guess: float,
    ) -> None:
        self.levels = np.asarray(levels, float)
        grids = np.meshgrid(thresholds, spreads, lapses, indexing="ij")
        self.grid = np.array([grid.ravel() for grid in grids])
        a, b, lapse = self.grid
        hit = np.stack([proportion(function, x, a, b, guess, lapse) for x in self.levels])
        self._chances = np.stack([hit, 1.0 - hit])
        """Probabilities (2, n, θ) of a hit and of a miss."""
        self._inner = xlogy(self._chances, self._chances).sum(axis=0)
        self.posterior = np.full(len(a), 1.0 / len(a))

    def information(self) -> np.ndarray:
        """Mutual information I(x) [nat] (n) of each level."""
        mean = self._chances @ self.posterior
        return self._inner @ self.posterior - xlogy(mean, mean).sum(axis=0)

    def update(self, level: float, hit: bool) -> None:
        at = int(np.argmin(np.abs(self.levels - level)))
        posterior = self.posterior * self._chances[0 if hit else 1, at]
        total = posterior.sum()
        if total > 0.0:
            self.posterior = posterior / total
