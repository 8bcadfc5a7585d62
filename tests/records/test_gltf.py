"""The organ of a recording as glTF with haptic materials."""

import base64
import json
import zlib
from pathlib import Path

import numpy as np
import pytest
from pytest import approx
from test_export import TOUCH

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.nodes.base.textured import WithTexture
from palpate.nodes.texture import Spectral
from palpate.records.export import export, gltf
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

SCHEMA = json.loads((Path(__file__).parent / "mpeg_haptic_material.schema.json").read_text())


def written(recording, path):
    (path,) = export(recording, "gltf", path)
    document = json.loads(path.read_text())
    jsonschema = pytest.importorskip("jsonschema")
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    jsonschema.Draft202012Validator(SCHEMA).validate(document)
    return path, document


def values(document, name):
    """Values (n) of a haptic property, from the pixels of its image."""
    (given,) = document["extensions"]["MPEG_haptic_material"]["materials"][0][name]
    view = document["bufferViews"][
        document["images"][document["textures"][given["texture"]["index"]]["source"]]["bufferView"]
    ]
    data = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    image = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    assert image.startswith(b"\x89PNG\r\n\x1a\n") and int.from_bytes(image[20:24]) == 1  # one row
    size = int.from_bytes(image[33:37])
    row = zlib.decompress(image[41 : 41 + size])
    assert row[0] == 0 and len(row) == 1 + 2 * int.from_bytes(image[16:20])
    level = np.frombuffer(row[1:], ">u2") / 65535.0
    return given["extras"]["offset"] + given["extras"]["scale"] * level, given


@pytest.fixture(scope="module")
def stroked(tmp_path_factory):
    path = tmp_path_factory.mktemp("gltf") / "texture.mcap"
    given = find("texture").but(duration=0.2, record=path, place="fused", overrides=("scene.surface.vertices=400",))
    assert execute(given).result.ok
    return Recording(path)


def test_places_have_the_bounds_that_the_format_requires(tmp_path):
    _, document = written(Recording(TOUCH), tmp_path / "a.gltf")
    (primitive,) = document["meshes"][0]["primitives"]
    given = document["accessors"][primitive["attributes"]["POSITION"]]
    view = document["bufferViews"][given["bufferView"]]
    data = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    places = np.frombuffer(data, "<f4", 3 * given["count"], view["byteOffset"]).reshape(-1, 3)
    assert given["min"] == places.min(axis=0).tolist() and given["max"] == places.max(axis=0).tolist()


def test_stiffness_and_friction_are_those_of_the_graph(tmp_path):
    _, document = written(Recording(TOUCH), tmp_path / "a.gltf")
    (stiffness,), given = values(document, "stiffness")
    assert stiffness == approx(257.0) and given["extras"]["unit"] == "N/m" and given["type"] == "Low_Resolution"
    (friction,), _ = values(document, "friction")
    assert friction == approx(0.5)
    assert "vibrotactileTexture" not in document["extensions"]["MPEG_haptic_material"]["materials"][0]


def test_other_software_reads_the_mesh(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path, _ = written(Recording(TOUCH), tmp_path / "a.gltf")
    mesh = plan_of(Recording(TOUCH)).make("tissue").mesh()
    (read,) = trimesh.load(path, process=False).dump()
    x, y, z = mesh.vertices.T
    assert read.vertices == approx(np.column_stack([x, z, -y]), abs=1e-6)  # y upward
    assert np.array_equal(read.faces, mesh.triangles)
    assert read.vertex_normals[:, 1] == approx(mesh.normals[:, 2], abs=1e-5)


def test_the_texture_is_a_period_of_the_fluctuation(stroked, tmp_path):
    _, document = written(stroked, tmp_path / "a.gltf")
    pattern, given = values(document, "vibrotactileTexture")
    node = plan_of(stroked).make("texture")
    assert isinstance(node, Spectral)
    table, spacing = node.period()
    assert pattern == approx(table[::4], abs=1e-5 * np.ptp(table)) and given["type"] == "High_Resolution"
    assert given["extras"]["length [m]"] == approx(len(table) * spacing)
    assert pattern.std() == approx(node.roughness, rel=0.02)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        ({"out": TOUCH}, "is the recording itself"),
        ({"streams": ["contact"]}, "no stream of Surface"),
        ({"every": 2}, "needs every message"),
    ],
)
def test_bad_input_is_refused(what, says):
    with pytest.raises(RecordingError, match=says):
        export(Recording(TOUCH), "gltf", **what)


def test_a_texture_that_does_not_fit_an_image_is_refused(stroked, tmp_path, monkeypatch):
    monkeypatch.setattr(gltf, "WIDEST", 100)
    with pytest.raises(RecordingError, match="expected at most 400, with a narrower range"):
        export(stroked, "gltf", tmp_path / "a.gltf")
    monkeypatch.delattr(WithTexture, "period")  # as texture.Autoregressive, which has no place on the surface
    with pytest.raises(RecordingError, match=r"no pattern over the surface .* expected texture.Spectral"):
        export(stroked, "gltf", tmp_path / "a.gltf")
    assert not list(tmp_path.iterdir())


def test_a_schema_violation_is_found(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    _, document = written(Recording(TOUCH), tmp_path / "a.gltf")
    document["extensions"]["MPEG_haptic_material"]["materials"][0]["stiffness"][0]["type"] = "Constant"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, SCHEMA)
