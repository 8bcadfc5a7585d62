"""Runs that start at the same moment, and files that a run must not overwrite."""

import os
import threading
import time
from pathlib import Path

import pytest
from graphs_for_runs import write_graph
from shell_text import unwrapped
from typer.testing import CliRunner
from warm_fork_server import palpate as command

import palpate
from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.recording import new_folder
from palpate.launch.run.execute import execute
from palpate.physics.errors import ArgumentError, RunError
from palpate.records.format.claim import claim_file
from palpate.records.reader import Recording

SUPPORT = str(Path(__file__).parents[2] / "support")
AT_ONCE = 8


def at_once(work, count: int = AT_ONCE) -> list:
    """Results or errors of a function that threads call at the same moment."""
    barrier, results = threading.Barrier(count), []

    def one(number: int) -> None:
        barrier.wait()
        try:
            results.append(work(number))
        except Exception as error:
            results.append(error)

    threads = [threading.Thread(target=one, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_runs_of_one_second_get_different_folders(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def fill(number: int) -> Path:
        with new_folder("touch") as folder:
            (folder / "file").write_text(str(number))
        return folder

    for _ in range(10):
        found = at_once(fill)
        assert len(set(found)) == AT_ONCE
        assert sorted((folder / "file").read_text() for folder in found) == sorted(map(str, range(AT_ONCE)))


def test_a_folder_that_stays_empty_is_removed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with new_folder("touch") as folder:
        assert folder.is_dir()
    assert not list(tmp_path.iterdir())
    (tmp_path / "runs").write_text("")
    with pytest.raises(OSError, match="a file of this name exists; choose another folder"), new_folder("touch"):
        pass


def test_one_of_several_simultaneous_runs_gets_a_file(tmp_path):
    def hold(number: int) -> bool:
        try:
            with claim_file(file):
                assert others_refused.wait(30.0)
                return True
        except RunError as error:
            refused.append(str(error))
            if len(refused) == AT_ONCE - 1:
                others_refused.set()
            return False

    for round in range(10):
        file, others_refused, refused = tmp_path / f"{round}.mcap", threading.Event(), []
        assert sorted(at_once(hold)) == [False] * (AT_ONCE - 1) + [True]
        assert all("another run is writing this file; choose another name" in text for text in refused)
        # Nothing was written. An empty file remains if a refused run created it just before the owner locked it.
        assert not file.exists() or not file.stat().st_size


def test_a_file_that_its_owner_removes_is_claimed_again(tmp_path):
    """A lock of a removed file would protect nothing: of several owners in turn each has the file at the path."""
    file, inside, most = tmp_path / "run.mcap", [0], [0]

    def hold(number: int) -> int:
        turns = 0
        until = time.monotonic() + 0.3
        while time.monotonic() < until:
            try:
                with claim_file(file):
                    inside[0] += 1
                    most[0] = max(most[0], inside[0])
                    time.sleep(0.0002)
                    inside[0] -= 1
                    turns += 1
            except RunError:
                continue
        return turns

    assert sum(at_once(hold, 4)) > 20 and most == [1]


@pytest.mark.parametrize("given", [[], ["--record", "one.mcap"]], ids=["folder", "file"])
def test_each_of_several_commands_has_its_recording_or_is_refused(tmp_path, given):
    write_graph(tmp_path)
    env = {**os.environ, "PYTHONPATH": SUPPORT, "COLUMNS": "300"}
    for round in range(2):
        words = ["run", "loop.yaml", "--fused", "--duration", "0.4 s", "--pace", "1", "--no-pictures", "-q", *given]
        if not given:
            words += ["-o", "shared"] if round else ["--record", "x/loop.mcap"]
        runs = []
        for number in range(3):
            with open(tmp_path / f"err-{number}", "w") as err:
                stiff = ["--set", f"spring.stiffness={100 + number}"]
                runs.append(command([*words, *stiff], cwd=tmp_path, stdout=err, stderr=err, env=env))
        codes = [run.wait(60.0) for run in runs]
        texts = [(tmp_path / f"err-{number}").read_text() for number in range(3)]
        (winner,) = [number for number, code in enumerate(codes) if code == 0]
        assert sorted(codes) == [0, 1, 1], (codes, texts)
        assert all("another run is writing this file" in texts[n] for n in range(3) if n != winner), texts
        file = tmp_path / (given[1] if given else "shared/loop.mcap" if round else "x/loop.mcap")
        recording = Recording(file)
        nodes = {node["name"]: node for node in recording.about["plan"]["nodes"]}
        assert recording.complete and nodes["spring"]["settings"]["stiffness"] == 100 + winner


def test_simultaneous_commands_without_a_name_have_separate_folders(tmp_path):
    (tmp_path / "g.yaml").write_text(write_graph(tmp_path).read_text() + "run: {duration: 50 ms, record: all}\n")
    env = {**os.environ, "PYTHONPATH": SUPPORT, "COLUMNS": "300"}
    runs = []
    for number in range(4):
        words = ["run", "g.yaml", "--fused", "--no-pictures", "-q", "--set", f"spring.stiffness={100 + number}"]
        with open(tmp_path / f"err-{number}", "w") as err:
            runs.append(command(words, cwd=tmp_path, stdout=err, stderr=err, env=env))
    assert [run.wait(60.0) for run in runs] == [0] * 4
    files = sorted(tmp_path.glob("runs/*/g.mcap"))
    found = []
    for recording in map(Recording, files):
        nodes = {node["name"]: node for node in recording.about["plan"]["nodes"]}
        assert recording.complete
        found.append(nodes["spring"]["settings"]["stiffness"])
    assert sorted(found) == [100, 101, 102, 103]


def others(folder: Path) -> dict[str, Path]:
    """Paths that a recording must not overwrite."""
    files = {name: folder / f"{name}.mcap" for name in ("text", "foreign", "link", "dangling", "pipe", "folder")}
    files["text"].write_text("notes of a year\n")
    files["foreign"].write_bytes(b"\x89MCAP0\r\n\x01" + (11).to_bytes(8, "little") + b"\x03\0\0\0ros\0\0\0\0")
    (folder / "target.mcap").write_text("target")
    files["link"].symlink_to("target.mcap")
    files["dangling"].symlink_to("nothing.mcap")
    os.mkfifo(files["pipe"])
    files["folder"].mkdir()
    return files


@pytest.mark.parametrize("what", ["text", "foreign", "link", "dangling", "pipe", "folder"])
def test_a_recording_overwrites_only_recordings(tmp_path, what):
    file = others(tmp_path)[what]
    before = sorted((path.name, path.read_bytes()) for path in tmp_path.iterdir() if path.is_file())
    launch = LaunchFile(graph=write_graph(tmp_path), duration=0.02, place="fused")
    shell = CliRunner().invoke(app, ["run", str(launch.graph), "--fused", "--duration", "0.02", "--record", str(file)])
    assert shell.exit_code == 2 and str(file.name) in shell.stderr and "Traceback" not in shell.output
    with pytest.raises((ArgumentError, OSError)):
        palpate.run(launch.graph, duration=0.02, record=file)
    with pytest.raises((ArgumentError, OSError)):
        execute(launch.but(record=file))
    assert before == sorted(
        (path.name, path.read_bytes()) for path in tmp_path.iterdir() if path.is_file() and path.suffix == ".mcap"
    )
    if what in ("text", "foreign", "link"):
        assert "--force" in shell.stderr
        palpate.run(launch.graph, duration=0.02, record=file, force=True)
        assert Recording(file).complete and (what == "link") == file.is_symlink()
        palpate.run(launch.graph, duration=0.02, record=file.resolve())  # it is a recording now


def test_the_name_of_a_recording_has_its_suffix(tmp_path):
    graph = write_graph(tmp_path)
    for name in ("x.txt", "x", "x.mcap.gz"):
        shell = CliRunner().invoke(app, ["run", str(graph), "--fused", "--duration", "0.02", "--record", name])
        assert shell.exit_code == 2 and "expected a name that ends in .mcap" in unwrapped(shell.stderr)
        with pytest.raises(ArgumentError, match=r"ends in \.mcap"):
            palpate.run(graph, duration=0.02, record=name)
