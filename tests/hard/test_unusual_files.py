"""Files of every kind that palpate reads, damaged at random, or no files at all: one line with the file's name, exit
code 1 or 2, no traceback, no hang."""

import json
import os
import random
import signal
import zipfile
from pathlib import Path

import numpy as np
import pytest
from graphs_for_runs import GRAPH, write_graph
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.errors import PalpateError
from palpate.studies.sweeps.store import Store

LIMIT = 20  # [s] after which a command counts as hung

COMMANDS = {
    "recording": (".mcap", ["info", "{}"]),
    "graph": (".yaml", ["check", "{}"]),
    "scene": (".yaml", ["check", "kidney", "--scene", "{}"]),
    "placement": (".yaml", ["check", "kidney", "--place", "{}"]),
    "motion": (".csv", ["run", "kidney", "--fused", "-q", "--no-record", "--duration", "2 ms", "--set",
                        "device={{use: device.Replayed, path: {}}}"]),
    "sessions": (".csv", ["fit", "force", "{}"]),
    "press": (".csv", ["fit", "tissue", "{}", "--rig", "ball", "--radius", "8 mm", "--law", "hertz"]),
    "mesh": (".stl", ["check", "kidney", "--organ", "{}"]),
    "study": (".yaml", ["study", "{}"]),
    "experiment": (".yaml", ["experiment", "{}"]),
}  # fmt: skip


def command(*words: str):
    """A command in this process, interrupted after `LIMIT`."""

    def late(*_: object) -> None:
        raise AssertionError(f"no end after {LIMIT} s: {words}")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(LIMIT)
    try:
        return CliRunner().invoke(app, list(words), env={"COLUMNS": "300", "NO_COLOR": "1"})
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def refused(kind: str, file: Path) -> str:
    """The lines of a command that cannot use a file."""
    words = [word.format(file) for word in COMMANDS[kind][1]]
    done = command(*words)
    assert done.exit_code in (1, 2) and isinstance(done.exception, SystemExit), (words, done.exception, done.output)
    assert "Traceback" not in done.output, done.output
    return done.output


