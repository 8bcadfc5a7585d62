"""`palpate experiment` from the shell, with a simulated observer."""

import contextlib
import json
import math
import os
import signal

import pytest
import yaml
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.commands.studies import experiment as command
from palpate.records.changed import change_plan
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.studies.psychophysics import observer as simulated
from palpate.studies.psychophysics.file import EXPERIMENTS, load
from palpate.studies.psychophysics.opening import open_sitting
from palpate.studies.psychophysics.session import Answer
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.studies.sweeps.keep import kept_results

TEXT = """\
graph: kidney
set: {scene.surface.vertices: 600}
duration: 0.6 s
vary: tissue.stiffness
reference: 3e3
response: 2afc
question: Which was stiffer?
blocks:
  main: {procedure: constant, levels: [2e3, 4e3], repeats: 2}
observer: {feels: peak contact.force, noise: 1e-9}
"""
BY_LEVEL = TEXT.replace("feels: peak contact.force, noise: 1e-9", "threshold: 1, spread: 1, duration: 5 ms")
"""The observer answers by the level, so that its runs are short."""
MAGNITUDE = TEXT.replace("reference: 3e3\n", "").replace("2afc", "magnitude")


def call(*words):
    return CliRunner().invoke(app, ["experiment", *map(str, words)], env={"COLUMNS": "200"})


