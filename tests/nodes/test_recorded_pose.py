"""`device.RecordedPose`: the poses of a recording or a table, compiled, with an offset."""

import numpy as np
import pytest

import palpate
from palpate.nodes.base import SettingError
from palpate.nodes.device.recorded_pose import RecordedPose

SOURCE = ["finger.use=device.RecordedPose", "finger.in.state=null"]


def poses(path, duration, *sets):
    given = [*SOURCE, f"finger.path={path}", *sets]
    lanes = palpate.Ensemble("kidney", 1, {}, ["finger.position", "finger.velocity"], sets=given, duration=duration)
    found = lanes.run(quiet=True)
    return found["finger.position"].values[0], found["finger.velocity"].values[0]


def test_a_recording_is_repeated_and_then_stays_at_rest(tmp_path):
    file = tmp_path / "touch.mcap"
    run = palpate.run("kidney", record=file, duration=0.3)
    place, speed = poses(file, 0.35)
    assert (place[:300] == np.asarray(run.finger.position)).all()
    assert (speed[:300] == np.asarray(run.finger.velocity)).all()
    assert (place[300:] == place[299]).all() and (speed[300:] == 0.0).all()
    moved, _ = poses(file, 0.3, "finger.offset=[1 mm, 0, -2 mm]")
    np.testing.assert_allclose(moved - place[:300], np.broadcast_to([1e-3, 0.0, -2e-3], (300, 3)), atol=1e-15)


def test_a_table_is_interpolated(tmp_path):
    file = tmp_path / "motion.csv"
    file.write_text("t [ms],x [mm],y [mm],z [mm]\n0,0,0,116\n100,0,0,106\n200,10,0,106\n")
    place, speed = poses(file, 0.25)
    time = np.arange(250) / 1000.0
    for k, values in enumerate(([0, 0, 0.01], [0, 0, 0], [0.116, 0.106, 0.106])):
        np.testing.assert_allclose(place[:, k], np.interp(time, [0, 0.1, 0.2], values), atol=1e-12)
    np.testing.assert_allclose(speed[50], [0.0, 0.0, -0.1], atol=1e-9)
    np.testing.assert_allclose(speed[150], [0.1, 0.0, 0.0], atol=1e-9)


def test_a_file_without_the_stream_is_refused(tmp_path):
    file = tmp_path / "touch.mcap"
    palpate.run("kidney", record=file, duration=0.01)
    node = RecordedPose(path=str(file), stream="thumb")
    with pytest.raises(SettingError, match="has no messages of a stream 'thumb'"):
        node.start()
    with pytest.raises(SettingError, match=r"touch\.mcap"):
        RecordedPose(path=str(file), stream="contact").start()
    joints = tmp_path / "joints.csv"
    joints.write_text("t,joint1,joint2,joint3\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(SettingError, match="found joint angles, expected x, y, z"):
        RecordedPose(path=str(joints)).start()
