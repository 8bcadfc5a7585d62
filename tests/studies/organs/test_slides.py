"""Slides over a gap: the foot and the force on the hand move as over the body without it."""

import numpy as np
import pytest

from palpate.bases import build_missing
from palpate.studies.organs.gaps import FISSURE, MM
from palpate.studies.organs.runs import launch, run
from palpate.studies.organs.slides import LIGHT, MORE, largest_change, slide_touch
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import on
from palpate.studies.organs.zoo import USUAL

R = 8 * MM


@pytest.fixture(scope="module")
def slid(tmp_path_factory):
    """Traces of slides in both directions over an ellipsoid with a fissure and over the whole one, 8 mm deep."""
    setting = Setting("block", USUAL, "BeamBundle", friction="", width=2 * R)
    touches = [slide_touch(setting, way, 0.2, 4 * MM, 0.3 * MM) for way in (1.0, -1.0)]
    folder = tmp_path_factory.mktemp("meshes")
    return [run([on(touch, name) for touch in touches], folder)[0] for name in ("fissure", "unfissured")]


def test_viscous_beams_push_the_hand_no_more_suddenly_than_without_a_fissure(slid):
    """By 0.5 N in a tick, 4.2 times the limit, when the foot passed a rim."""
    fissure, whole = (largest_change(traces)[0] for traces in slid)
    assert (fissure < MORE * whole + LIGHT).all()
    assert (fissure > 0.5 * whole).all()


def test_a_foot_over_a_fissure_moves_as_over_the_whole_body(slid):
    """At a rim it began at once to move twice as far as the finger, the limit of `geometry.proxy`. In the depth of 8 mm
    below a curvature of c/b² a foot moves 1/(1 - 8 mm x 25 mm/(35 mm)²) = 1.2 times as far."""
    found = []
    for traces in slid:
        time = np.arange(traces["finger.position"].shape[1]) * traces.step
        slides = (time > 0.53) & (time < 0.57)
        foot, bone = (
            y[:, 4:] - y[:, :-4] for y in (traces[name][:, slides, 1] for name in ("collision.foot", "finger.position"))
        )
        found.append(foot / bone)
    fissure, whole = found
    assert fissure.min() > 0.9 and fissure.max() < 1.5
    np.testing.assert_allclose(whole, 1.2, atol=0.06)


def test_the_force_over_a_fissure_is_that_of_the_beams_next_to_it(slid):
    """Beams under a patch of the pressure p have the stiffness (sum p)²/(sum p²); arm and finger in series add to the
    compliance, so the force is between this share and 1."""
    x, y = np.meshgrid(*(np.linspace(-R, R, 801),) * 2)
    p = np.clip(1.0 - (x * x + y * y) / R**2, 0.0, None) ** 2
    stiffness = [(p * there).sum() ** 2 / (p * p * there).sum() for there in (np.abs(y) > 0.5 * FISSURE, p > 0.0)]
    least, found = stiffness[0] / stiffness[1], []
    for traces in slid:
        at = np.abs(traces["collision.foot"][:, 530:, 1]).argmin(axis=1) + 530
        found.append(traces["contact.force"][np.arange(len(at)), at])
    share = found[0] / found[1]
    assert (least < share).all() and (share < 0.85).all()


@pytest.mark.parametrize("rate", [2000.0, 4000.0])
def test_the_damping_of_a_lag_adds_nothing_sudden_in_a_slide(rate, tmp_path):
    """Its slope was that of each tick, in which the finger moved 74 um along the surface and 1.4 um out of it: the hand
    felt 0.17 N in a tick where the contact changed by 0.10 N, and at 4 kHz 0.26 and 0.10 N."""
    setting = Setting("fissure", USUAL, "BeamBundle", friction="", rate=rate, exact=True, width=2 * R)
    touch = on(slide_touch(setting, 1.0, 0.2, 9 * MM, 0.3 * MM), "fissure")
    traces = run([touch], tmp_path)[0]
    slides = traces["finger.position"][0, :, 1] > -FISSURE
    contact = (traces["contact.force"][..., None] * traces["contact.normal"])[0] + traces["contact.lateral_force"][0]
    changes = (
        np.linalg.norm(np.diff(force[slides], axis=0), axis=1).max()
        for force in (contact, traces["controller.force"][0])
    )
    most, felt = changes
    assert most > 0.01 and felt < 1.1 * most


def test_a_reduced_organ_answers_a_slide_over_a_cut_as_full_elements_do(tmp_path):
    """A cut of 2 mm, a surface that sticks: by at most 0.043 N in a tick with Kelvin-Voigt elements
    (`benchmarks/moving_load.py 2`), and by 0.090 N where the tissue followed the correction of each place at once."""
    setting = Setting("block", USUAL, "ReducedFE", friction="", exact=True, width=2 * R)
    touch = on(slide_touch(setting, 1.0, 0.2, 4 * MM, 0.3 * MM), "cut-2")
    tissue = ("young=60e3", "poisson=0.45", "bed=1e4", "model=linear")
    extra = [*(f"tissue.{each}" for each in tissue), "device.hand_stiffness=2e4"]
    graph = launch(touch.setting, tmp_path, touch.duration, extra).load()
    build_missing(graph, True)
    traces = run([touch], tmp_path, extra=extra)[0]
    there = np.abs(traces["contact.foot"][0, :, 1]) < 6.5 * MM
    there &= traces["finger.position"][0, :, 1] > -6.5 * MM
    assert 0.75 * 0.0432 < np.diff(traces["contact.force"][0])[there[1:]].max() < 1.1 * 0.0432


def test_a_wide_finger_slides_over_slots_without_jumps(tmp_path):
    """Vertices of bridges over slots of 1.5 mm were up to 19 um too high: their slopes jumped by 0.05, and springs with
    viscosity answered with 0.026 N in a tick of 0.25 ms, 0.035 N in one of 0.125 ms. A slope has half in half the time:
    the block changes by 0.0047 N here, in the press."""
    setting = Setting("comb", USUAL, "MassSpring", friction="", rate=4000.0, exact=True, width=20 * MM,
                      more=("spread.radius=0.01",))  # fmt: skip
    touch = slide_touch(setting, 1.0, 0.148, 7.8 * MM, 3.6 * MM)
    comb, block = (largest_change(run([on(touch, name)], tmp_path)[0])[0][0] for name in ("comb", "block"))
    assert 0.004 < block < 0.006
    assert 0.9 * block < comb < MORE * block
