"""The folder of `palpate build web`: its files, its errors, the library in it, and its recordings."""

import json
import re
import shutil

import in_node
import numpy as np
import pytest
from mcap.reader import make_reader
from typer.testing import CliRunner

from palpate.cli.__main__ import app

runner = CliRunner()
DEPTH = 0.03  # [m] of the target below the start


def press(folder, depth=DEPTH, file="page.mcap", **options):
    """What a program in Node finds while it presses with the folder `site`."""
    return in_node.run_script(folder, "press_in_node.mjs", json.dumps(options), depth, file)


def refused(folder, **options):
    """The error of a program that loads the folder `site`."""
    return in_node.run_script(folder, "load_in_node.mjs", json.dumps(options))


def build(out, *options):
    return runner.invoke(app, ["build", "web", *options, "-o", str(out), "--json"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder for the kidney with one body, and what the command prints."""
    out = tmp_path_factory.mktemp("web") / "site"
    done = build(out, "kidney", "--body", "MassSpring", "--set", "tissue.stiffness=2e3")
    assert done.exit_code == 0, done.output
    return out, json.loads(done.stdout)


@pytest.fixture(scope="module")
def pressed(site):
    """What a program in Node finds, and the folder with its recording."""
    out, _ = site
    return press(out.parent), out.parent


def test_the_files_are_few_small_and_named_after_their_content(site):
    out, told = site
    assert told["variants"] == 4 + 2 and told["left_out"] == {} and told["code"] < 80_000 and told["first"] < 3e6
    assert told["whole"] == sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    names = {file.name for file in out.iterdir()}
    assert names == {"index.html", "page.js", "page.css", "site.js", "data", "palpate.mjs", "palpate.d.mts"}
    assert all(re.fullmatch(r"[0-9a-f]{64}\.js", file.name) for file in (out / "data").iterdir())
    page = (out / "index.html").read_text()
    assert "default-src 'none'" in page and "http" not in page.replace("http-equiv", "")
    assert not re.search(r"\beval\(|new Function|import\(", (out / "page.js").read_text())


def test_data_that_the_same_variants_need_are_one_file(site):
    out, _ = site
    text = (out / "site.js").read_text()
    listed = [one["files"] for one in json.loads(text[text.index("{") : text.rindex("}") + 1])["variants"]]
    users = {file: tuple(file in files for files in listed) for files in listed for file in files}
    assert len(set(users.values())) == len(users) and {file.stem for file in (out / "data").iterdir()} == set(users)
    assert (True,) * len(listed) in users.values() and max(map(len, listed)) <= 8


def test_equal_runs_have_equal_memory(site, tmp_path):
    out, _ = site
    assert build(tmp_path / "site", "kidney", "--body", "MassSpring", "--set", "tissue.stiffness=2e3").exit_code == 0
    again = {file.name for file in (tmp_path / "site" / "data").iterdir()}
    other = [file.name for file in (out / "data").iterdir() if file.name not in again]
    assert len(other) <= 6  # the descriptions of the variants, which contain a date


def test_a_program_presses_the_organ(pressed):
    found, _ = pressed
    forces = np.array(found["forces"])
    assert forces[:150].max() == 0.0 and forces[600:1290].min() > 0.2 and forces[-1] == 0.0
    assert found["displacement"] == 3 * found["nodes"]
    assert found["vertices"] == found["normals"] == found["largest"] + 1
    assert found["again"] > 0.2 and found["time"] == 0.5
    assert found["body"] == "deformation.MassSpring" and found["effects"] == {"friction": True, "relaxation": True}


def test_the_recording_is_replayed_bit_for_bit(pressed):
    _, folder = pressed
    done = runner.invoke(app, ["replay", str(folder / "page.mcap"), "--check", "--json"])
    assert done.exit_code == 0 and json.loads(done.stdout)["ok"], done.stdout
    with (folder / "page.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        counts = reader.get_summary().statistics.channel_message_counts
        assert sorted(set(counts.values())) == [8, 1500]
        assert sum(1 for _ in reader.iter_messages()) == sum(counts.values())


def test_a_touch_with_another_pointer_has_other_forces(pressed):
    """The check can fail."""
    _, folder = pressed
    press(folder, DEPTH + 1e-3, "other.mcap")
    with (folder / "page.mcap").open("rb") as one, (folder / "other.mcap").open("rb") as other:
        first, second = (
            [message.data for _, channel, message in make_reader(file).iter_messages() if channel.topic == "contact"]
            for file in (one, other)
        )
    assert first[0] == second[0] and first[5] != second[5]


def test_a_node_that_fails_is_named_and_the_others_wait(site):
    out, _ = site
    found = in_node.run_script(out.parent, "fail_in_node.mjs")
    failed = found["failed"]
    assert not found["went"] and not found["again"] and found["stands"] and found["time"] == failed["tick"] / 1000
    assert failed["why"] == "its kernel failed" and failed["node"] == "device"
    assert found["afresh"] is None and found["steps"]


def test_time_that_is_left_out_is_replayed_as_on_the_real_clock(site):
    """The contact force after it is at most 1.2 times that before, the bound of docs/time.md for outages."""
    out, _ = site
    found = in_node.run_script(out.parent, "skip_in_node.mjs", 0.2, "late.mcap")
    forces, hand = np.array(found["forces"]), np.array(found["hand"])
    assert found["time"] == 2.2 and forces[790] > 1.0 and forces[-1] == 0.0
    assert forces[800:].max() <= 1.2 * forces[:800].max() and hand.max() <= 9.0 * (1 + 1e-9)
    done = runner.invoke(app, ["replay", str(out.parent / "late.mcap"), "--check", "--json"])
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and told["ok"] and all(node["checked"] for node in told["nodes"].values()), done.stdout


def test_the_page_reads_its_recording_and_compares_the_messages(site):
    out, _ = site
    in_node.run_script(out.parent, "skip_in_node.mjs", 0.2, "late.mcap")
    (out.parent / "replay.mjs").write_text((in_node.STATIC / "replay.js").read_text())
    found = in_node.run_script(out.parent, "read_in_node.mjs", "late.mcap")
    variants = json.loads((out / "site.js").read_text().split("= ", 1)[1].rstrip(";\n"))["variants"]
    assert found["program"] in [one["program"] for one in variants if one["first"]]
    assert len({one["program"] for one in variants}) == len(variants)
    with (out.parent / "late.mcap").open("rb") as file:
        counts = make_reader(file).get_summary().statistics.channel_message_counts
    checks = found["messages"] - 2000
    assert found["messages"] == sum(counts.values()) and found["ticks"] == 2200
    assert found["whole"]["outcome"] == f"replayed: all {checks} compared messages equal"
    assert found["whole"]["seen"] == 2000 and found["whole"]["skipped"] == [[800, 200]]
    assert found["changed"]["outcome"] == f"replayed: {checks} of {checks} messages differ"
    assert found["cut"] == found["foreign"] == "the file is damaged or no recording"


@pytest.mark.parametrize("case", ["stiff", "stab"])
def test_a_hard_case_stays_finite_and_within_the_limit_of_the_controller(site, case):
    out, _ = site
    found = in_node.run_script(out.parent, "press_hard_in_node.mjs", case)
    hand, contact = np.array(found["hand"]), np.array(found["forces"])
    usual = press(out.parent, file="usual.mcap")["forces"]
    assert np.isfinite(hand).all() and np.isfinite(contact).all() and found["failed"] is None
    assert found["limit"] == 9.0 and 0.5 < hand.max() <= 9.0 * (1 + 1e-9)
    assert contact.max() > 1.5 * max(usual) and hand[-1] == 0.0


@pytest.mark.parametrize("damage", ["flip", "cut", "swap"])
def test_a_damaged_folder_is_refused(site, tmp_path, damage):
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
    assert re.match(rf"data/{files[0].stem}\.js: ", refused(tmp_path))


def test_another_variant_is_loaded_by_its_effects_and_an_unknown_one_is_refused(site):
    out, _ = site
    found = press(out.parent, file="free.mcap", effects={"friction": False})
    assert found["effects"] == {"friction": False, "relaxation": True} and max(found["forces"]) > 0.2
    assert "no such variant; this folder has deformation.MassSpring" in refused(out.parent, body="Rigid")
    assert refused(out.parent) is None


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


@pytest.mark.long
def test_an_effect_that_the_graph_needs_is_not_offered(tmp_path):
    """The texture is drawn by friction, so that the graph without friction is refused."""
    assert build(tmp_path / "site", "texture", "--body", "MassSpring").exit_code == 0
    found = press(tmp_path)
    assert found["effects"] == {"friction": True, "relaxation": True} and max(found["forces"]) > 0.2
    assert "no such variant" in refused(tmp_path, effects={"friction": False})
    assert refused(tmp_path, effects={"relaxation": False}) is None


def test_a_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "letter.txt").write_text("dear")
    done = runner.invoke(app, ["build", "web", "kidney", "-o", str(tmp_path)])
    assert done.exit_code == 2 and "is not empty, expected a new or empty folder" in done.output
    assert [file.name for file in tmp_path.iterdir()] == ["letter.txt"]
    done = runner.invoke(app, ["build", "web", "kidney", "-o", str(tmp_path / "letter.txt")])
    assert done.exit_code == 2 and "is a file" in done.output
