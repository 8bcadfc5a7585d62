"""Times of clocks and of days: the range counts, not the value; and a column of time can be left out."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from pytest import approx

from palpate.models.fit.sessions import SessionError
from palpate.nodes.device.motion import read_motion
from palpate.studies.presses import PressReader

STEP = 0.02  # [s]
TIME = STEP * np.arange(60)
DEPTH = 1e-2 * (np.arange(60) - 20.0)  # [mm]
FORCE = np.maximum(DEPTH, 0.0) ** 1.5 + 1e-4 * np.sin(37.0 * np.arange(60))
START = datetime(2024, 3, 15, 23, 59, 59, 400000)
MOMENTS = [START + timedelta(seconds=float(t)) for t in TIME]


def clock(form):
    return [moment.strftime(form) for moment in MOMENTS]


NANOSECONDS = [1710547199123456789 + round(1e9 * t) for t in TIME]
CLOCKS = {
    "seconds since 1970": ("t", [f"{1710547199.123 + t:.3f}" for t in TIME]),
    "seconds since 1970, with a unit": ("t [s]", [f"{1710547199.123 + t:.3f}" for t in TIME]),
    "milliseconds since 1970": ("t", [str(1710547199123 + round(1e3 * t)) for t in TIME]),
    "microseconds since 1970": ("t", [str(1710547199123456 + round(1e6 * t)) for t in TIME]),
    "ROS": ("t", list(map(str, NANOSECONDS))),
    "rosbag": ("%time", list(map(str, NANOSECONDS))),
    "days of Excel": ("t", [f"{45366.9995 + t / 86400:.11f}" for t in TIME]),
    "days of MATLAB": ("time", ["739326" + f"{0.9995 + t / 86400:.11f}"[1:] for t in TIME]),
    "LSL": ("t [s]", [f"{3812345.678 + t:.6f}" for t in TIME]),
    "LSL, milliseconds": ("t [ms]", [f"{3812345678.9 + 1e3 * t:.3f}" for t in TIME]),
    "hh:mm:ss, midnight": ("t", clock("%H:%M:%S.%f")),
    "hh:mm:ss with its form": ("t (hh:mm:ss)", clock("%H:%M:%S.%f")),
    "12 hours": ("Time", clock("%I:%M:%S.%f %p")),
    "mm:ss": ("Time", [f"59:{59.4 + t:05.2f}" if t < 0.6 else f"60:{t - 0.6:05.2f}" for t in TIME]),
    "ISO": ("time", clock("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO, blank": ("time", clock("%Y-%m-%d %H:%M:%S.%f")),
    "Germany": ("time", clock("%d.%m.%Y %H:%M:%S.%f")),
    "USA": ("time", clock("%m/%d/%Y %I:%M:%S.%f %p")),
}


def saved(tmp_path, head, times, separator=";"):
    lines = [separator.join([head, "depth [mm]", "force [N]"])]
    lines += [f"{t}{separator}{d:.3f}{separator}{f:.6f}" for t, d, f in zip(times, DEPTH, FORCE, strict=True)]
    path = tmp_path / "press.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read(path, *columns, units=()):
    (press,) = PressReader(columns, units, False)(path)
    return press


@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_counts_from_the_first_row(tmp_path, name):
    head, times = CLOCKS[name]
    press = read(saved(tmp_path, head, times), *(["time=time"] if head == "%time" else []))
    assert press.time - press.time[0] == approx(TIME, abs=2e-6)
    assert press.depth == approx(1e-3 * DEPTH, abs=1e-9)


@pytest.mark.parametrize("name", ["ROS", "hh:mm:ss, midnight", "ISO", "seconds since 1970"])
def test_motions_take_the_same_clocks(tmp_path, name):
    path = tmp_path / "m.csv"
    path.write_text("t;x [mm];y [mm];z [mm]\n" + "".join(f"{t};{k};0;0\n" for k, t in enumerate(CLOCKS[name][1])))
    assert np.ptp(read_motion(str(path)).times) == approx(TIME[-1], abs=2e-6)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([f"10:{k:02d}" for k in range(60)], "row 2: found '10:00': hours and minutes, or minutes and seconds"),
        ([f"2024-13-45 10:00:{k:02d}.5" for k in range(60)], "row 2: found '2024-13-45.*no date"),
        ([f"10:00:{k // 30:02d}" for k in range(60)], "resolution is too low.*--columns time= leaves the time out"),
        ([f"{1e7 * k}" for k in range(60)], "no unit|spans more than a press lasts"),
        (["yesterday"] * 60, "column 't'.*--columns time= leaves the time out"),
    ],
)
def test_a_clock_that_may_be_wrong_is_refused_and_left_out_on_demand(tmp_path, times, message):
    path = saved(tmp_path, "t", times)
    with pytest.raises(SessionError, match=message):
        read(path)
    press = read(path, "time=")
    assert press.time is None and press.depth == approx(1e-3 * DEPTH, abs=1e-9)


@pytest.mark.parametrize(("first", "step"), [(45366.0, 0.02), (45366.0, 2e-5), (12.0, 1e-7), (739326.0, 1e-4)])
def test_seconds_are_not_taken_for_days(tmp_path, first, step):
    press = read(saved(tmp_path, "t", [f"{first + step * k:.9f}" for k in range(60)]))
    assert np.ptp(press.time) == approx(59 * step, rel=1e-3)


def test_a_unit_of_the_header_is_not_overruled_by_the_size_of_a_stamp(tmp_path):
    press = read(saved(tmp_path, "t [us]", [str(1710547199123 + round(1e6 * t)) for t in TIME]))
    assert press.time - press.time[0] == approx(TIME, abs=2e-6)
