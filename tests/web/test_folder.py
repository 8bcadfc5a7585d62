"""The folder of `palpate build web`: its files, its errors, the library in it, and its recordings."""

import json
import re

import in_node
import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from palpate.cli.__main__ import app

runner = CliRunner()
PRESS = """
    import fs from "fs"; import { load } from "./site/palpate.mjs";
    const read = (name) => fs.promises.readFile(`site/${name}`, "utf-8"), touch = await load(read, OPTIONS);
    const begin = touch.about.pointers[0].begin, down = [begin[0], begin[1], begin[2] - 0.03], forces = [];
    for (let k = 0; k < 1500; k++) {
      if (k % 20 === 0) touch.point(k < 200 || k > 1300 ? begin : down);
      if (!touch.step()) throw new Error(JSON.stringify(touch.failed));
      forces.push(touch.contact().load);
    }
    fs.writeFileSync("page.mcap", new Uint8Array(await touch.recording().arrayBuffer()));
    const { nodes, displacement } = touch.surface();
    touch.begin(); touch.point(down); touch.step(0.5);
    console.log(JSON.stringify({ forces, nodes: nodes.length, displacement: displacement.length, vertices: touch.mesh.vertices.length / 3,
      normals: touch.mesh.normals.length / 3, again: touch.contact().load, time: touch.time, effects: touch.effects, body: touch.body,
      largest: Math.max(...touch.mesh.triangles) }));
"""


