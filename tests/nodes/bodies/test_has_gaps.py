"""Which bodies have gaps that a finger does not enter (nodes.base.felt)."""

import pytest

from palpate.nodes.base.felt import has_gaps
from palpate.nodes.deformation import ReducedFE
from palpate.physics.geometry.mesh import write_ply
from palpate.studies.organs.gaps import MM, block, cut_block, slotted


@pytest.mark.parametrize(("name", "expected"), [("block", False), ("cut", True), ("groove", True)])
def test_only_gaps_that_are_narrower_than_the_finger_count(name, expected, tmp_path):
    made = {
        "block": lambda: block(2000), "cut": lambda: cut_block(0.5 * MM, 2000),
        "groove": lambda: slotted(4 * MM, (-2 * MM,), 10 * MM, 2000),
    }  # fmt: skip
    path = tmp_path / f"{name}.ply"
    write_ply(path, made[name]())
    node = ReducedFE(surface=str(path), refine=0.0)
    assert has_gaps(node, 16 * MM) is expected
    assert not has_gaps(node, 0.0)


def test_a_finger_that_fits_nowhere_leaves_gaps(tmp_path):
    path = tmp_path / "cut.ply"
    write_ply(path, cut_block(0.5 * MM, 2000))
    assert has_gaps(ReducedFE(surface=str(path), refine=0.0), 90 * MM)


def test_built_in_organs_have_none():
    for surface in ("kidney", "plane"):
        assert not has_gaps(ReducedFE(surface=surface), 16 * MM)
