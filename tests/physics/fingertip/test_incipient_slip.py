"""In the shipped scene of the sliding fingertip the warning of incipient slip precedes gross slip."""

import pytest

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Slip
from palpate.records.reader import Recording
from palpate.views.pictures.slip import slides
from palpate.views.pictures.touch import TouchStreams

LEAD = 0.45
"""[1] From the docs: the finger travels at least this fraction of its depth between warning and gross slip."""


def slide(folder, *sets, duration=3.0):
    launch = find("fingertip-slide").but(
        record=folder / "run.mcap", place="fused", duration=duration, overrides=[f"scene.finger.{one}" for one in sets]
    )
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return TouchStreams(Recording(folder / "run.mcap"))


@pytest.mark.parametrize(
    ("speed", "depth"),
    [
        *((2.0, 0.5), (2.0, 2.5), (20.0, 1.0)),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in ((1.0, 2.0), (2.0, 1.0), (2.0, 1.5), (2.0, 2.0), (10.0, 2.0))
        ),
    ],
)
def test_the_warning_leads_gross_slip_by_the_stated_travel_at_any_speed_and_force(tmp_path, speed, depth):
    sets = f"speed='{speed} mm/s'", f"depth='{depth} mm'", "lift=0", "hold='0.5 s'"
    # it moves down at 4 mm/s, holds, and reaches gross slip before it has travelled its depth
    contact, _, _, at = slides(slide(tmp_path, *sets, duration=0.6 + depth / 4.0 + depth / speed))
    assert at.begin < at.warned < at.gross
    lead = (contact["time"][at.gross] - contact["time"][at.warned]) * speed
    assert lead > LEAD * depth
    assert contact["force"][at.gross] == pytest.approx(
        contact["force"][at.begin], rel=0.05
    )  # it still relaxes slightly


def test_without_a_slide_no_warning_is_given(tmp_path):
    touch = slide(tmp_path, "distance=0", "lift=0", duration=1.2)
    assert not touch[Slip]["incipient"].any() and not touch[Slip]["gross"].any()
    *_, at = slides(touch)
    assert at.begin is None and at.warned is None and at.gross is None


@pytest.mark.parametrize("angle", [0, pytest.param(40, marks=pytest.mark.long), 75])
def test_the_warning_precedes_gross_slip_at_other_angles_of_the_finger(tmp_path, angle):
    *_, at = slides(slide(tmp_path, f"angle='{angle} deg'", "hold='0.5 s'", duration=2.0))
    assert at.begin < at.warned < at.gross - 200
