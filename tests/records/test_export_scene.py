"""The scene in an export for Foxglove: its types as Foxglove's own library has them, its places as recorded."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.records.export import export
from palpate.records.export.scene import arrow
from palpate.records.export.shape import LENGTH, RATE, displaced, rest_shape
from palpate.records.reader import Recording

TOUCH = Path(__file__).parents[1] / "golden" / "plane.mcap"


@pytest.fixture(scope="module")
def recording() -> Recording:
    return Recording(TOUCH)


@pytest.fixture(scope="module")
def exported(recording, tmp_path_factory) -> Path:
    (path,) = export(recording, "foxglove", tmp_path_factory.mktemp("scene") / "a.mcap")
    return path


def told(path: Path, topic: str) -> list[tuple[str, int, dict]]:
    """Schema's name, log time and body of each message of a topic."""
    with open(path, "rb") as file:
        return [
            (schema.name, record.log_time, json.loads(record.data))
            for schema, _, record in make_reader(file, validate_crcs=True).iter_messages(topics=[topic])
        ]


def points(part: dict) -> np.ndarray:
    return np.array([[point[axis] for axis in "xyz"] for point in part["points"]]).reshape(-1, 3)


def test_the_drawn_body_is_where_it_was_at_that_instant(recording, exported):
    rest, triangles = rest_shape(recording, "tissue")
    ((_, _, still),) = told(exported, "/tissue/still")
    moving = told(exported, "/tissue/surface")
    recorded = {message.time: message for message in recording.messages("tissue")}
    (fixed,) = still["entities"][0]["triangles"]
    assert len(moving) > 2
    for name, time, body in moving:
        assert name == "foxglove.SceneUpdate"
        (entity,) = body["entities"]
        (part,) = entity["triangles"]
        assert entity["timestamp"]["sec"] * 10**9 + entity["timestamp"]["nsec"] == time
        where = rest + displaced(recording, "tissue", recorded[time], rest)
        corners = [points(one)[np.array(one["indices"])] for one in (part, fixed)]
        drawn = np.concatenate(corners).reshape(-1, 9)
        assert drawn[np.lexsort(drawn.T)] == pytest.approx(
            _sorted_like(where[triangles].reshape(-1, 9), drawn), abs=1e-6
        )
        assert len(part["colors"]) == len(part["points"])


