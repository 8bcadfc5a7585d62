"""Two fingers that press one body exchange energy through it. The damping that dissipates what one hand receives must
not be felt as a kick: the force on each hand changes only as fast as the motion of its finger allows."""

import numpy as np
import pytest

from palpate.studies.organs.invariants import contact, force, hand, score_touch
from palpate.studies.organs.runs import run
from palpate.studies.organs.search import vary_touch
from palpate.studies.organs.touches import THICKNESS, Finger, Setting, Touch
from palpate.studies.organs.trace import trace_batch


def moves(*points, times, holds, shapes):
    path = []
    for k, (to, time, shape) in enumerate(zip(points, times, shapes, strict=True)):
        path.append({"to": list(to), "time": time, "shape": shape})
        if 0 < k < len(points) - 1:
            path.append({"hold": holds[k - 1]})
    return tuple(path)


SLIDES = Finger(
    (-0.034561, 0.005094, -0.033047), (-0.0315, -0.0034, -0.1308),
    moves((-0.030827, 0.00481, -0.02848), (-0.019651, 0.00396, -0.014811), (-0.028423, -0.011917, -0.008625),
          (-0.043334, -0.010783, -0.026861), times=(0.1134, 0.3393, 0.3679, 0.3067), holds=(0.251, 0.161),
          shapes=("minimum-jerk", "linear", "linear", "minimum-jerk")),
)  # fmt: skip
PRESSES = Finger(
    (-0.018892, 0.0077, -0.040433), (-0.0188, 0.007, -0.1352),
    moves((-0.018737, 0.007473, -0.029499), (-0.018461, 0.007066, -0.009966), (-0.018609, 0.006372, -0.009978),
          (-0.01904, 0.007005, -0.040445), times=(0.2188, 0.5, 0.5, 0.4155), holds=(0.252, 0.151),
          shapes=("minimum-jerk",) * 4),
)  # fmt: skip
GROOVE = Touch(Setting("groove", 600, "BeamBundle", "", 1000.0, 2), (SLIDES, PRESSES))
"""While one finger presses, the other presses the groove next to it and slides away: the tissue returns 13 mJ where the
finger put in 9."""


def traces_of(touches, folder):
    """What each finger of each touch went through."""
    return [trace for listed in trace_batch(run(touches, folder)) for trace in listed]


def test_the_energy_that_another_finger_put_in_is_returned_without_a_kick(tmp_path):
    """The damping began within a tick, with 4.2 N, in which the finger moved by more than 1.5 counts of the encoder."""
    for trace in traces_of([GROOVE], tmp_path):
        score = hand(trace)
        assert not score.broken, score
        assert 0.0 < np.linalg.norm(np.diff(trace["controller.force"], axis=0), axis=1).max() < 0.4


LIFTED = Touch(
    Setting("sphere-nurbs", 0, "ReducedFE", "LuGre", 500.0, 2),
    (
        Finger(
            (0.032912, 0.017579, 0.00976), (0.016, 0.0074, -0.1055),
            moves((0.022024, 0.011134, 0.00637), (-0.000908, -0.002438, -0.000771), (0.001796, -0.002868, 0.000437),
                  (0.032912, 0.017579, 0.00976), times=(0.262, 0.5, 0.5, 0.3774), holds=(0.297, 0.116),
                  shapes=("minimum-jerk",) * 4),
        ),
        Finger(
            (0.004478, 0.004123, 0.033457), (0.0068, 0.0012, -0.0946),
            moves((0.005646, 0.002668, 0.024369), (0.009134, -0.001675, -0.002751), (0.004478, 0.004123, 0.033457),
                  times=(0.1855, 0.2769, 0.2487), holds=(0.01,), shapes=("minimum-jerk",) * 3),
        ),
    ),
)  # fmt: skip
"""One finger drags a soft ball, whose surface rises by 2 mm under the other finger."""


def test_a_surface_that_another_finger_lifts_is_touched_where_it_is(tmp_path):
    """Contact began at the undeformed surface: the force leapt from 0 to 5.4 N in a tick."""
    first, second = traces_of([LIFTED], tmp_path)
    press, depth = first["contact.force"], THICKNESS - first["collision.gap"]
    assert ((press > 0.05) & (depth < 0.0)).any()
    for trace in (first, second):
        broken = {name: score for name, score in score_touch(trace).items() if score.broken}
        assert not broken, broken
        assert np.diff(trace["contact.force"]).max() < 0.3


PUSHED = Touch(
    Setting("two-balls", 600, "BeamBundle", "", 2000.0, 2, exact=True, width=0.0, more=("spread.radius=0.01",)),
    (
        Finger(
            (-0.000181, -0.017106, -0.024115), (0.0003, -0.0115, -0.1183),
            moves((4.2e-05, -0.015099, -0.018714), (0.001121, -0.005409, 0.00736), (0.000794, -0.005807, 0.007522),
                  (-0.000508, -0.017505, -0.023954), times=(0.1153, 0.5, 0.5, 0.3895), holds=(0.231, 0.166),
                  shapes=("minimum-jerk", "linear", "linear", "minimum-jerk")),
        ),
        Finger(
            (-0.009499, -0.031392, 0.002785), (-0.0083, -0.0255, -0.1087),
            moves((-0.007411, -0.023147, 0.000855), (-0.006529, -0.019666, 4.1e-05), (-0.007031, -0.019598, -0.000213),
                  (-0.010001, -0.031324, 0.002532), times=(0.1744, 0.5, 0.5, 0.1196), holds=(0.215, 0.108),
                  shapes=("minimum-jerk",) * 4),
        ),
    ),
)  # fmt: skip
"""The first finger raises the tissue under the second one, which then leaves it with energy of the first one."""


