"""Progress of the stages of a long computation: a bar on a terminal, lines in a log."""

import json

import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.run import progress


@pytest.fixture
def progress_output(capsys, monkeypatch):
    def run(quiet=False, terminal=False):
        moment = [0.0]
        monkeypatch.setattr(progress.time, "monotonic", lambda: moment[0])
        if terminal:
            monkeypatch.setenv("FORCE_COLOR", "1")
        with progress.StageBars(quiet) as stages:
            done = stages.begin("condensing", "300 degrees of freedom")
            for k in range(1, 41):
                moment[0] += 1.0
                done(k / 40)
        return capsys.readouterr().err

    return run


def test_a_stage_prints_its_start_and_every_10_s_the_remaining_time(progress_output):
    assert progress_output().splitlines() == ["condensing: 300 degrees of freedom ..."] + [
        f"condensing:  {25 * k} %, about {40 - 10 * k} s left: 300 degrees of freedom" for k in (1, 2, 3)
    ]


def test_a_terminal_shows_a_bar_without_lines(progress_output):
    shown = progress_output(terminal=True)
    assert "condensing" in shown and "degrees of freedom ..." not in shown


def test_quiet_prints_no_progress(progress_output):
    assert progress_output(quiet=True) == ""


def test_reduce_prints_its_stages(tmp_path):
    words = [
        "build",
        "basis",
        "--set",
        "surface=sphere",
        "--set",
        "coarse=50",
        "--set",
        "model=linear",
        "--out",
        str(tmp_path),
    ]
    outcome = CliRunner().invoke(app, words)
    assert outcome.exit_code == 0, outcome.output
    assert "meshing: the inside of" in outcome.stderr and "condensing: " in outcome.stderr
    again = CliRunner().invoke(app, [*words, "--json", "--force"])
    assert again.stderr == "" and json.loads(again.stdout)["built"]
