"""`palpate devices`, and `palpate fit record`."""

import json
import re
import shlex
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.drivers import discover
from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import find
from palpate.models.fit.press import Loading, _onset, add_session
from palpate.models.fit.sessions import SessionError

FALCON = {"idVendor": "0403", "idProduct": "cb48", "busnum": "1", "devnum": "7", "serial": "FT1"}
BOARD = {"idVendor": "16c0", "idProduct": "0486", "busnum": "1", "devnum": "8", "serial": ""}
MOUSE = {"idVendor": "046d", "idProduct": "c077", "busnum": "1", "devnum": "9"}


def run(*words):
    return CliRunner().invoke(app, [str(w) for w in words])


@pytest.fixture
def bus(tmp_path, monkeypatch):
    """The kernel's folders for a Falcon, a raw-HID device and an ordinary mouse."""
    usb, dev = tmp_path / "usb", tmp_path / "dev"
    for name, words in {"1-1": FALCON, "1-2": BOARD, "1-3": MOUSE}.items():
        (usb / name).mkdir(parents=True)
        for key, word in words.items():
            (usb / name / key).write_text(f"{word}\n")
    (dev / "bus" / "usb" / "001").mkdir(parents=True)
    (dev / "bus" / "usb" / "001" / "007").touch(mode=0o600)
    for interface, hidraw in (("1-2:1.0", "hidraw10"), ("1-2:1.1", "hidraw2")):
        (usb / "1-2" / interface / "0003:16C0:0486.0001" / "hidraw" / hidraw).mkdir(parents=True)
    (dev / "hidraw10").touch(mode=0o600)
    monkeypatch.setattr(discover, "USB", usb)
    monkeypatch.setattr(discover, "DEV", dev)
    return dev


def test_devices_lists_the_connected_devices(bus):
    data = json.loads(run("devices", "--json").stdout)
    falcon, board = data["devices"]
    assert (falcon["name"], falcon["use"], falcon["port"]) == ("Novint Falcon", "device.Falcon", "1:7")
    assert falcon["serial"] == "FT1" and falcon["next"] == ""
    assert (board["use"], board["ids"], board["next"]) == ("device.RawHid", "16c0:0486", "")
    assert board["port"] == board["file"] == str(bus / "hidraw10"), "the file of the first interface"


def test_a_hid_device_without_a_device_file_is_listed(bus):
    for name in ("1-2:1.0", "1-2:1.1"):
        shutil.rmtree(bus.parent / "usb" / "1-2" / name)
    board = json.loads(run("devices", "--json").stdout)["devices"][1]
    assert board["port"] == "" and board["next"].startswith("no hidraw file")


def test_devices_prints_the_next_step(bus, monkeypatch):
    (bus / "bus" / "usb" / "001" / "007").unlink()
    assert "--install-udev" in json.loads(run("devices", "--json").stdout)["devices"][0]["next"]
    monkeypatch.setattr(discover, "find_spec", lambda module: None)
    assert 'pip install "palpate[devices]"' in json.loads(run("devices", "--json").stdout)["devices"][0]["next"]
    assert "Novint Falcon" in run("devices").stdout


def test_the_udev_rule_is_written_and_names_every_device(tmp_path, monkeypatch):
    rule = tmp_path / "70-palpate.rules"
    monkeypatch.setattr(discover, "RULE", str(rule))
    assert run("devices", "--install-udev").exit_code == 0
    text = rule.read_text()
    assert 'SUBSYSTEM=="usb", ATTRS{idVendor}=="0403", ATTRS{idProduct}=="cb48", MODE="0660"' in text
    assert 'SUBSYSTEM=="hidraw", ATTRS{idVendor}=="16c0", ATTRS{idProduct}=="0486", MODE="0660"' in text
    for line in text.splitlines():
        assert line.startswith("#") or re.fullmatch(r'[A-Z]+=="\w+"(, [A-Za-z{}]+(==|\+?=)"\w+")+', line), line


def test_a_rule_that_cannot_be_written_is_an_error_with_a_remedy(tmp_path, monkeypatch):
    monkeypatch.setattr(discover, "RULE", str(tmp_path / "none" / "70-palpate.rules"))
    outcome = run("devices", "--install-udev")
    assert outcome.exit_code == 1 and "sudo" in outcome.stderr and "Traceback" not in outcome.stderr


EMULATED = ["--set", "device.port=emulator", "--set", "sensor.port=emulator"]


