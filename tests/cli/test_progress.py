"""Commands that take minutes announce this before they start, also in a log and on a busy machine."""

import os

import pytest

from palpate.launch.run import progress
from palpate.launch.run.busy import busy


@pytest.fixture
def clock(monkeypatch):
    moment = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: moment[0])
    monkeypatch.setattr(os, "getloadavg", lambda: (0.1, 0.1, 0.1))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    return moment


def run(clock, took):
    with progress.steps("tune: 4 bodies", 4, seconds=384.0) as done:
        for k, seconds in enumerate(took):
            clock[0] += seconds
            done(f"body {k}")


def test_a_log_has_lines_with_the_remaining_time_without_the_first_step(clock, capsys):
    run(clock, (90.0, 20.0, 20.0, 20.0))
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "tune: 4 bodies, roughly 6 min"
    assert lines[1:] == [" 25 %: body 0", " 50 %, about 40 s left: body 1", " 75 %, about 20 s left: body 2"]


def test_fast_steps_print_few_lines_and_json_output_has_none(clock, capsys):
    run(clock, (1.0, 1.0, 1.0, 1.0))
    with progress.steps("tune", 1, silent=True) as done:
        done("all")
    assert capsys.readouterr().err.splitlines() == ["tune: 4 bodies, roughly 6 min"]


def test_a_busy_machine_is_reported_before_the_start(clock, capsys, monkeypatch):
    monkeypatch.setattr(os, "getloadavg", lambda: (3.0, 0.1, 0.1))
    run(clock, ())
    assert "This machine is busy: its load average is 3.0 on 2 cores" in capsys.readouterr().err
    assert busy(included=2.0) == ""
    with progress.steps("fit body", 1, timed=False):
        pass
    assert capsys.readouterr().err.splitlines() == ["fit body"]
