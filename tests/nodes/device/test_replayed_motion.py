"""A device that follows a table of a motion."""

import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.nodes.base import SettingError
from palpate.nodes.device import Replayed


def table(tmp_path, text):
    file = tmp_path / "motion.csv"
    file.write_text(text)
    return str(file)


def test_the_motion_is_linear_between_rows_and_stays_at_the_end(tmp_path):
    path = table(tmp_path, "# a slide\nt,x,y,z,buttons\n0,0,0,0.1,0\n0.1,0.01,0,0.1,2\n0.2,0.01,0.02,0.1,0\n")
    states = FakeBus(Replayed(path=path)).run(300)
    assert states[50].position == approx((0.005, 0.0, 0.1)) and states[50].buttons == 0
    assert states[150].position == approx((0.01, 0.01, 0.1)) and states[150].buttons == 2
    assert states[-1].position == approx((0.01, 0.02, 0.1)) and states[-1].joints == ()


def test_the_motion_repeats(tmp_path):
    path = table(tmp_path, "z,x,y,t\n0.1,0,0,5\n0.1,1,0,5.1\n")
    states = FakeBus(Replayed(path=path, repeat=True)).run(250)
    assert states[150].position[0] == approx(states[50].position[0], abs=1e-9)


def test_joint_angles_are_sent(tmp_path):
    path = table(tmp_path, "t,joint3,joint1,joint2\n0,3,1,2\n1,3,1,2\n")
    (state,) = FakeBus(Replayed(path=path)).run(1)
    assert state.joints == (1.0, 2.0, 3.0) and state.position == ()


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("", "empty; expected a head"),
        ("t,x,y\n0,0,0\n", r"its header is t, x, y; expected t and x, y, z \[m\]"),
        ("t,x,y,z\n", "a header without rows"),
        ("t,x,y,z\n0,0,0,0\n0.1,a,0,0\n", "row 3, column 'x': found 'a', expected a number"),
        ("t,x,y,z\n0,0,0\n", "row 2, column 'z': found '', expected a number"),
        ("t,x,y,z\n0,0,0,0\n0,0,0,1\n", "row 3: the time 0.0 s does not increase"),
        ("t,x,y,z\n0,0,0,nan\n", "row 2, column 'z': found 'nan', expected a finite number"),
    ],
)
def test_an_invalid_table_is_an_error(tmp_path, text, reported):
    with pytest.raises(SettingError, match=reported):
        FakeBus(Replayed(path=table(tmp_path, text)))


def test_a_missing_table_is_an_error():
    with pytest.raises(SettingError, match=r"none\.csv: No such file"):
        FakeBus(Replayed(path="none.csv"))
