"""`--organ`: a mesh file instead of the scene's organ; its faults, its repair, and a touch."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.models.build.repair import repair_mesh
from palpate.nodes.base import SettingError
from palpate.nodes.base.mesh_file import flaws
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.geometry.mesh import Mesh, heights, plane, summit
from palpate.views.page.steered import steer_launch
from palpate.views.run import Run

trimesh = pytest.importorskip("trimesh")

SCANNER = np.array([30.0, -200.0, 1150.0])
"""[mm] Position of a liver in a scanner's coordinates."""


@pytest.mark.parametrize("name", ["organ.stl", "organ.obj", "organ.ply"])
def test_a_file_that_claims_gigabytes_is_rejected_before_reading(tmp_path, monkeypatch, name):
    file = tmp_path / name
    with file.open("wb") as out:
        out.write(b"solid".ljust(80) + (60_000_000).to_bytes(4, "little"))
        out.truncate(3_000_000_084)
    monkeypatch.setattr(Path, "read_bytes", lambda *_: pytest.fail("it was read"))
    with pytest.raises(SettingError, match=r"has 3000 MB, expected at most 268 MB"):
        flaws(str(file))


def ball(radius=1.0, subdivisions=3, centre=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    mesh.apply_translation(centre)
    return mesh


def liver(subdivisions=3):
    """Closed, 200 x 130 x 85 mm: a thick right lobe and a thin left one."""
    mesh = ball(subdivisions=subdivisions)
    x, y, z = mesh.vertices.T
    thick = 1.0 - 0.35 * x
    vertices = np.stack([100.0 * x, 65.0 * y * np.sqrt(thick), 42.0 * z * thick], axis=1) + SCANNER
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def opened():
    """The liver without its underside."""
    mesh = liver()
    return trimesh.Trimesh(mesh.vertices, mesh.faces[mesh.triangles_center[:, 2] > SCANNER[2] - 20.0], process=False)


def inside_out():
    return trimesh.Trimesh(liver().vertices, liver().faces[:, ::-1], process=False)


def half_turned():
    faces = liver().faces.copy()
    faces[::3] = faces[::3, ::-1]
    return trimesh.Trimesh(liver().vertices, faces, process=False)


def crossing():
    """Two overlapping balls, like two segments of a scan."""
    return trimesh.util.concatenate([ball(40.0, 1), ball(30.0, 1, (35.0, 0.0, 0.0))])


def saved(folder, mesh, name="liver.stl"):
    mesh.export(folder / name)
    return folder / name


def bare(mesh):
    return Mesh(np.array(mesh.vertices) * 1e-3, np.array(mesh.faces, dtype=np.int32))


def test_the_height_is_that_of_the_highest_triangle_at_a_position():
    flat = plane(0.1, 400)
    tilted = Mesh(flat.vertices @ np.array([[1.0, 0, 0.5], [0, 1, -0.2], [0, 0, 1]]), flat.triangles)
    both = Mesh(
        np.concatenate([tilted.vertices, flat.vertices - (0, 0, 1.0)]),
        np.concatenate([tilted.triangles, flat.triangles[:, ::-1] + len(flat.vertices)]),
    )
    places = np.array([[0.01, 0.02], [-0.05, 0.05], [0.033, -0.041], [0.051, 0.0]])
    found = heights(both, places)
    assert found[:3] == pytest.approx((places @ [0.5, -0.2])[:3], abs=1e-12)
    assert np.isnan(found[3])


def test_the_top_is_wide_enough_for_a_finger():
    """A spike is higher, but is not the top."""
    body, spike = bare(ball(50.0)), bare(ball(1.0, 1, (20.0, 0.0, 60.0)))
    both = Mesh(
        np.concatenate([body.vertices, spike.vertices]),
        np.concatenate([body.triangles, spike.triangles + len(body.vertices)]),
    )
    assert both.vertices[:, 2].max() > 0.06
    assert summit(both, 8e-3) == pytest.approx([0.0, 0.0, 0.05], abs=1e-3)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (opened, "is open"),
        (inside_out, "is inside out: all of its 1280 triangles face inwards"),
        (half_turned, "is partly inside out: 427 of its 1280 triangles"),
        (crossing, "intersects itself, first seen at"),
    ],
)
def test_a_flaw_is_an_error_of_one_line_and_repair_removes_it(tmp_path, make, text):
    file = saved(tmp_path, make())
    *pieces, line = flaws(str(file))
    assert ["2 separate pieces" in each for each in pieces] == [True] * (make is crossing)
    assert text in line and str(file) in line and "\n" not in line
    fixed, done = repair_mesh(file, "mm")
    assert done and fixed != file
    assert flaws(str(fixed)) == []
    volume = 1e9 * trimesh.load(fixed).volume
    # the intersection of the two balls counts once
    assert 0.8 * abs(make().volume) < volume < 1.1 * abs(liver().volume if make is not crossing else make().volume)