def test_a_press_on_both_emulators_gives_the_law_of_the_sample(tmp_path):
    """The example of docs/devices.md with the defaults: the sample has K 3000 N/m^1.5, n 1.5 and c 5 s/m."""
    out = tmp_path / "press.csv"
    recorded = run("fit", "record", out, "--subject", "gel", "--session", "1", "--duration", 4, *EMULATED)
    assert recorded.exit_code == 0, recorded.output
    recording = tmp_path / "press-gel-1.mcap"
    whole = recording.read_bytes()
    again = run("fit", "record", out, "--subject", "gel", "--session", "1", "--duration", 4, *EMULATED)
    assert again.exit_code == 2 and "exists. Use another --session" in again.stderr
    assert recording.read_bytes() == whole, "the second press was rejected before the recording was overwritten"
    lines = [line for line in recorded.stdout.splitlines() if line.startswith("next: ")]
    assert len(lines) == 1 and str(recording) in lines[0]
    assert "8 more sessions" in recorded.stdout
    words = shlex.split(lines[0].removeprefix("next: palpate "), comments=True)
    fitted = run(*words, "--json", "-o", tmp_path / "fit")  # the suggested command works
    assert fitted.exit_code == 0, fitted.output
    values = {name: p["value"] for name, p in json.loads(fitted.stdout)["parameters"].items()}
    forces = [values["stiffness"] * d ** values["exponent"] for d in (1e-3, 3e-3, 5e-3)]  # K and n trade off
    assert forces == pytest.approx([3e3 * d**1.5 for d in (1e-3, 3e-3, 5e-3)], rel=0.06)
    rows = np.array([line.split(",")[2:] for line in out.read_text().splitlines()[1:]], float)
    depth, rate, force = rows[:, 0] * 1e-3, rows[:, 1] * 1e-3, rows[:, 2]
    assert depth == pytest.approx(np.arange(0, 5.1e-3, 0.5e-3))
    error = np.abs(force - 3e3 * depth**1.5 * (1 + 5.0 * rate))
    assert np.sort(error)[-3] < 0.05, error  # a stall of 30 ms delays the reading of one depth
    assert error.max() < 0.3, error
    assert force[0] == pytest.approx(0.0, abs=0.01), "sensor and hand start at the same position"


def test_sessions_of_one_subject_are_counted(tmp_path):
    press = Loading(np.arange(3.0), np.ones(3), np.arange(3.0))
    counts = [add_session(tmp_path / "p.csv", who, name, press) for who, name in ("a1", "a2", "b1")]
    assert counts == [1, 2, 1]


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_depth_starts_where_the_force_exceeds_the_noise(noise):
    forces = (
        noise * np.random.default_rng(0).standard_normal(1000)
        + 3e3 * np.clip(np.arange(1000) - 700, 0, None) ** 1.5 * 1e-7
    )
    first = int(np.argmax(forces > 0.3))
    assert 700 <= _onset(forces[: first + 1]) <= 700 + (40 if noise else 0)


def test_a_session_starts_a_new_line_after_a_missing_line_end(tmp_path):
    file = tmp_path / "p.csv"
    press = Loading(np.arange(3.0), np.ones(3), np.arange(3.0))
    add_session(file, "a", "1", press)
    file.write_text(file.read_text().rstrip())
    add_session(file, "a", "2", press)
    assert [line.split(",")[1] for line in file.read_text().splitlines()[1:]] == ["1"] * 3 + ["2"] * 3


def test_a_file_with_another_header_is_rejected(tmp_path):
    file = tmp_path / "other.csv"
    file.write_text("a,b\n1,2\n")
    with pytest.raises(
        SessionError, match=r"its header is a,b, expected subject,session,depth \[mm\],rate \[mm/s\],force"
    ):
        add_session(file, "a", "1", Loading(np.zeros(1), np.zeros(1), np.zeros(1)))
    assert file.read_text() == "a,b\n1,2\n"


def test_faults_accept_units_and_errors_list_the_known_faults():
    given = "{latency: 2 ms, dropouts: 0.01, garbled: 0.01, glitches: 0.01, noise: 0.2, unplug: 5, back: 8, flaky: 3}"
    graph = find("falcon").but(overrides=("device.port=emulator", f"device.faults={given}")).load()
    assert graph.nodes["device"].settings["faults"]["latency"] == 2e-3
    for wrong, text in (
        ("{latncy: 2 ms}", "unknown key 'latncy'; expected latency, dropouts, garbled"),
        ("{latency: 2 mm}", "expected"),
        ("{dropouts: 5}", "<= 1"),
    ):
        with pytest.raises(GraphError, match=text):
            find("falcon").but(overrides=(f"device.faults={wrong}",)).load()


def test_reconnect_requires_a_device(tmp_path):
    good = run(
        "run",
        "falcon",
        "--set",
        "device.port=emulator",
        "--reconnect",
        "--duration",
        0.2,
        "--no-record",
        "--json",
        "--fused",
    )
    assert good.exit_code == 0, good.output
    wrong = run("run", "kidney", "--reconnect", "--duration", 0.2, "--no-record")
    assert wrong.exit_code == 2 and "no node of this graph drives a device" in wrong.stderr
    graph = tmp_path / "pointed.yaml"
    pointer = f"  pointer: {{use: device.Pointer, socket: {tmp_path}/p}}\n"
    mouse = "  device: {use: device.Mouse, in: {pointer: pointer, torque: statics}}\n"
    graph.write_text("extends: kidney\nnodes:\n" + pointer + mouse)
    wrong = run("run", graph, "--reconnect", "--duration", 0.2, "--no-record")
    assert wrong.exit_code == 2 and "no node of this graph drives a device" in wrong.stderr
