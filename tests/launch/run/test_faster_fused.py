"""A run in processes says when one process gives the same bytes in less than half the time."""

import pytest

from palpate.launch.run.execute import faster_fused
from palpate.launch.run.result import Result


@pytest.mark.parametrize(
    ("wall", "mean", "says"), [(20.0, 1e-3, True), (20.0, 6e-3, False), (0.9, 1e-6, False), (1.7, 1e-6, True)]
)
def test_the_note_depends_on_the_time_of_the_steps(wall, mean, says):
    result = Result()
    result.wall = wall
    result.health = {name: {"steps": 1000, "step": {"mean": mean}} for name in ("a", "b")}
    notes = faster_fused(result)
    assert bool(notes) == says
    if says:
        assert notes == [f"--fused gives the same bytes in about {max(0.1, 2000 * mean):.1f} s instead of {wall:.1f} s"]