def test_an_unfinished_check_for_intersections_is_reported(tmp_path, monkeypatch):
    file = saved(tmp_path, ball(41.0))
    monkeypatch.setattr("palpate.physics.geometry.crossing.MOST", 10)
    (line,) = flaws(str(file))
    assert "it is not checked completely whether it intersects itself: it has 1280 triangles" in line


def test_a_sound_mesh_is_not_changed(tmp_path):
    file = saved(tmp_path, liver())
    assert flaws(str(file)) == []
    assert repair_mesh(file, "mm") == (file, [])


def test_edges_with_three_triangles_are_repaired(tmp_path):
    """The mesh has a flap in the middle of a ball."""
    mesh = ball(40.0, 1)
    a, b = mesh.faces[0][:2]
    vertices = np.concatenate([mesh.vertices, [[0.0, 0.0, 0.0]]])
    file = saved(
        tmp_path, trimesh.Trimesh(vertices, np.concatenate([mesh.faces, [[a, b, len(vertices) - 1]]]), process=False)
    )
    fixed, _ = repair_mesh(file, "mm")
    assert flaws(str(fixed)) == []


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "mm"), (1e-3, "m")])
def test_the_only_plausible_unit_is_used(tmp_path, scale, unit):
    mesh = liver()
    mesh.apply_scale(scale)
    assert OrganFile(saved(tmp_path, mesh)).in_unit() == unit


@pytest.mark.parametrize(
    ("across", "unit", "text"),
    [
        (200.0, "m", r"in m it is 2e\+05 mm across.*--unit mm \(200 mm across\)"),
        (0.2, "mm", r"in mm it is 0.2 mm across.*--unit m \(200 mm across\)"),
        (11.0, None, r"several are plausible: --unit cm \(110 mm across\) or --unit mm \(11 mm across\)"),
        (5e4, None, "implausible in every unit"),
        (200.0, "furlong", "unit 'furlong' is unknown; expected a length"),
    ],
)
def test_a_wrong_or_missing_unit_is_an_error_with_the_plausible_units(tmp_path, across, unit, text):
    file = saved(tmp_path, ball(across / 2, 1))
    with pytest.raises(MeshError, match=text) as caught:
        OrganFile(file, unit).in_unit()
    assert "\n" not in str(caught.value)


def test_a_file_of_the_kidney_gives_the_same_touch(tmp_path):
    mesh = surface_mesh("kidney", 3000)
    far = trimesh.Trimesh(mesh.vertices * 1e3 + SCANNER, mesh.triangles, process=False)
    launch = find("kidney").but(overrides=("scene.surface.refine=0",))
    changed = launch.but(organ=OrganFile(saved(tmp_path, far, "kidney.stl"), "mm")).settle_organ()
    before, after = (one.load().nodes["device"].settings for one in (launch, changed))
    for old, new in zip(before["path"], after["path"], strict=True):
        if old["to"] is not None:
            assert new["to"] == pytest.approx(old["to"], abs=2e-3)
        assert (old["time"], old["hold"]) == (new["time"], new["hold"])


def test_a_small_ball_gets_a_narrower_path_on_its_surface(tmp_path):
    launch = find("kidney").but(organ=OrganFile(saved(tmp_path, ball(20.0)), "mm")).settle_organ()
    (text,) = launch.notes
    graph = launch.load()
    surface, hand = graph.scene["surface"], graph.scene["hand"]
    points = np.array([hand["begin"], *(s["to"] for s in hand["path"] if "to" in s)])
    placed = surface_mesh(surface["surface"], 0, tuple(surface["position"]), file_unit="mm")
    assert 0.002 < np.abs(points[:, 0]).max() < 0.02
    assert np.isfinite(heights(placed, points[:, :2])).all()
    assert "% as wide as on kidney" in text


