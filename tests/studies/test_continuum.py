"""The block, its two solvers, and the references that are stored."""

import numpy as np
import pytest
import references

from palpate.models.fe.element.mesh import grid
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy import sites
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.peers import MissingError, continuum, felupe
from palpate.studies.peers.continuum import RADIUS, TissueBlock, press_block

FIRST = np.array([0.03, 0.1])


def test_cells_and_their_moduli_have_the_same_order():
    block = TissueBlock(3e-3, 3, nodule=True)
    points, cells = grid(*block.axes())
    away = np.linalg.norm(points[cells].mean(axis=1) - (0.0, 0.0, -6e-3), axis=1)
    assert (block.hardness()[away < 1.5e-3] == 10.0).all()
    assert (block.hardness()[away > 8e-3] == 1.0).all()


def test_the_hardness_map_contains_the_volume_of_the_nodule():
    block = TissueBlock(0.0, 5, nodule=True)
    sizes = np.einsum("i,j,k->kji", *(np.diff(a) for a in block.axes())).ravel()
    volume = 2.0 * np.sum((block.hardness() - 1.0) / 9.0 * sizes)
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * 4e-3**3, rel=0.06)


def test_the_load_is_the_integral_of_the_pressure():
    block = TissueBlock(0.01, 3)
    points, cells = grid(*block.axes())
    from palpate.models.fe.element.mesh import bricks, quadratic

    mesh = quadratic(points, bricks(points, cells))
    top = mesh.faces[(mesh.points[mesh.faces[:, :3], 2] > -1e-9).all(axis=1)]
    unit = continuum.on_triangles(mesh.points, top, block.pressure)[:, 2]
    x, y, _ = mesh.points.T
    assert unit.sum() == pytest.approx(-1.0)
    assert unit @ x == pytest.approx(-0.01, rel=1e-6)
    assert -unit @ ((x - 0.01) ** 2 + y**2) == pytest.approx(RADIUS**2 / 4, rel=1e-3)  # second moment of the biweight


def test_a_coarse_mesh_agrees_with_the_stored_reference_and_a_finer_one_is_softer():
    right = sites.load_reference("middle")
    coarse, finer = (press_block(TissueBlock(0.0, n), FIRST).indentation for n in (1, 2))
    assert (coarse < finer).all()  # displacement elements are too stiff
    assert (finer < right.indentation[:2] + right.band[:2]).all()
    assert finer == pytest.approx(right.indentation[:2], rel=0.04)


def test_a_reference_solver_agrees_on_other_elements():
    pytest.importorskip("felupe")
    right = sites.load_reference("middle")
    assert felupe.press_block(TissueBlock(0.0, 1), FIRST).indentation == pytest.approx(right.indentation[:2], rel=0.05)


@pytest.mark.parametrize("name", sorted({p for t in TOUCHES.values() if t.place for p in sites.on_path(t.place)}))
def test_a_stored_reference_contains_its_origin_and_error(name):
    place = sites.load_reference(name)
    assert {"command", "commit", "solvers", "young", "felupe", "place"} <= set(place.about)
    assert all(len(printed["unknowns"]) == 2 for printed in place.about["solvers"].values())
    assert (np.diff(place.indentation) > 0).all()
    assert (place.band < 0.08 * place.indentation).all()
    assert place.work[-1] == pytest.approx(np.trapezoid(place.force, place.indentation), rel=0.1)


def test_a_harder_position_yields_less():
    depth = {name: sites.load_reference(name).indentation[-1] for name in ("middle", "edge", "nodule-00", "nodule-10")}
    assert depth["nodule-00"] < depth["nodule-10"] < depth["middle"] < depth["edge"]


def test_a_surface_free_to_slide_is_softer_with_a_difference_that_grows_with_the_load():
    free, held = sites.load_reference("slip"), sites.load_reference("middle")
    assert free.about["place"]["sticks"] is False
    more = free.indentation / np.interp(free.force, np.append(0.0, held.force), np.append(0.0, held.indentation)) - 1.0
    assert more[0] == pytest.approx(0.006, abs=0.003) and (np.diff(more) > 0.0).all()  # HELD (1 - 2 nu)²/(1 - nu)²
    assert more[-1] == pytest.approx(0.03, abs=0.01)


def test_references_are_rebuilt_with_their_error_band(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sites, "LEVELS", FIRST)
    monkeypatch.setattr(
        sites, "compute_curve", sites.compute_curve.__wrapped__
    )  # other loads than elsewhere: nothing is kept
    printed = list(references.rebuild(["middle"], {"command": "here"}, tmp_path, {"fe": (1, 2)}))
    assert printed[-1][1] == 1.0
    monkeypatch.setattr(sites, "SHIPPED", tmp_path)
    sites.load_reference.cache_clear()
    try:
        place = sites.load_reference("middle")
    finally:
        sites.load_reference.cache_clear()
    coarse, finer = (press_block(TissueBlock(0.0, n), FIRST).indentation for n in (1, 2))
    assert place.indentation == pytest.approx(finer)
    assert place.band == pytest.approx((finer - coarse) / 3.0)
    assert place.about["command"] == "here"


def test_a_missing_or_damaged_reference_is_an_error_with_the_cure(tmp_path, monkeypatch):
    monkeypatch.setattr(sites, "SHIPPED", tmp_path)
    sites.load_reference.cache_clear()
    with pytest.raises(MissingError, match=r"benchmarks/references\.py"):
        sites.load_reference("middle")
    (tmp_path / "middle.npz").write_bytes(b"no archive")
    with pytest.raises(ArgumentError, match="damaged"):
        sites.load_reference("middle")
    sites.load_reference.cache_clear()