@pytest.mark.parametrize("kind", [kind for kind in COMMANDS if kind != "mesh"])
def test_a_pipe_a_device_or_a_folder_is_refused(tmp_path, kind, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ending = COMMANDS[kind][0]
    pipe, zero, folder = (tmp_path / f"{name}{ending}" for name in ("pipe", "zero", "folder"))
    os.mkfifo(pipe)
    zero.symlink_to("/dev/zero")
    folder.mkdir()
    for file in (pipe, zero, folder):
        assert file.stem in refused(kind, file)


DEEP = {
    "lists": "[" * 20_000 + "]" * 20_000,
    "mappings": "{a: " * 5_000 + "1" + "}" * 5_000,
    "cut": "nodes: {a: [1, 2",
    "zeros": "\0" * 100,
    "latin": "nodes: \xe4".encode("latin-1").decode("latin-1"),
    "number": "3",
    "list": "- 3\n- 4\n",
    "empty": "",
    "quotes": '"' * 1001,
}


@pytest.mark.parametrize("kind", [kind for kind in COMMANDS if kind != "recording"])
def test_other_texts_are_refused(tmp_path, kind, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in DEEP.items():
        if (kind, name) in (("placement", "empty"), ("scene", "empty")):
            continue
        file = tmp_path / f"{name}{COMMANDS[kind][0]}"
        file.write_text(text, encoding="latin-1")
        refused(kind, file)


@pytest.fixture(scope="module")
def samples(tmp_path_factory) -> dict[str, bytes]:
    """A valid file of each format."""
    folder = tmp_path_factory.mktemp("samples")
    file = folder / "run.mcap"
    assert execute(LaunchFile(graph=write_graph(folder, GRAPH), duration=0.02, record=file, place="fused")).ok
    np.savez(folder / "arrays.npz", a=np.arange(40.0).reshape(8, 5), b=np.array(["text"]))
    return {"recording": file.read_bytes(), "npz": (folder / "arrays.npz").read_bytes(), "graph": GRAPH.encode()}


def damaged(data: bytes, dice: random.Random) -> bytes:
    """The bytes cut off, with flipped bits, with a piece repeated or removed, or with other bytes in a piece."""
    changed, at = bytearray(data), dice.randrange(len(data))
    match dice.randrange(5):
        case 0:
            del changed[at:]
        case 1:
            for _ in range(dice.choice((1, 1, 8))):
                changed[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        case 2:
            changed[at:at] = changed[at : at + dice.randrange(1, 64)]
        case 3:
            del changed[at : at + dice.randrange(1, 64)]
        case 4:
            changed[at : at + 8] = dice.choice((b"\xff" * 8, b"\0" * 8, dice.randbytes(8)))
    return bytes(changed)


@pytest.mark.parametrize("seed", range(4))
def test_a_randomly_damaged_archive_is_an_archive_error(samples, tmp_path, seed):
    dice, file = random.Random(seed), tmp_path / "x.npz"
    for _ in range(250):
        file.write_bytes(damaged(samples["npz"], dice))
        try:
            read_arrays(file)
        except ArchiveError as error:
            assert str(file) in str(error)


def test_a_header_cut_inside_a_bracket_is_an_archive_error(samples, tmp_path):
    file = tmp_path / "x.npz"
    with zipfile.ZipFile(file, "w") as archive:
        head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (8, 5"
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
    with pytest.raises(ArchiveError, match=r"x\.npz: cannot be read"):
        read_arrays(file)


@pytest.mark.parametrize(("kind", "seed"), [(kind, seed) for kind in ("recording", "graph") for seed in range(2)])
def test_a_randomly_damaged_file_is_refused_or_usable(samples, tmp_path, kind, seed):
    dice, file = random.Random(seed), tmp_path / f"x{COMMANDS[kind][0]}"
    words = [word.format(file) for word in COMMANDS[kind][1]]
    for _ in range(25):
        file.write_bytes(damaged(samples[kind], dice))
        done = command(*words)
        assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
        assert done.exit_code in (0, 1, 2) and "Traceback" not in done.output


def test_a_damaged_study_is_an_error_of_one_line(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="extra study")
    parquet = pytest.importorskip("pyarrow.parquet", reason="extra study")
    row = {"key": "a", "base": "b", "slot": 0, "error": ""}
    about = {"bases": {"b": {}}}
    good = tmp_path / "good"
    good.mkdir()
    parquet.write_table(pyarrow.Table.from_pylist([row]), good / "points.parquet")
    (good / "study.json").write_text(json.dumps(about))
    Store(good).close()
    texts = ["{}", "[]", "3", "null", '{"bases": 3}', "[" * 100_000, "{", "\xff", ""]
    tables = [{}, {"slot": "x"}, {"key": 3}, {"error": None}, {"base": ["b"]}]
    spoilt = [("study.json", text.encode("latin-1")) for text in texts]
    for number, change in enumerate(tables):
        table = pyarrow.Table.from_pylist([{**row, **change} if change else {"x": 1}])
        parquet.write_table(table, tmp_path / f"{number}.parquet")
        spoilt.append(("points.parquet", (tmp_path / f"{number}.parquet").read_bytes()))
    whole, dice = (good / "points.parquet").read_bytes(), random.Random(1)
    spoilt += [("points.parquet", whole[:n]) for n in (0, 4, len(whole) // 2)]
    for number, (name, content) in enumerate(spoilt):
        folder = tmp_path / f"study-{number}"
        folder.mkdir()
        for file in good.iterdir():
            (folder / file.name).write_bytes(file.read_bytes())
        (folder / name).write_bytes(content)
        with pytest.raises(PalpateError) as error:
            Store(folder)
        assert str(folder) in str(error.value) and "\n" not in str(error.value), (name, content[:50])
    for _ in range(100):
        (good / "points.parquet").write_bytes(damaged(whole, dice))
        try:
            Store(good).close()
        except PalpateError as error:
            assert str(good) in str(error)


def test_a_comparison_has_a_picture_with_a_known_ending(samples, tmp_path):
    (tmp_path / "x.mcap").write_bytes(samples["recording"])
    done = command("compare", str(tmp_path / "x.mcap"), "--set", "drag.every=2", "-o", str(tmp_path / "a.mcap"))
    assert done.exit_code == 2 and "expected .png or .svg or .pdf" in done.stderr


MOTION = [(0.01 * k, 0.03 + 0.001 * k, 0.0, 0.001 * k) for k in range(40)]


@pytest.mark.parametrize(
    ("head", "scales", "found"),
    [
        ("t,x,y,z", (1, 1, 1, 1), ""),
        ("t,x,y,z", (1, 1e3, 1e3, 1e3), "column x: found 69 m, expected at most 2 m; name the unit in the header"),
        ("t,x,y,z", (1e3, 1, 1, 1), "column t: found rows 10 s apart, expected less than 0.5 s; name the unit"),
        ("t [ms],x [mm],y [mm],z [mm]", (1e3, 1e3, 1e3, 1e3), ""),
    ],
)
def test_the_units_of_a_motion_are_those_of_its_header(tmp_path, head, scales, found):
    from palpate.nodes.base import SettingError
    from palpate.nodes.device.motion import read_motion

    file = tmp_path / "motion.csv"
    rows = (",".join(repr(value * scale) for value, scale in zip(row, scales, strict=True)) for row in MOTION)
    file.write_text("\n".join([head, *rows]) + "\n")
    if found:
        with pytest.raises(SettingError) as error:
            read_motion(str(file))
        assert found in str(error.value)
        return
    motion = read_motion(str(file))
    np.testing.assert_allclose(motion.times, [row[0] for row in MOTION], atol=1e-12)
    np.testing.assert_allclose(motion.values, [row[1:] for row in MOTION], atol=1e-12)


def test_a_budget_needs_a_unit():
    done = command("tune", "kidney", "--budget", "0.5")
    assert done.exit_code == 2 and "found '0.5' without a unit; expected a time such as '0.5 ms'" in done.stderr


def test_a_wrong_order_and_a_foreign_file_are_named(samples, tmp_path):
    file, foreign = tmp_path / "run.mcap", tmp_path / "foreign.mcap"
    file.write_bytes(samples["recording"])
    done = command("picture", "contact.force", str(file))
    assert done.exit_code == 2 and "expected FILE first: palpate picture" in done.stderr
    head = b"\x04\x00\x00\x00ros2\x04\x00\x00\x00rust"
    foreign.write_bytes(b"\x89MCAP0\r\n\x01" + len(head).to_bytes(8, "little") + head + bytes(100))
    done = command("info", str(foreign))
    assert done.exit_code == 2 and "an MCAP file of another program" in done.stderr