def test_the_rotation_of_the_scene_is_kept(tmp_path):
    launch = find("kidney").but(overrides=("scene.surface.rotation=[0, 1.5707963, 0]", "scene.surface.refine=0"))
    changed = launch.but(organ=OrganFile(saved(tmp_path, liver()), "mm")).settle_organ()
    surface = changed.load().scene["surface"]
    placed = surface_mesh(surface["surface"], 0, tuple(surface["position"]), tuple(surface["rotation"]), "mm")
    # the thin lobe at +x is at the bottom; the former left end is now the top
    assert np.ptp(placed.vertices, axis=0)[2] == pytest.approx(0.2, abs=1e-3)
    assert placed.vertices[:, 2].max() == pytest.approx(0.105, abs=1e-3)
    (text,) = changed.notes
    assert "200 mm" in text.split(";")[0]


def test_a_graph_without_a_surface_is_an_error(tmp_path):
    with pytest.raises(MeshError, match=r"softness has no scene\.surface"):
        find("softness").but(organ=OrganFile(saved(tmp_path, liver()), "mm")).settle_organ()


def run(*words):
    return CliRunner().invoke(app, [str(w) for w in words])


def test_one_command_from_a_mesh_to_a_touch(tmp_path, monkeypatch):
    """The hand presses as deep into the liver as into the kidney; the notes include the flaw of the file."""
    monkeypatch.chdir(tmp_path)
    saved(tmp_path, inside_out())
    common = ["--fused", "--duration", "1 s", "--json", "--no-pictures", "--set", "scene.surface.refine=4 mm"]
    outcome = run("run", "kidney", "--organ", "liver.stl", "--unit", "mm", "--out", "own", *common)
    assert outcome.exit_code == 0, outcome.output
    data = json.loads(outcome.stdout)
    assert any("inside out" in note for note in data["notes"]) and any("its top lies" in note for note in data["notes"])
    assert run("run", "kidney", "--out", "shipped", *common).exit_code == 0
    own, shipped = Run(tmp_path / "own" / "liver.mcap"), Run(tmp_path / "shipped" / "kidney.mcap")
    force, expected = (np.asarray(one.contact.force).max() for one in (own, shipped))
    assert force == pytest.approx(expected, rel=0.05) and expected > 1.0


def test_unit_and_repair_need_an_organ():
    assert "--organ FILE" in run("run", "kidney", "--unit", "mm").output
    assert "--organ FILE" in run("run", "kidney", "--repair").output


def test_the_unit_of_a_file_is_a_value_of_the_scene(tmp_path):
    """The remedy in the message about an implausible size works."""
    file = saved(tmp_path, liver())
    launch = find("kidney").but(
        overrides=(f"scene.surface.surface={file}", "collision.use=collision.Mesh", "scene.surface.file_unit=mm")
    )
    assert launch.load().nodes["collision"].settings["file_unit"] == "mm"


def test_the_mouse_touches_a_custom_organ(tmp_path):
    """The path along the organ belongs to the simulated hand, which the page replaces."""
    launch = find("kidney").but(overrides=("scene.surface.refine=0",))
    launch = launch.but(organ=OrganFile(saved(tmp_path, liver()), "mm")).settle_organ()
    planned = steer_launch(launch, tmp_path)[0].plan()
    begin = launch.plan().graph.nodes["device"].settings["begin"]
    assert planned.graph.nodes["device"].settings["begin"] == begin
    assert str(tmp_path / "liver.stl") in str(planned.graph.nodes["collision"].settings["surface"])


CONTENTS = {"short.stl": b"this is not a mesh at", "text.obj": b"a letter\n" * 900, "head.ply": b"\0\1\2\3" * 20}


def test_a_file_that_cannot_be_an_organ_is_refused_before_a_library_is_imported(tmp_path):
    for name, content in CONTENTS.items():
        (tmp_path / name).write_bytes(content)
    script = f"""
import sys
from pathlib import Path
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.nodes.base import SettingError
for name in {[*CONTENTS, "missing.stl"]}:
    try:
        find("kidney").but(organ=OrganFile(Path(name))).load()
    except SettingError as error:
        print(name, name in str(error))
print(sorted({{"numba", "scipy", "trimesh", "manifold3d", "skimage"}} & sys.modules.keys()))
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    *refused, imported = done.stdout.splitlines()
    assert done.returncode == 0, done.stderr
    assert refused == [f"{name} True" for name in [*CONTENTS, "missing.stl"]] and imported == "[]"
