"""Two organs of simple shape pressed together: candidates against Hertz, and bodies against full finite elements."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import MassSpring, ReducedFE
from palpate.physics.bodies.between_bodies import mean_inverse
from palpate.physics.contact.organs import between
from palpate.physics.contact.organs.borders import contact_area
from palpate.physics.contact.organs.candidates import candidates
from palpate.physics.errors import ArgumentError
from palpate.physics.geometry.mesh import Mesh
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.cells import one
from palpate.studies.accuracy.methods import standard
from palpate.studies.accuracy.outcome import Fidelity
from palpate.studies.accuracy.reference import reference_solution
from palpate.studies.meeting import reduced, stored
from palpate.studies.meeting.solids import MEETINGS, SOLIDS, TURN
from palpate.studies.peers import MissingError
from palpate.studies.peers.continuum import BED, POISSON, YOUNG

MODULUS = 0.5 * YOUNG / (1.0 - POISSON**2)  # E* of two equal materials


@pytest.mark.parametrize("name", ["balls", "cylinders", "ball-slab", pytest.param("ball-bowl", marks=pytest.mark.long)])
def test_candidates_of_curved_surfaces_press_as_hertz_computes(name):
    """The candidates of meshes without symmetry, with the compliance of half-spaces, at closings where the surfaces are
    paraboloids: force within 3 %, area within 6 %."""
    meeting = MEETINGS[name]
    lower, upper = SOLIDS[meeting.lower].surface(60), SOLIDS[meeting.upper].surface(60)
    gap = 1e-5
    above = Mesh(upper.vertices @ TURN.T + (0.0, 0.0, gap), upper.triangles)
    found = candidates(above, lower, 4e-3, 300)
    compliance = (1.0 - POISSON**2) / (np.pi * YOUNG) * mean_inverse(found.first.place, found.area)
    pair, size = between.pair(found.gap, compliance, compliance, (0.0, 0.0)), len(found.gap)
    for depth in (0.7e-3, 1e-3, 1.3e-3):
        between.step_pair(pair, np.stack([-(depth + gap) * found.normal[:, 2], np.zeros(size)]), 1e-3, 10_000)
        expected = 4.0 / 3.0 * MODULUS * np.sqrt(meeting.radius) * depth**1.5
        assert pair.active.force.sum() == approx(expected, rel=0.03)
        area = contact_area(pair, found.area, found.borders.cells, found.borders.area)
        assert area == approx(np.pi * meeting.radius * depth, rel=0.06)


def test_two_balls_press_as_full_finite_elements_compute():
    """ReducedFE, linear: force within 3 % of fe.Solver with fe.Pair; area within 10 %, on cells of 1 to 4 vertices."""
    right = stored.reference("balls")
    levels = np.array(right["closing"])
    closings = np.linspace(-1e-4, levels[-1], 150)
    body = {"young": YOUNG, "poisson": POISSON, "bed": BED, "retardation": 0.0, "model": "linear"}
    found = reduced.run(MEETINGS["balls"], ReducedFE, body, closings)
    force, area = np.interp(levels, closings, found.force), np.interp(levels, closings, found.area)
    assert force == approx(np.array(right["force"]), rel=0.03)
    assert area == approx(np.array(right["area"]), rel=0.1)


def test_the_bench_compares_bodies_that_touch_and_refuses_others():
    touch, known = TOUCHES["organs"], {m.name: m for m in standard()}
    coarse = Fidelity("coarse", 250.0, {"surface": {"vertices": 1000}})
    cell = one(touch, known["ReducedFE-linear"], coarse)
    assert cell.status == "ok" and cell.errors["force"]["rms"] < 0.03 and cell.p50 < 0.01
    for name in ("hertz", "series", "MassSpring", "full-FE"):
        assert one(touch, known[name], known[name].fidelities[0]).status == "refused"
    wide = Fidelity("kernel", settings={"spread": {"radius": 4e-3}})
    assert one(touch, known["ReducedFE"], wide).why == "organs that touch have no spread"


def test_the_reference_passes_through_its_levels():
    curve, touch = stored.reference("balls"), TOUCHES["organs"]
    values, bands = stored.meeting_values("balls", np.array(curve["closing"]))
    assert values["force"] == approx(np.array(curve["force"])) and bands["area"] == approx(np.array(curve["area band"]))
    first = np.array(curve["closing"])[:1] / 4.0
    assert stored.meeting_values("balls", first)[0]["force"] == approx(curve["force"][0] / 8.0)
    assert reference_solution(touch).values["force"].max() == approx(curve["force"][-1], rel=1e-3)


def test_unknown_meetings_and_bodies_are_refused(tmp_path, monkeypatch):
    with pytest.raises(ArgumentError, match="expected one of balls"):
        reduced.choose_meetings(["pears"])
    with pytest.raises(MissingError, match="pears is missing"):
        stored.reference("pears")
    with pytest.raises(SettingError, match="the contact with another organ"):
        reduced.run(MEETINGS["balls"], MassSpring, {}, np.zeros(2), vertices=400)
    monkeypatch.setattr(stored, "PATH", tmp_path / "references.json")
    stored.PATH.write_text("{", encoding="utf-8")
    stored.references.cache_clear()
    with pytest.raises(ArgumentError, match="damaged"):
        stored.reference("balls")
    stored.references.cache_clear()


def test_a_descent_has_the_velocity_of_its_motion():
    """Without it each tick was a leap, which the contact withholds: nothing touched."""
    bus = FakeBus(reduced._Descent(np.array([-1e-3, -1.2e-3, -1.7e-3])))
    sent = bus.run(3)
    assert [s.displacement[2] for s in sent] == [-1e-3, -1.2e-3, -1.7e-3]
    assert [s.velocity[2] for s in sent] == approx([0.0, -0.2, -0.5])