@pytest.fixture
def mine(write, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return lambda text=TEXT: write("mine.yaml", text)


def rows(folder, who="01", session=1):
    (file,) = folder.glob(f"sub-{who}/ses-{session:02d}/beh/*_beh.tsv")
    head, *lines = file.read_text().splitlines()
    return [dict(zip(head.split("\t"), line.split("\t"), strict=True)) for line in lines]


@pytest.mark.long
def test_an_observer_of_spikes_finds_a_shallow_nodule(mine, tmp_path):
    """The experiment that ships, at one of its depths, with the noise of the spikes alone."""
    shipped = yaml.safe_load((EXPERIMENTS / "nodule-spikes.yaml").read_text(encoding="utf-8"))
    shipped["blocks"]["main"] |= {"levels": ["5 mm"], "repeats": 4}
    shipped["observer"] |= {"noise": 0.1, "lapse": 0.0}
    done = call(mine(yaml.safe_dump(shipped)), "--simulate", "-o", "out")
    assert done.exit_code == 0, done.output
    assert [row["hit"] for row in rows(tmp_path / "out")] == ["1"] * 4


def test_an_observer_without_noise_finds_the_stiffer_kidney_and_replay_reproduces_the_trials(mine, tmp_path):
    done = call(mine(), "--simulate", "-o", "out", "--json")
    assert done.exit_code == 0, done.output
    printed = json.loads(done.stdout)
    assert printed["ok"] and printed["trials"] == 4
    found = rows(tmp_path / "out")
    assert [row["hit"] for row in found] == ["1"] * 4 and {row["level"] for row in found} == {"2000.0", "4000.0"}
    for name in ("recording_1", "recording_2"):
        recording = Recording(tmp_path / "out" / found[0][name])
        plan = change_plan(recording, ())
        assert verify(recording, plan).ok
        is_comparison = name == f"recording_{found[0]['interval']}"
        stiffness = plan.graph.nodes["tissue"].settings["stiffness"]
        assert stiffness == (float(found[0]["level"]) if is_comparison else 3e3)


@pytest.mark.parametrize(
    ("feels", "band", "reads"),
    [
        ("peak contact.force", "off", 0),
        ("at 0.55 s contact.force / mean controller.force[2]", "off", 0),
        ("last band.mean / peak contact.force", "on", 3),  # a node in Python: read from the recording
    ],
)
def test_an_observer_feels_exactly_what_is_in_the_recordings(mine, tmp_path, monkeypatch, feels, band, reads):
    text = TEXT.replace("600}", f"600, scene.finger.band: {band}}}")
    read, counted = [], simulated.Run
    monkeypatch.setattr(simulated, "Run", lambda file: read.append(file) or counted(file))
    with open_sitting(str(mine(text)), tmp_path / "out", None, None, [], False, lambda text: None) as sitting:
        settings = simulated.ObserverSettings(feels=feels)
        observer = simulated.SimulatedObserver(sitting.stimuli, settings).seat("01", 1, 0)
        felt, ask = [], observer.ask
        monkeypatch.setattr(observer, "ask", lambda trial: felt.append(list(observer._felt)) or ask(trial))
        sitting.run(observer)
        quantities = kept_results(feels.split(" / "), sitting.stimuli.launch.load())
    assert len(read) == reads
    for row, numbers in zip(rows(tmp_path / "out"), felt, strict=True):
        for name, number in zip(("recording_1", "recording_2"), numbers, strict=True):
            first, *others = (one.number(counted(tmp_path / "out" / row[name])) for one in quantities)
            assert number == (first / others[0] if others else first) > 0.0
    assert len({number for numbers in felt for number in numbers}) == 3


def test_an_interrupted_experiment_resumes_with_the_same_trials(mine, tmp_path, monkeypatch):
    file = mine(TEXT.replace("feels: peak contact.force, noise: 1e-9", "threshold: 1, spread: 1, duration: 5 ms"))
    assert call(file, "--simulate", "-o", "whole").exit_code == 0
    ask, asked = simulated.SimulatedObserver.ask, []

    def interrupted(self, trial):
        asked.append(trial)
        if len(asked) == 3:
            signal.raise_signal(signal.SIGTERM)
        return ask(self, trial)

    monkeypatch.setattr(simulated.SimulatedObserver, "ask", interrupted)
    done = call(file, "--simulate", "-o", "out")
    assert done.exit_code == 143 and "2 trials; the same command resumes" in done.output
    refused = call(file, "--simulate", "-o", "out")
    assert refused.exit_code == 2 and "sub-01 has done 2 trials of session 1" in refused.output
    assert "--resume continues" in refused.output
    assert call(file, "--simulate", "-o", "out", "--resume").exit_code == 0
    shown = [[(row["trial"], row["level"], row["interval"]) for row in rows(tmp_path / f)] for f in ("whole", "out")]
    assert shown[0] == shown[1]
    third = rows(tmp_path / "out")[2]
    assert third["repeats"] == "1" and "_repeat-1.mcap" in third["recording_1"]


def test_an_existing_participant_needs_confirmation_and_is_never_overwritten(mine, tmp_path, monkeypatch):
    file = mine(TEXT.replace("feels: peak contact.force, noise: 1e-9", "threshold: 1, spread: 1, duration: 5 ms"))
    again = (file, "--simulate", "-o", "out", "--participant", "01")
    assert call(*again).exit_code == 0
    before = rows(tmp_path / "out")
    refused = call(*again)
    assert refused.exit_code == 2 and "nothing is overwritten. --session 2 begins another one" in refused.output
    asked = []
    monkeypatch.setattr(command, "_confirm", lambda text: asked.append(text) or len(asked) > 1)
    assert call(*again).exit_code == 2 and rows(tmp_path / "out") == before
    assert call(*again).exit_code == 0 and rows(tmp_path / "out") == before
    assert asked == ["sub-01 has done session 1. Begin session 2?"] * 2 and len(rows(tmp_path / "out", session=2)) == 4
    assert call(file, "--simulate", "-o", "out").exit_code == 0
    assert len(rows(tmp_path / "out", "02")) == 4


def changed_text(old, new):
    assert old in TEXT
    return TEXT.replace(old, new)


CONSTANT = "procedure: constant, levels: [2e3, 4e3], repeats: 2"
STEPS = "procedure: staircase, start: 4e3, steps:"


@pytest.mark.parametrize(
    ("text", "output_text"),
    [
        (changed_text("[2e3, 4e3]", "[3e3]"), "the stimuli of a pair are the same: tissue.stiffness = 3000"),
        (changed_text("vary: tissue.stiffness", "vary: tissue.stifness"), "Did you mean 'stiffness'?"),
        (changed_text("vary: tissue.stiffness", "vary: tisue.stiffness"), "found 'tisue', expected a node"),
        (changed_text("vary: tissue.stiffness", "vary: scene.tissue.stifness"), "mean 'scene.tissue.stiffness'?"),
        (TEXT + "answers: {first: f, second: F}\n", "answers: the key 'f' means first and second"),
        (TEXT + "answers: {second: s}\nend_key: S\n", "end_key: 'S' is the key of an answer, too"),
        (TEXT + "answers: {third: s}\n", "2afc has no answer 'third'"),
        (changed_text("reference: 3e3\n", ""), "reference: missing; 2afc compares two stimuli"),
        (changed_text("constant,", "constnat,"), "Did you mean 'constant'?"),
        (changed_text("[2e3, 4e3]", "[2e3, 2e3]"), "a level stands twice"),
        (changed_text("[2e3, 4e3]", "[2 mm]"), "blocks.main.levels [N/m^n]: found '2 mm'"),
        (changed_text("[2e3, 4e3]", "{linspace: [1, 2]}"), "expected a list of values, or {linspace:"),
        (changed_text("repeats: 2", "repeats: 0"), "block 'main', repeats: found 0, expected a whole number from 1"),
        (changed_text("repeats: 2", "catch: 0.2"), "block 'main': catch needs `response: yes-no`"),
        (changed_text(CONSTANT, f"{STEPS} 10"), "it would never end"),
        (changed_text(CONSTANT, f"{STEPS} 10, trials: 5, rule: 2-down"), "expected such as"),
        (changed_text(CONSTANT, f"{STEPS} 1, trials: 5, scale: ratio"), "ratios above 1"),
        (changed_text("response: 2afc", "response: 3afc"), "response: found '3afc'"),
        (TEXT + "function: weibull\n", "weibull begins at 0, but levels lie to both sides"),
        (TEXT + "participants: {a_b: {age: 3}}\n", "participants: found 'a_b', expected letters and digits"),
        (changed_text("noise: 1e-9", "nose: 1"), "observer: unknown key 'nose'"),
        (changed_text("feels: peak contact.force, ", ""), "expected either `feels`, or `threshold` and `spread`"),
        (changed_text("peak contact.force", "peak contact.fors"), "Did you mean 'force'?"),
        (changed_text("peak contact.force", "curve contact.force contact.indentation"), "expected"),
        (TEXT + 'participants: {ann: {age: "3\\t4"}}\n', "found '3\\t4', expected a text for a table: it has a tab"),
        (TEXT + "participants: {ann: {participant_id: 3}}\n", "expected a text for a table: it is the column of the"),
        (changed_text("main:", '"ma\\nin":'), "a name is stored in a table: it has a line break"),
        (changed_text("main:", '"":'), "a name is stored in a table: it is empty"),
        (MAGNITUDE.replace("feels: peak contact.force", "threshold: 1, spread: 1"), "an observer of magnitudes needs"),
        ("[]", "expected a mapping with graph"),
    ],
)  # fmt: skip
def test_errors_are_reported_before_the_first_trial(mine, tmp_path, text, output_text):
    done = call(mine(text), "--simulate", "-o", "out")
    assert done.exit_code == 2 and output_text in done.output, done.output
    assert "Traceback" not in done.output and not (tmp_path / "out").exists()


class Scripted:
    """A participant who gives these answers, without runs."""

    def __init__(self, answers):
        self.answers = list(answers)

    def show(self, trial, title, text, pause=0.0):
        pass

    def present(self, trial, interval, launch):
        launch.record.touch()

    def ask(self, trial):
        return Answer(self.answers.pop(0), 0.5)


def test_an_answer_with_a_tab_is_stored_as_its_number_and_the_session_resumes(mine, tmp_path):
    """Stored as it was typed, the row was unreadable, and resuming dropped it and all later ones."""
    text = MAGNITUDE
    given = str(mine(text)), tmp_path / "out", None, None, [], True, lambda text: None
    with open_sitting(*given) as sitting, contextlib.suppress(IndexError):
        sitting.run(Scripted(["5\t", " 7", "1_0"]))
    with open_sitting(*given) as sitting:
        assert [row["response"] for row in sitting.table.rows] == ["5", "7", "10"] and not sitting.ended
        sitting.run(Scripted(["2.50"]))
        assert sitting.table.rows[-1]["response"] == "2.5"
    with open_sitting(*given[:5], False, lambda text: True) as sitting:
        assert sitting.participant == "02"  # the session of the first is complete


def test_a_corrected_experiment_uses_the_folder_of_the_one_with_the_error(mine, tmp_path):
    """Also errors of the page's graph: no trial is stored, so the new version replaces the old one."""
    text = BY_LEVEL
    other = mine(text.replace("levels", "pause_every: 3, levels"))
    with open_sitting(str(other), tmp_path / "out", None, None, [], False, lambda text: None):
        pass
    assert (tmp_path / "out").exists()
    assert call(mine(text), "--simulate", "-o", "out").exit_code == 0


def test_an_unwritable_folder_is_reported(mine, tmp_path):
    (tmp_path / "out").write_text("")
    done = call(mine(), "--simulate", "-o", "out")
    assert done.exit_code == 2 and "out: cannot be written: " in done.output and "--out takes another" in done.output


def test_a_damaged_table_is_recovered_up_to_the_last_trial_with_a_note(mine, tmp_path):
    file = mine(TEXT.replace("feels: peak contact.force, noise: 1e-9", "threshold: 1, spread: 1, duration: 5 ms"))
    assert call(file, "--simulate", "-o", "out").exit_code == 0
    before = rows(tmp_path / "out")
    (table,) = tmp_path.glob("out/sub-01/ses-01/beh/*.tsv")
    os.truncate(table, table.stat().st_size - 30)
    done = call(file, "--simulate", "-o", "out", "--resume")
    assert done.exit_code == 0 and "was broken: 3 whole trials are kept" in done.output
    after = rows(tmp_path / "out")
    assert after[:3] == before[:3] and after[3]["level"] == before[3]["level"] and after[3]["repeats"] == "1"


def test_a_changed_experiment_is_not_resumed(mine):
    text = BY_LEVEL
    assert call(mine(text), "--simulate", "-o", "out").exit_code == 0
    done = call(mine(text.replace("4e3", "5e3")), "--simulate", "-o", "out", "--participant", "02")
    assert done.exit_code == 2 and "another version of this experiment" in done.output


def test_only_participants_of_the_experiment_file_are_accepted(mine, tmp_path):
    text = BY_LEVEL
    file = mine(text + "participants: {ann: {age: 30}, bob: {age: 41}}\n")
    for _ in range(2):
        assert call(file, "--simulate", "-o", "out").exit_code == 0
    listed = (tmp_path / "out" / "participants.tsv").read_text().splitlines()
    assert listed == ["participant_id\tage", "sub-ann\t30", "sub-bob\t41"]
    assert "all participants have done this experiment" in call(file, "--simulate", "-o", "out").output
    assert "expected one of ann, bob" in call(file, "--simulate", "-o", "out", "--participant", "eve").output


def test_the_analysis_prints_and_draws_thresholds_with_intervals(mine, tmp_path):
    blocks = "main: {procedure: constant, levels: {linspace: [2e3, 4e3, 7]}, repeats: 8}"
    text = changed_text("main: {procedure: constant, levels: [2e3, 4e3], repeats: 2}", blocks)
    file = mine(text.replace("feels: peak contact.force, noise: 1e-9", "threshold: 3e3, spread: 300, duration: 5 ms"))
    for _ in range(2):
        assert call(file, "--simulate", "-o", "out").exit_code == 0
    done = call("--analyse", "out")
    assert done.exit_code == 0 and "weber fraction at 50%" in done.output, done.output
    printed = json.loads(call("--analyse", "out", "--json").stdout)
    first, _, mean = printed["outcomes"]
    assert mean["participant"] == "all" and first["of"] == "judged greater" and first["trials"] == 56
    jnd = first["numbers"]["jnd"]
    assert jnd["low"] < 0.6745 * 300 < jnd["high"]
    assert first["numbers"]["weber fraction"]["value"] == pytest.approx(jnd["value"] / 3e3)
    for file in printed["files"]:
        assert (tmp_path / file).stat().st_size > 100
    assert call("--analyse", tmp_path / "no").exit_code == 2


def test_magnitudes_follow_the_power_law_of_the_observer(mine):
    """The observer judges a known power of the stiffness; the exponent for the force at equal travel is smaller."""
    text = TEXT.replace("reference: 3e3\n", "").replace("2afc", "magnitude").replace("[2e3, 4e3]", "[1e3, 2e3, 4e3]")
    file = mine(text.replace("feels: peak contact.force, noise: 1e-9", "feels: peak contact.force, exponent: 2.0"))
    assert call(file, "--simulate", "-o", "out").exit_code == 0
    (printed,) = json.loads(call("--analyse", "out", "--json").stdout)["outcomes"]
    assert printed["of"] == "magnitude" and printed["levels"] == pytest.approx([1e3, 2e3, 4e3])
    low, _, high = printed["shares"]
    slope = math.log(high / low) / math.log(4.0)
    assert printed["numbers"]["exponent"]["value"] == pytest.approx(slope, rel=0.05) and 0.3 < slope < 2.0


@pytest.mark.parametrize("file", sorted(EXPERIMENTS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_shipped_experiments_can_be_simulated(file, tmp_path):
    experiment, source = load(file)
    stimuli = Stimuli(experiment, source, file)
    settings = simulated.load(source.sub("observer"))
    with open_sitting(str(file), tmp_path, None, None, [], False, lambda text: None) as sitting:
        assert sitting.trial.total > 40
        simulated.SimulatedObserver(stimuli, settings)