def _sorted_like(triangles: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    rounded = np.round(triangles, 6)
    assert rounded.shape == drawn.shape
    return triangles[np.lexsort(rounded.T)]


def test_what_never_moves_is_sent_once_and_the_rest_no_more_often_than_the_eye_sees(recording, exported):
    times = np.array([time for _, time, _ in told(exported, "/tissue/surface")]) * 1e-9
    assert np.diff(times).min() >= 1.0 / RATE - 1e-9
    assert len(times) >= 0.8 * RATE * (times[-1] - times[0])
    ((_, _, still),) = told(exported, "/tissue/still")
    (_, _, moving), *_ = told(exported, "/tissue/surface")
    counts = [len(body["entities"][0]["triangles"][0]["indices"]) for body in (still, moving)]
    assert sum(counts) == 3 * len(rest_shape(recording, "tissue")[1]) and min(counts) > 0


def test_arrows_show_size_and_direction_of_the_force_at_the_foot_point(recording, exported):
    contacts = {message.time: message for message in recording.messages("contact")}
    shown = told(exported, "/contact/arrow")
    assert max(contacts[time].force for _, time, _ in shown) > 0.0
    for _, time, body in shown:
        contact = contacts[time]
        arrows = body["entities"][0]["arrows"]
        assert bool(arrows) == (LENGTH * contact.force >= 1e-6)
        for one in arrows:
            turn = Rotation.from_quat([one["pose"]["orientation"][axis] for axis in "xyzw"])
            drawn = turn.apply([one["shaft_length"] + one["head_length"], 0.0, 0.0])
            assert drawn == pytest.approx(LENGTH * contact.force * np.array(contact.normal), abs=1e-9)
            assert [one["pose"]["position"][axis] for axis in "xyz"] == pytest.approx(contact.foot, abs=1e-6)


def test_any_direction_can_be_pointed_at():
    for way in (*np.eye(3), *-np.eye(3), np.array([-1.0, 1e-9, 0.0]), np.array([0.3, -0.5, 0.2])):
        (one,) = arrow(0, "force", np.zeros(3), way, "#000000", {})["entities"][0]["arrows"]
        turn = Rotation.from_quat([one["pose"]["orientation"][axis] for axis in "xyzw"])
        assert turn.apply([np.linalg.norm(way), 0.0, 0.0]) == pytest.approx(way, abs=1e-6)


def test_the_finger_is_a_frame_of_the_world(recording, exported):
    poses = {message.time: message.position for message in recording.messages("finger")}
    shown = told(exported, "/finger/frame")
    assert len(shown) > 2
    for name, time, body in shown:
        (moved,) = body["transforms"]
        assert name == "foxglove.FrameTransforms"
        assert (moved["parent_frame_id"], moved["child_frame_id"]) == ("world", "finger")
        assert [moved["translation"][axis] for axis in "xyz"] == pytest.approx(poses[time], abs=1e-6)


def test_foxgloves_own_library_takes_every_message_of_the_scene(exported):
    types = pytest.importorskip("foxglove.messages", reason="foxglove-sdk is not installed")
    lists = {
        "entities": "SceneEntity", "arrows": "ArrowPrimitive", "triangles": "TriangleListPrimitive", "points": "Point3",
        "colors": "Color", "metadata": "KeyValuePair", "transforms": "FrameTransform",
    }  # fmt: skip
    parts = {
        "timestamp": "Timestamp", "lifetime": "Duration", "pose": "Pose", "position": "Vector3", "color": "Color",
        "orientation": "Quaternion", "translation": "Vector3", "rotation": "Quaternion",
    }  # fmt: skip

    def made(name: str, body: dict) -> object:
        """TypeError: a field that the type does not have, or one of another type."""
        given = {}
        for key, value in body.items():
            if isinstance(value, list) and value and isinstance(value[0], dict):
                value = [made(lists[key], one) for one in value]
            elif isinstance(value, dict):
                value = made(parts[key], value)
            given[key] = value
        return getattr(types, name)(**given)

    count = 0
    for topic in ("/tissue/surface", "/tissue/still", "/contact/arrow", "/controller/arrow", "/finger/frame"):
        for name, _, body in told(exported, topic):
            assert made(name.removeprefix("foxglove."), body).encode()  # type: ignore[attr-defined]
            count += 1
    assert count > 10


def test_every_schema_is_one_that_foxglove_can_read(exported):
    """Objects have properties, lists hold no lists."""

    def readable(schema: dict) -> None:
        if schema["type"] == "object":
            for part in schema["properties"].values():
                readable(part)
        elif schema["type"] == "array":
            assert schema["items"]["type"] != "array"
            readable(schema["items"])

    with open(exported, "rb") as file:
        schemas = make_reader(file).get_summary().schemas.values()
    assert {"foxglove.SceneUpdate", "foxglove.FrameTransforms", "palpate.Load"} <= {one.name for one in schemas}
    for one in schemas:
        readable(json.loads(one.data))


def test_a_body_that_cannot_be_made_here_leaves_the_numbers_and_says_so(recording, tmp_path, monkeypatch):
    from palpate.records.export import shape
    from palpate.records.stored import RecordingError

    def gone(_: Recording) -> None:
        raise RecordingError(f"{TOUCH}: mylab.Liver cannot be imported")

    monkeypatch.setattr(shape, "plan_of", gone)
    notes: list[str] = []
    (path,) = export(recording, "foxglove", tmp_path / "a.mcap", tell=notes.append)
    assert notes == ["no shape of 'tissue', only its numbers: mylab.Liver cannot be imported"]
    assert len(told(path, "/tissue")) == len(list(recording.messages("tissue")))
    assert told(path, "/tissue/surface") == [] and told(path, "/contact/arrow")


def test_the_command_says_what_it_could_not_draw(tmp_path, monkeypatch):
    monkeypatch.setattr("palpate.records.export.shape.plan_of", lambda _: _Meshless())
    result = CliRunner().invoke(
        app, ["export", str(TOUCH), "--to", "foxglove", "--out", str(tmp_path / "a.mcap")], env={"COLUMNS": "200"}
    )
    assert result.exit_code == 0, result.output
    assert re.search(r"no shape of 'tissue'.* has no mesh to draw", result.output)


class _Meshless:
    def make(self, _: str) -> object:
        return object()