def test_a_hand_that_another_finger_pushes_out_feels_the_contact_until_it_ends(tmp_path):
    """The damping against generated energy took the force of the contact away, 0.2 of 0.22 N within 10 ms."""
    first, second = traces_of([PUSHED], tmp_path)
    work = np.cumsum((second["controller.force"][:-1] * np.diff(second["finger.position"], axis=0)).sum(axis=1))
    assert work.max() > 0.1e-3, "the hand gets more than it has put in"
    felt = (second["controller.force"] * second["contact.normal"]).sum(axis=1)
    touching = second["contact.force"] > 0.0
    assert np.abs(felt - second["contact.force"])[touching].max() < 0.03
    for trace in (first, second):
        assert not hand(trace).broken


ROUND = Touch(
    Setting("sphere-nurbs", 0, "ReducedFE", "", 2000.0, 2, width=0.0,
            more=("tissue.retardation=0.0", "device.hand_stiffness=1000")),
    (
        Finger(
            (0.008916, -0.003215, 0.035278), (-0.001, -0.0013, -0.0844),
            moves((0.005296, -0.002305, 0.024793), (0.000768, -0.001167, 0.011675), (-0.010817, 0.000625, 0.01583),
                  (-0.00267, -0.001423, 0.039433), times=(0.2226, 0.5, 0.5, 0.2981), holds=(0.252, 0.171),
                  shapes=("minimum-jerk", "linear", "linear", "minimum-jerk")),
        ),
        Finger(
            (0.022368, 0.002464, 0.02469), (0.018, 0.001, -0.0996),
            moves((0.019392, 0.001594, 0.014885), (0.013699, -7.2e-05, -0.003872), (0.014604, -0.00044, -0.000827),
                  (0.01447, 0.000154, -0.001332), (0.022368, 0.002464, 0.02469), times=(0.2057, 0.5, 0.5, 0.5, 0.359),
                  holds=(0.214, 0.171, 0.141), shapes=("minimum-jerk", "linear", "linear", "linear", "minimum-jerk")),
        ),
    ),
)  # fmt: skip
"""One finger slides over the top of an elastic ball that another one pushes aside."""


def given(trace):
    """Energy [J] that a finger puts into the tissue in each step, by the forces of the contact."""
    force = trace["contact.force"][:, None] * trace["contact.normal"] + trace["contact.lateral_force"]
    return -0.5 * np.einsum("ti,ti->t", force[1:] + force[:-1], np.diff(trace["finger.position"], axis=0))


def test_a_slide_over_a_ball_that_another_finger_pushes_aside_generates_no_energy(tmp_path):
    """The fingers got 6.2 of 33 mJ that went to and fro, as the force along the surface had the wrong sign: it lacked
    the turn of the normal."""
    work = np.concatenate([given(trace) for trace in traces_of([ROUND], tmp_path)])
    assert np.abs(work).sum() > 25e-3
    assert -0.002 < work.sum() / np.abs(work).sum() < 0.02


RETURNED = Touch(
    Setting("sphere", 5000, "BeamBundle", "", 1000.0, 2, width=0.02, more=("spread.radius=0.01",)),
    (
        Finger(
            (-0.019344, 0.017355, 0.017188), (-0.0127, 0.0046, -0.0932),
            moves((-0.015222, 0.013568, 0.013575), (-0.005023, 0.004199, 0.004636), (-0.006036, -0.008105, 0.016377),
                  (-0.020357, 0.005051, 0.028928), times=(0.1054, 0.2607, 0.2695, 0.245), holds=(0.202, 0.106),
                  shapes=("minimum-jerk",) * 4),
        ),
        Finger(
            (-0.015646, -0.000122, 0.030639), (-0.0082, 0.001, -0.0981),
            moves((-0.011932, 0.000451, 0.021318), (-0.000702, 0.002186, -0.006864), (-0.015646, -0.000122, 0.030639),
                  times=(0.201, 0.5, 0.2716), holds=(0.206,), shapes=("minimum-jerk", "linear", "minimum-jerk")),
        ),
    ),
)  # fmt: skip
"""The beams return 7 mJ more than both fingers put in: their stiffness depends on the place."""


def test_both_hands_together_get_no_energy_that_beams_generate(tmp_path):
    """They got 4.6 mJ, as each hand may have the energy of the other one, and none knew how much that was."""
    first, second = traces_of([RETURNED], tmp_path)
    assert (given(first).sum() + given(second).sum()) < -5e-3
    for trace in (first, second):
        broken = {name: score for name, score in score_touch(trace).items() if score.broken}
        assert not broken, broken


def check_random(count, seed, folder):
    """Neither the force of the contact nor that on the hand jumps, and both have the force of their depth."""
    rng = np.random.default_rng(seed)
    traces = traces_of([vary_touch(GROOVE, 0.5, rng) for _ in range(count)], folder)
    assert len(traces) == 2 * count
    broken = [score for trace in traces for score in (force(trace), hand(trace), contact(trace)) if score.broken]
    assert not broken, broken


def test_random_touches_of_two_fingers_do_not_kick(tmp_path):
    check_random(24, 1, tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2, 6))
def test_more_random_touches_of_two_fingers_do_not_kick(seed, tmp_path):
    check_random(100, seed, tmp_path)
