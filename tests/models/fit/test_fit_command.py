"""`palpate fit force` as a user runs it."""

import json

import numpy as np
import pytest
import yaml
from pytest import approx
from scipy.stats import t as student
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.messages import Contact
from palpate.models.fit.fit import DEPTHS, synthetic_sessions
from palpate.nodes.contact.probabilistic import Probabilistic
from palpate.physics.contact.force_models import MODELS

HEAD = "subject,session,depth [mm],force [N]"


def run(*arguments, pictures=False):
    given = [*map(str, arguments), *["--no-pictures"] * (not pictures)]
    return CliRunner(env={"COLUMNS": "200"}).invoke(app, ["fit", "force", *given])


def write(path, forces, depths=DEPTHS, subject="a"):
    rows = [
        f"{subject},{s + 1},{d * 1e3!r},{float(f)!r}"
        for s, row in enumerate(forces)
        for d, f in zip(depths.tolist(), row, strict=True)
    ]
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    return path


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    path = tmp_path_factory.mktemp("fit") / "sessions.csv"
    assert run("--example", path).exit_code == 0
    return path


@pytest.fixture(scope="module")
def fitted(example):
    """The JSON output for the example, and the path of the file that is written."""
    out = example.parent / "model.yaml"
    return json.loads(run(example, "--json", "--out", out).stdout), out


def test_the_example_is_marked_as_synthetic_and_can_be_fitted(example):
    assert example.read_text().startswith("# Synthetic sessions, not measurements")
    result = run(example)
    assert result.exit_code == 0, result.stderr
    for text in ("RMSE of the force on validation sessions [mN]", "fourier", "average", "omega [1/m]", "95 % interval"):
        assert text in result.stdout
    rows = [line for line in result.stdout.splitlines() if line.startswith("│ A ")]
    assert all(row.count("*") == 1 for row in rows[:5])  # the smallest is marked in each of the five tables


def test_the_node_reads_the_written_file(fitted):
    data, out = fitted
    for subject in ("A", "B"):
        node = Probabilistic(model=str(out), subject=subject)
        printed = data["subjects"][subject]
        assert node.mean == printed["mean"]["model"] and node.depth_limit == approx(5e-3)
        assert node.mean_parameters == approx([p["value"] for p in printed["mean"]["parameters"].values()], rel=1e-15)
        assert list(yaml.safe_load(out.read_text())["subjects"]) == ["A", "B"]


def test_json_holds_folds_errors_and_intervals(fitted):
    data = fitted[0]["subjects"]["A"]
    assert len(data["folds"]) == 9
    assert [len(data["folds"][0][k]) for k in ("train", "validation", "test")] == [14, 3, 3]
    assert data["protocol"] == "whole" and data["dropped_sessions"] == {} and data["band"]["freedom"] >= 19
    assert set(data["force_rmse"]) == set(data["deviation_rmse"]) == set(MODELS)
    for p in data["mean"]["parameters"].values():
        assert p["interval"][0] < p["value"] < p["interval"][1] and p["error"] > 0 and p["unit"]


def test_noise_free_sessions_recover_the_coefficients(tmp_path):
    known = (1.31, -1.29, 0.33, 511.7)
    path = write(tmp_path / "s.csv", np.tile(MODELS["fourier"](DEPTHS, known), (20, 1)))
    result = run(path)
    assert result.exit_code == 0 and "do not scatter" in result.stdout
    node = Probabilistic(model=str(path.with_suffix(".model.yaml")))
    assert node.mean_parameters == approx(known, rel=1e-6) and node.deviation_parameters == (0.0, 0.0)


def test_two_runs_write_the_same_bytes(example, fitted, tmp_path):
    assert run(example, "--out", tmp_path / "two.yaml").exit_code == 0
    assert (tmp_path / "two.yaml").read_bytes() == fitted[1].read_bytes()


def test_a_subject_and_its_models_can_be_named(example, tmp_path):
    out = tmp_path / "m.yaml"
    result = run(example, "--subject", "B", "--mean", "quadratic", "--deviation", "linear", "--out", out)
    assert result.exit_code == 0
    (law,) = yaml.safe_load(out.read_text())["subjects"].values()
    assert (law["mean"], law["deviation"]) == ("quadratic", "linear")


def test_pictures_of_the_fit_are_drawn(example, tmp_path):
    assert run(example, "--folds", "3", "-o", tmp_path / "m.yaml", pictures=True).exit_code == 0
    drawn = sorted(p.name for p in (tmp_path / "m-pictures").iterdir())
    assert drawn == [f"subject-{n}-{kind}.png" for n in (1, 2) for kind in ("fit", "models")]
    assert all(p.stat().st_size > 10_000 for p in (tmp_path / "m-pictures").iterdir())


def test_the_published_protocol_drops_two_and_gives_a_normal_law(example, tmp_path):
    out = tmp_path / "m.yaml"
    words = ["--subject", "A", "--protocol", "published", "--json", "--out", out]
    data = json.loads(run(example, *words).stdout)["subjects"]["A"]
    assert [len(data["folds"][0][k]) for k in ("train", "validation", "test")] == [14, 2, 2]
    assert set(data["dropped_sessions"]) == {"smallest", "largest"}
    node = Probabilistic(model=str(out), subject="A")
    printed = [p["value"] for p in data["deviation"]["parameters"].values()]
    assert node.freedom == 0 and node.deviation_parameters == approx(printed, rel=1e-15)


