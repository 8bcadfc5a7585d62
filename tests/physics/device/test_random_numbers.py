"""Random numbers in kernels equal those of numpy."""

import numpy as np
import pytest

from palpate.physics.device.random_numbers import seed_state, uniform


@pytest.mark.parametrize("seed", [0, 1, 20, 2**63 - 1])
def test_a_kernel_draws_the_same_numbers_as_numpy(seed):
    state, numpys = seed_state(seed), np.random.Generator(np.random.PCG64(seed))
    assert [uniform(state) for _ in range(1000)] == numpys.random(1000).tolist()
