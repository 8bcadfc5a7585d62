"""Frames that the page makes are those of `views.page.feed`, from the same messages."""

import json

import in_node
import msgspec
import numpy as np
import pytest
from test_folder import build
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.messages import unpack
from palpate.physics.geometry.graded import NEIGHBOURS, fill_field, landmarks, ranges
from palpate.physics.geometry.mesh import Mesh
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.views.page.feed import kinds_of, picture
from palpate.views.page.steered import touched_part

TICK = 1200


def unpacked(data):
    """Head and arrays of a message to the page."""
    length = int.from_bytes(data[:4], "little")
    head, at, arrays = msgspec.json.decode(data[4 : 4 + length]), 4 + length, []
    for size, dtype in zip(head["sizes"], ("<u4", "<f4", "<f4"), strict=True):
        arrays.append(np.frombuffer(data, dtype, size, at))
        at += 4 * size
    assert at == len(data)
    return head, arrays


WAYS = {"pinch": [[0.002, 0.034, 0.004], [0.0, -0.034, 0.0]]}  # [m]
REDUCED = ["--set", "tissue.use=deformation.ReducedFE"]


@pytest.mark.parametrize(
    ("graph", "options"),
    [
        ("kidney", []),
        ("kidney", ["--scene", "breathing"]),
        pytest.param("kidney", REDUCED, marks=pytest.mark.long),
        pytest.param("pinch", ["--scene", "lift"], marks=pytest.mark.long),
        pytest.param("organs", [], marks=pytest.mark.long),
        pytest.param("palpate-two", [], marks=pytest.mark.long),
    ],
)
def test_a_frame_is_that_of_a_run_with_the_same_messages(graph, options, tmp_path):
    assert build(tmp_path / "site", graph, *options, "--body", "MassSpring").exit_code == 0
    assert in_node.run_script(tmp_path, "draw_in_node.mjs", TICK + 1, json.dumps(WAYS.get(graph, []))) is None
    replayed = CliRunner().invoke(app, ["replay", str(tmp_path / "page.mcap"), "--check", "--json"])
    assert replayed.exit_code == 0 and json.loads(replayed.stdout)["ok"], replayed.output
    recording = Recording(tmp_path / "page.mcap")
    touched = touched_part(plan_of(recording))
    newest = {}
    for stream, kind in kinds_of(touched).items():
        data = [payload for _, time, payload in recording.payloads(stream) if time == TICK * 10**6]
        newest[stream] = unpack(data[0], kind)
    if "lift" in options:
        assert np.linalg.norm(newest["foundation"].rotation) > 1e-3
    curves = [{"t": [], "f": [], "s": []} for _ in touched.fingers]
    expected, shapes = unpacked(picture({"kind": "frame", "late": 0}, newest, touched, curves))
    found, arrays = unpacked((tmp_path / "frame").read_bytes())
    for head in (expected, found):
        head["patch"] = sorted(zip(head.pop("patch"), head.pop("loads"), strict=True))
    assert list(flat(found)) == pytest.approx(list(flat(expected)), rel=1e-6, abs=2e-6)
    assert (
        np.array_equal(arrays[0], shapes[0]) and len(arrays[1]) == len(shapes[1]) and len(arrays[2]) == len(shapes[2])
    )
    assert np.allclose(arrays[1], shapes[1], atol=1e-5 * np.abs(shapes[1]).max()) and np.allclose(arrays[2], shapes[2])


def flat(head):
    """All numbers and words in a head, sorted by their names."""
    if isinstance(head, dict):
        for name in sorted(head):
            yield from flat(head[name])
    elif isinstance(head, list | tuple):
        for each in head:
            yield from flat(each)
    else:
        yield head if isinstance(head, int | float) and not isinstance(head, bool) else float(hash(str(head)) % 1000)


def test_the_surface_of_a_body_that_sends_a_sample_is_filled_as_in_python(tmp_path):
    """Under a finger that slides, by 1 mm a frame, then leaps: also where the shares of the frame before are kept."""
    rng = np.random.default_rng(2)
    points = np.stack([*rng.uniform(-0.04, 0.04, (2, 2500)), 0.002 * rng.normal(size=2500)], 1).astype(np.float32)
    fields, expected = [], []
    for step in (0.0, 1e-3, 2e-3, 1e-3, 30e-3):
        away = np.linalg.norm(points - points[7] - np.float32([step, 0.0, 0.0]), axis=1)
        nodes = np.flatnonzero(away <= ranges(points.astype(float), 0.008)).astype(np.int32)
        assert NEIGHBOURS < len(nodes) < 2000
        size = 1e-3 / (1 + 100 * away[nodes])
        moved = np.stack([size, points[nodes, 0] * 0.1, np.sin(50 * points[nodes, 1]) * 1e-3], 1)
        fields.append({"nodes": nodes.tolist(), "moved": moved.ravel().tolist()})
        expected.append(fill_field(points.astype(float), nodes, moved))
    given = {"points": points.ravel().tolist(), "fields": fields, "landmarks": landmarks(points.astype(float)).tolist()}
    (tmp_path / "given.json").write_text(json.dumps(given))
    (tmp_path / "fill.mjs").write_text((in_node.STATIC / "fill.js").read_text())
    found, some, searched, again = in_node.run_script(tmp_path, "fill_in_node.mjs")
    assert some is None
    for whole, right in zip([*found, again], [*expected, expected[0]], strict=True):
        assert np.abs(np.reshape(whole, (-1, 3)) - right).max() < 1e-5 * np.abs(right).max()
    between = [len(points) - len(field["nodes"]) for field in fields]
    assert searched[0] == searched[6] == between[0] and searched[5] == 0
    assert all(0 < searched[k] < 0.5 * between[k] for k in (1, 2, 3))


def test_the_mesh_has_the_form_that_the_page_reads():
    from palpate.views.page.feed import surface_frame

    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    head, arrays = unpacked(surface_frame(mesh, {}))
    assert head["kind"] == "mesh" and [len(array) for array in arrays] == [3, 9, 9]
