"""Progress of a long computation where there is no terminal: a line for each stage and each tenth of it."""

import io
import json

from rich.console import Console
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.terminal.progress import StageBars


def told(quiet=False, terminal=False):
    out = io.StringIO()
    with StageBars(Console(file=out, force_terminal=terminal, width=100), quiet) as stages:
        done = stages.begin("condensing", "300 degrees of freedom")
        for k in range(1, 41):
            done(k / 40)
    return out.getvalue()


def test_a_stage_says_that_it_begins_and_each_tenth_of_it():
    lines = told().splitlines()
    assert lines[0] == "condensing: 300 degrees of freedom ..."
    assert [line.split()[1] for line in lines[1:]] == [f"{k}0%" for k in range(1, 11)]
    assert "s left" in lines[1] and "s left" not in lines[-1]


def test_a_terminal_gets_a_bar_and_no_lines():
    assert "condensing" in told(terminal=True) and "degrees of freedom ..." not in told(terminal=True)


def test_quiet_is_quiet():
    assert told(quiet=True) == ""


def test_reduce_says_what_it_does_while_it_does_it(tmp_path):
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
    assert "meshing: the inside of" in outcome.stderr and "condensing: 100%" in outcome.stderr
    again = CliRunner().invoke(app, [*words, "--json", "--force"])
    assert again.stderr == "" and json.loads(again.stdout)["built"]