def build(out, *options):
    return runner.invoke(app, ["build", "web", *options, "-o", str(out), "--json"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder for the kidney with one body."""
    out = tmp_path_factory.mktemp("web") / "site"
    done = build(out, "kidney", "--body", "MassSpring", "--set", "tissue.stiffness=2e3")
    assert done.exit_code == 0, done.output
    return out, json.loads(done.stdout)


@pytest.fixture(scope="module")
def pressed(site):
    """What a program in Node finds, and the folder with its recording."""
    out, _ = site
    return in_node.run_script(out.parent, PRESS.replace("OPTIONS", "{}")), out.parent


def test_the_files_are_few_small_and_named_after_their_content(site):
    out, told = site
    assert told["variants"] == 4 and told["left_out"] == {} and told["code"] < 80_000 and told["first"] < 3e6
    assert told["whole"] == sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    names = {file.name for file in out.iterdir()}
    assert names == {"index.html", "page.js", "page.css", "site.js", "data", "palpate.mjs", "palpate.d.mts"}
    assert all(re.fullmatch(r"[0-9a-f]{64}\.js", file.name) for file in (out / "data").iterdir())
    page = (out / "index.html").read_text()
    assert "default-src 'none'" in page and "http" not in re.sub(r"http-equiv", "", page)
    assert not re.search(r"\beval\(|new Function|import\(", (out / "page.js").read_text())


def test_equal_runs_have_equal_memory(site, tmp_path):
    out, _ = site
    assert build(tmp_path / "site", "kidney", "--body", "MassSpring", "--set", "tissue.stiffness=2e3").exit_code == 0
    memory = [file.name for file in (out / "data").iterdir()]
    again = {file.name for file in (tmp_path / "site" / "data").iterdir()}
    assert len([name for name in memory if name not in again]) <= 4  # the descriptions, which contain a date


def test_a_program_presses_the_organ(pressed):
    found, _ = pressed
    forces = np.array(found["forces"])
    assert forces[:150].max() == 0.0 and forces[600:1290].min() > 0.2 and forces[-1] == 0.0
    assert found["displacement"] == 3 * found["nodes"] and found["vertices"] == found["normals"] == found["largest"] + 1
    assert found["again"] > 0.2 and found["time"] == 0.5
    assert found["body"] == "deformation.MassSpring" and found["effects"] == {"friction": True, "relaxation": True}


def test_the_recording_is_replayed_bit_for_bit(pressed):
    found, folder = pressed
    done = runner.invoke(app, ["replay", str(folder / "page.mcap"), "--check", "--json"])
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and told["ok"], done.stdout
    with (folder / "page.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        counts = reader.get_summary().statistics.channel_message_counts
        assert sorted(set(counts.values())) == [8, 1500] and sum(1 for _ in reader.iter_messages()) == sum(counts.values())


def test_a_recording_with_a_changed_sample_is_not_equal(pressed, tmp_path):
    """The check can fail: with another place of the pointer the forces differ."""
    _, folder = pressed
    text = PRESS.replace("OPTIONS", "{}").replace("begin[2] - 0.03]", "begin[2] - 0.031]").replace("page.mcap", "other.mcap")
    in_node.run_script(folder, text)
    with (folder / "page.mcap").open("rb") as one, (folder / "other.mcap").open("rb") as other:
        messages = [[m.data for _, c, m in make_reader(f).iter_messages() if c.topic == "contact"] for f in (one, other)]
    assert messages[0][0] == messages[1][0] and messages[0][5] != messages[1][5]


@pytest.mark.parametrize("damage", ["flip", "cut", "swap"])
def test_a_damaged_folder_is_refused(site, tmp_path, damage):
    import shutil

    out, _ = site
    shutil.copytree(out, tmp_path / "site")
    files = sorted((tmp_path / "site" / "data").iterdir(), key=lambda file: -file.stat().st_size)
    text = files[0].read_text()
    if damage == "flip":
        text = text[:-400] + ("A" if text[-400] != "A" else "B") + text[-399:]
    elif damage == "cut":
        text = text[:-400]
    else:
        text = text.replace(text[90:-4], files[1].read_text()[90:-4])
    files[0].write_text(text)
    script = PRESS.replace("OPTIONS", "{}").replace(", touch = await load(read, {});", ";")
    script = script[: script.index("const begin")] + """
        try { await load(read); console.log("1"); } catch (error) { console.log(JSON.stringify(error.message)); }"""
    assert re.search(rf"data/{files[0].stem}\.js: ", in_node.run_script(tmp_path, script))


def test_another_variant_is_loaded_by_its_effects_and_an_unknown_one_is_refused(site):
    out, _ = site
    found = in_node.run_script(out.parent, PRESS.replace("OPTIONS", "{ effects: { friction: false } }"))
    assert found["effects"] == {"friction": False, "relaxation": True} and max(found["forces"]) > 0.2
    script = """
        import fs from "fs"; import { load } from "./site/palpate.mjs";
        const read = (name) => fs.promises.readFile(`site/${name}`, "utf-8");
        try { await load(read, { body: "Rigid" }); } catch (error) { console.log(JSON.stringify(error.message)); }"""
    assert "no such variant; this folder has deformation.MassSpring" in in_node.run_script(out.parent, script)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["kidney", "--body", "Jelly"], "--body: found 'Jelly', expected one of .*MassSpring"),
        (["softness"], "softness: nodes that send DeviceState: found none"),
        (["kidney", "--set", "tissue.stifness=3"], "stifness"),
    ],
)
def test_what_cannot_be_built_is_an_error_of_one_line(options, why, tmp_path):
    done = runner.invoke(app, ["build", "web", *options, "-o", str(tmp_path / "site")])
    assert done.exit_code == 2 and re.search(why, done.output) and "Traceback" not in done.output
    assert not (tmp_path / "site").exists()


def test_a_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    done = runner.invoke(app, ["build", "web", "kidney", "-o", str(tmp_path)])
    assert done.exit_code == 2 and "is not empty, expected a new or empty folder" in done.output
    assert [file.name for file in tmp_path.iterdir()] == ["letter.txt"]
    done = runner.invoke(app, ["build", "web", "kidney", "-o", str(tmp_path / "letter.txt")])
    assert done.exit_code == 2 and "is a file" in done.output
