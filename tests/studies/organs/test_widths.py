"""The relations of a finger that has a width, and that the search sees a force that a gap has swallowed."""

import numpy as np
import pytest
from pytest import approx

from palpate.engine.slot import NodeError
from palpate.physics.geometry.topology import edge_counts
from palpate.studies.organs import width_tasks
from palpate.studies.organs.gaps import HIGH, MM, OF_BLOCK, cut_mesh, plane_of, slots_of, stiffness_left
from palpate.studies.organs.report import line, plain, text
from palpate.studies.organs.search import Found, Results
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.width_tasks import compare_widths, tasks_of
from palpate.studies.organs.widths import block_relations, merged, press_touch, same, within
from palpate.studies.organs.zoo import COARSE, GAPPED, USUAL, ZOO, mesh_of, specimen_of

POINT = ("scene.finger.width=0",)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("meshes")


def related(listed):
    results = Results()
    results.relate(listed)
    return results


def volume(mesh):
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("name", GAPPED)
def test_bodies_with_gaps_are_closed(name):
    mesh = GAPPED[name].make(COARSE)
    assert edge_counts(mesh.triangles, len(mesh.vertices)) == (0, 0)
    assert volume(mesh) > 0.0


def test_a_cut_body_lacks_a_slab_of_the_gap():
    whole, gap = mesh_of("box", USUAL), 2 * MM
    cut, (normal, offset) = cut_mesh(whole, gap, 7), plane_of(whole, 7)
    away = np.abs(cut.vertices @ normal - offset)
    assert away.min() == approx(0.5 * gap, abs=1e-9)
    assert 0.0 < volume(whole) - volume(cut) < gap * 70 * MM * 60 * MM
    assert specimen_of("box@2@7").about == "50 x 40 x 30 mm, cut, 2 mm apart"


@pytest.mark.long  # tests/nodes/test_width.py: the product's forces at a cut and in grooves
def test_gaps_and_grooves_of_a_block_lose_and_add_no_force(folder):
    results = related(block_relations("MassSpring", 3, np.random.default_rng(1), folder))
    assert results.related["gap"] == 15 and results.related["groove"] >= 9
    assert not results.apart.total(), text(results, folder)


@pytest.mark.long  # tests/nodes/test_width.py: the product's forces at a cut and in grooves
def test_a_body_cut_by_a_plane_feels_whole_and_a_convex_one_does_not_change(folder):
    rng = np.random.default_rng(2)
    listed = merged(ZOO["box"], "MassSpring", 4, rng, folder) + same(ZOO["sphere"], "MassSpring", 2, rng, folder)
    results = related(listed)
    assert results.related["merged"] == 4 and results.related["same"] == 2
    assert not results.apart.total(), text(results, folder)


def test_the_search_sees_a_force_that_a_gap_has_swallowed(folder):
    """The finger without a width falls into the gaps: the lower bound is broken, and the report prints both."""
    results = related(block_relations("MassSpring", 3, np.random.default_rng(1), folder, POINT))
    assert results.apart["gap"] >= 5 and results.apart["groove"] >= 3
    worst = results.unlike["gap"][0]
    assert worst.score.value < worst.score.least < worst.score.bound and "bounds" in line(worst)
    report = plain(results, folder)
    assert not report["ok"] and {"least", "bound"} <= set(report["unlike"][0])


def test_beams_of_the_block_are_compared_and_lose_what_is_missing_over_a_gap(folder):
    """The layers of 30 mm did not fit into the block, 24 mm thick, so that no gap of it had been touched."""
    body = block_relations("BeamBundle", 4, np.random.default_rng([3, *b"block BeamBundle"]), folder)
    results = related(body)
    assert results.related["gap"] == 20 and results.related["groove"] == 20 and not results.apart.total()
    lost = [each.score.value for each in body if each.touch.setting.surface == "cut-2"]
    whole = [each.score.value for each in body if each.touch.setting.surface == "cut-0.05"]
    assert min(np.array(lost) / whole) < 0.9
    swallowed = related(block_relations("BeamBundle", 3, np.random.default_rng(1), folder, POINT))
    assert swallowed.apart["gap"] >= 5


def test_beams_that_are_missing_over_slots_take_their_stiffness_with_them(middles=(-5e-3, 3e-3), width=2e-3, r=8e-3):
    x, y = np.meshgrid(*2 * [(np.arange(-400, 400) + 0.5) * r / 400])
    weight = np.where(x * x + y * y < r * r, (1.0 - (x * x + y * y) / r**2) ** 2, 0.0)

    def left(at):
        under = weight * np.all([np.abs(y + at - middle) >= 0.5 * width for middle in middles], axis=0)
        return under.sum() ** 2 / (under**2).sum()

    least = min(map(left, np.arange(-15e-3, 15e-3, 0.5e-3))) / left(1.0)
    assert stiffness_left(middles, width, r) == approx(least, rel=0.01)
    # of a narrow slot: w/R times the difference of the integrals over a line through the middle and over the patch
    narrow = width / 20 / r * (2 * (16 / 15) / (np.pi / 3) - (256 / 315) / (np.pi / 5))
    assert 1.0 - stiffness_left((0.0,), width / 20, r) == approx(narrow, rel=0.06)
    assert stiffness_left((0.0,), 0.0, r) == 1.0 and stiffness_left((0.0,), 2 * r, r) == approx(0.0, abs=1e-6)


@pytest.mark.parametrize("name", GAPPED)
def test_the_slots_of_a_body_are_those_of_its_mesh(name):
    """No vertex of the block is inside of a slot, and some are at its walls."""
    middles, width = slots_of(name)
    if name not in OF_BLOCK or not width:
        return
    away = np.abs(GAPPED[name].make(COARSE).vertices[:, 1:2] - middles).min(axis=1)
    top = GAPPED[name].make(COARSE).vertices[:, 2] > 0.5 * HIGH - 1e-9
    assert away[top].min() == approx(0.5 * width, abs=1e-9)


def test_tasks_of_a_search_are_kept_and_not_run_again(folder, monkeypatch):
    kept, calls = folder / "kept.jsonl", []
    touch = press_touch(Setting("block", USUAL, width=16 * MM), np.zeros(3), np.array([0.0, 0.0, -1.0]), MM)

    def task(rng):
        calls.append(rng.integers(1000))
        return [Found(touch, "gap", within(0.5, 0.9, 1.1, 0.3))]

    monkeypatch.setattr(width_tasks, "tasks_of", lambda *given: {"one": task, "two": task})
    run = lambda seed: list(compare_widths([], [], 3, seed, folder, results=kept))  # noqa: E731
    first = run(1)
    kept.write_text(kept.read_text() + '{"seed": 1, "cou')  # interrupted
    assert run(1) == first and len(calls) == 2 and calls[0] != calls[1]
    assert first[0][1][0].score.broken
    run(2)
    assert len(calls) == 4


def test_all_relations_are_tasks_of_each_body(folder):
    names = tasks_of([ZOO["box"]], ("MassSpring", "ReducedFE"), 1, folder)
    kinds = {name.split()[0] for name in names}
    assert kinds == {"block", "slides", "fissure", "overlaps", "merged", "same", "spun", "again"}
    assert not any("ReducedFE" in name for name in names)  # needs a basis of each body


def test_a_body_that_does_not_fit_is_refused_and_breaks_no_relation(tmp_path):
    """Each touch failed and counted as broken: layers of 30 mm in a tube 28 mm thick."""
    with pytest.raises(NodeError, match="layers: found 30 mm in all, the body is 28"):
        merged(ZOO["torus-14"], "BeamBundle", 2, np.random.default_rng(3), tmp_path)