def test_the_node_gives_the_band_of_the_fit(fitted):
    """Quantiles of the law in the file at 3 mm, from the numbers of the fit."""
    data, out = fitted[0]["subjects"]["B"], fitted[1]
    mean, scatter = (
        float(MODELS[data[k]["model"]](3e-3, [p["value"] for p in data[k]["parameters"].values()]))
        for k in ("mean", "deviation")
    )
    node = Probabilistic(model=str(out), subject="B")
    node.start()
    law = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=1.0, compression=3e-3, indentation=0.0,
                  compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
    quantiles = node.step(law, dt=1e-3).quantiles
    reach = student.ppf(0.975, data["band"]["freedom"]) * data["band"]["widening"] * scatter
    assert quantiles == approx([mean - reach, mean, mean + reach], rel=1e-6)


def test_newtons_in_a_column_of_millinewtons_are_an_error_unless_accepted(example, tmp_path):
    path = tmp_path / "s.csv"
    path.write_text(example.read_text().replace("force [N]", "force [mN]"))
    assert "'force [N]'" in refused(path) and "--any-stiffness" in refused(path)
    assert run(path, "--any-stiffness", "--subject", "A").exit_code == 0


# --- bad input -------------------------------------------------------------------------------------------------------


def refused(*arguments):
    result = run(*arguments)
    assert result.exit_code == 2 and result.stdout == "" and "Traceback" not in result.stderr
    return result.stderr


def test_too_few_sessions_for_the_folds_are_an_error(tmp_path):
    path = write(tmp_path / "s.csv", synthetic_sessions(0, sessions=10))
    text = refused(path, "--protocol", "published")
    assert "row 111, column 'session': subject 'a' has 10 sessions, expected at least 11: 9 folds after" in text
    assert run(path, "--folds", "4", "--protocol", "published").exit_code == 0 == run(path).exit_code
    path = write(tmp_path / "s.csv", synthetic_sessions(0, sessions=8))
    assert "subject 'a' has 8 sessions, expected at least 9: 9 folds (--folds" in refused(path)


def test_a_missing_subject_is_an_error(example):
    assert "column 'subject': no 'Z'; the file has A, B" in refused(example, "--subject", "Z")


def test_constant_forces_are_an_error(tmp_path):
    path = write(tmp_path / "s.csv", np.full((20, 11), 0.5))
    assert "from row 2, column 'force': subject 'a': the force is 0.5 N at all depths" in refused(path)


def test_too_few_depths_are_an_error(tmp_path):
    path = write(tmp_path / "s.csv", synthetic_sessions(0)[:, :5], DEPTHS[:5])
    assert "column 'depth': subject 'a' has 4 depths above 0, expected at least 6" in refused(path)


def test_a_negative_force_and_a_missing_depth_are_errors(tmp_path):
    forces = synthetic_sessions(0)
    path = write(tmp_path / "s.csv", forces)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]))
    assert "session '20' of subject 'a' lacks 5 mm" in refused(path)
    forces[3, 4] = -0.3
    assert "row 39, column 'force': found -0.3" in refused(write(path, forces))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--mean", "cubic"], "--mean: found 'cubic', expected one of linear"),
        (["--deviation", "x"], "--deviation: found 'x'"),
        (["--protocol", "half"], "--protocol: found 'half', expected one of whole, published"),
        (["--depth-limit", "-1"], "--depth-limit: found -1, expected a depth > 0"),
        (["--subject", "A", "--folds", "3", "--out", "/nix/x.yaml"], "/nix/x.yaml: cannot be written"),
    ],
)
def test_wrong_options_are_errors_with_valid_ones(example, arguments, text):
    assert text in refused(example, *arguments)


@pytest.mark.parametrize(
    ("option", "place", "text"),
    [
        ("--out", "file/x.yaml", "file/x.yaml: cannot be written: Not a directory"),
        ("--out", "nowhere/x.yaml", "nowhere/x.yaml: cannot be written: No such file or directory"),
        ("--out", ".", "cannot be written: this is a folder"),
    ],
)
def test_a_path_without_write_permission_is_an_error_before_the_fit(
    example, tmp_path, monkeypatch, option, place, text
):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("palpate.models.fit.fit.choose", lambda *given: pytest.fail("it fits first"))
    assert text in refused(example, "--subject", "A", option, tmp_path / place)
    assert {path.name for path in tmp_path.iterdir()} <= {"file", example.name}


def test_the_example_does_not_write_over_a_file(example):
    before = example.read_bytes()
    assert "file exists" in refused("--example", example)
    assert example.read_bytes() == before


def test_errors_are_available_as_json(example):
    result = run(example, "--subject", "Z", "--json")
    assert result.exit_code == 2 and result.stderr == ""
    printed = json.loads(result.stdout)
    assert not printed["ok"] and "no 'Z'" in printed["faults"][0]


def test_the_help_names_every_model():
    text = unwrapped(run("--help").stdout)
    assert ", ".join(MODELS) in text


def test_no_file_and_a_missing_file_are_errors():
    assert "no file: give SESSIONS.csv, or --example" in refused()
    assert "nix.csv: cannot be read: No such file" in refused("nix.csv")


def test_the_tables_of_a_narrow_terminal_keep_every_number(example):
    words = [
        "fit",
        "force",
        str(example),
        "--subject",
        "A",
        "--folds",
        "3",
        "--out",
        str(example.parent / "narrow.yaml"),
    ]
    result = CliRunner(env={"COLUMNS": "80"}).invoke(app, words)
    assert "…" not in result.stdout and max(map(len, result.stdout.splitlines())) <= 80
