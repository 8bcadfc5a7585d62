"""`palpate devices`, and a press that becomes a session."""

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.drivers import catalogue, discover
from palpate.drivers.falcon.emulator import EmulatedFalcon
from palpate.launch.__main__ import app
from palpate.launch.commands.press import PressError, add_session

FALCON = {"idVendor": "0403", "idProduct": "cb48", "busnum": "1", "devnum": "7", "serial": "FT1"}
PAD = {"idVendor": "0403", "idProduct": "6010", "busnum": "1", "devnum": "8"}
MOUSE = {"idVendor": "046d", "idProduct": "c077", "busnum": "1", "devnum": "9"}


def run(*words):
    return CliRunner().invoke(app, [str(w) for w in words])


@pytest.fixture
def bus(tmp_path, monkeypatch):
    """A kernel's folders with a Falcon, a Dot Pad and an ordinary mouse."""
    usb, dev = tmp_path / "usb", tmp_path / "dev"
    for name, words in {"1-1": FALCON, "1-2": PAD, "1-3": MOUSE}.items():
        (usb / name).mkdir(parents=True)
        for key, word in words.items():
            (usb / name / key).write_text(f"{word}\n")
    (usb / "1-1" / "1-1:1.0").mkdir()
    (tmp_path / "drivers" / "ftdi_sio").mkdir(parents=True)
    (usb / "1-1" / "1-1:1.0" / "driver").symlink_to(tmp_path / "drivers" / "ftdi_sio")
    (usb / "1-2" / "1-2:1.0" / "ttyUSB3").mkdir(parents=True)
    (dev / "bus" / "usb" / "001").mkdir(parents=True)
    (dev / "bus" / "usb" / "001" / "007").touch(mode=0o600)
    (dev / "ttyUSB3").touch()
    monkeypatch.setattr(discover, "USB", usb)
    monkeypatch.setattr(discover, "DEV", dev)
    return dev


def test_devices_lists_what_is_plugged_in(bus):
    data = json.loads(run("devices", "--json").stdout)
    falcon, pad = data["devices"]
    assert (falcon["name"], falcon["use"], falcon["port"]) == ("Novint Falcon", "device.Falcon", "1:7")
    assert falcon["bound"] == "ftdi_sio" and falcon["serial"] == "FT1" and falcon["next"] == ""
    assert pad["use"] == "display.DotPad" and pad["port"] == str(bus / "ttyUSB3")


def test_devices_says_what_to_do_next(bus, monkeypatch):
    (bus / "ttyUSB3").unlink()
    assert "--install-udev" in json.loads(run("devices", "--json").stdout)["devices"][1]["next"]
    monkeypatch.setattr(discover, "_installed", lambda module: False)
    assert 'pip install "palpate[devices]"' in json.loads(run("devices", "--json").stdout)["devices"][0]["next"]
    assert "Novint Falcon" in run("devices").stdout


@pytest.mark.parametrize(("loaded", "told"), [(True, "runs"), (False, "none runs: give the setting `firmware`")])
def test_devices_says_whether_the_firmware_runs(bus, monkeypatch, loaded, told):
    falcon = EmulatedFalcon(loaded=loaded)
    monkeypatch.setattr("palpate.drivers.transport.ftdi.UsbFtdi", lambda vendor, product, name, port: falcon.connect())
    listed = json.loads(run("devices", "--probe", "--json").stdout)["devices"]
    assert [f["firmware"] for f in listed] == [told, ""]
    assert all(words == (0, 0, 0) for _, words in falcon.seen) and falcon.attempts == 0


def test_the_udev_rule_is_written_and_names_every_device(tmp_path, monkeypatch):
    rule = tmp_path / "70-palpate.rules"
    monkeypatch.setattr(catalogue, "RULE", str(rule))
    assert run("devices", "--install-udev").exit_code == 0
    text = rule.read_text()
    assert 'SUBSYSTEM=="usb", ATTRS{idVendor}=="0403", ATTRS{idProduct}=="cb48", MODE="0660"' in text
    assert 'SUBSYSTEM=="hidraw", ATTRS{idVendor}=="256f", MODE="0660"' in text
    for line in text.splitlines():
        assert line.startswith("#") or re.fullmatch(r'[A-Z]+=="\w+"(, [A-Za-z{}]+(==|\+?=)"\w+")+', line), line


def test_a_rule_that_cannot_be_written_says_how(tmp_path, monkeypatch):
    monkeypatch.setattr(catalogue, "RULE", str(tmp_path / "none" / "70-palpate.rules"))
    outcome = run("devices", "--install-udev")
    assert outcome.exit_code == 1 and "sudo" in outcome.stderr and "Traceback" not in outcome.stderr


def test_a_device_is_emulated_from_the_shell():
    data = json.loads(run("devices", "--emulate", "rawhid", "--seconds", "0.5", "--json").stdout)
    assert data["ok"] and data["answers"] > 10
    wrong = run("devices", "--emulate", "omni")
    assert wrong.exit_code == 2 and "falcon" in wrong.stderr


PRESS = [
    "--set", "device.port=emulator", "--set", "sensor.port=emulator", "--set", "device.hand_stiffness=1e5",
    "--set", "device.hand_damping=400", "--set", "sensor.times=[0, 1.0, 3.0]", "--set", "sensor.forces=[0, 0, 4]",
    "--set", "device.path=[{hold: 1.0}, {to: [0, 0, 0.1], time: 2.0, shape: linear}]",
]  # fmt: skip


def test_a_press_becomes_a_session_that_fit_reads(tmp_path):
    """10 mm and 4 N in the same 2 s: 0.4 N for each millimetre."""
    out = tmp_path / "press.csv"
    for name in ("one", "two"):
        outcome = run(
            "record-indentation", out, "--subject", "gel", "--session", name, "--duration", 4.5, "--json", *PRESS
        )
        assert outcome.exit_code == 0, outcome.output
    data = json.loads(outcome.stdout)
    depths, forces = np.array(data["depths"]), np.array(data["forces"])
    assert depths == pytest.approx(np.arange(0, 5.1e-3, 0.5e-3))
    slope = np.polyfit(depths, forces, 1)[0]
    assert slope == pytest.approx(400.0, rel=0.1)
    again = run("record-indentation", out, "--subject", "gel", "--session", "two", "--duration", 4.5, *PRESS)
    assert again.exit_code == 2 and "is there already" in again.stderr
    fitted = run("fit", out, "--law", "power", "--json")
    assert json.loads(fitted.stdout)["ok"], fitted.output


def test_another_file_is_not_added_to(tmp_path):
    file = tmp_path / "other.csv"
    file.write_text("a,b\n1,2\n")
    with pytest.raises(PressError, match=r"its head is a,b, expected subject,session,depth \[mm\],force \[N\]"):
        add_session(file, "a", "1", np.zeros(1), np.zeros(1))
    assert file.read_text() == "a,b\n1,2\n"


def test_reconnect_is_for_graphs_with_a_device(tmp_path):
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
    assert wrong.exit_code == 2 and "no node of this graph talks to a device" in wrong.stderr
    graph = tmp_path / "pointed.yaml"
    pointer = f"  pointer: {{use: device.Pointer, socket: {tmp_path}/p}}\n"
    mouse = "  device: {use: device.Mouse, in: {pointer: pointer, torque: statics}}\n"
    graph.write_text("extends: kidney\nnodes:\n" + pointer + mouse)
    wrong = run("run", graph, "--reconnect", "--duration", 0.2, "--no-record")
    assert wrong.exit_code == 2 and "no node of this graph talks to a device" in wrong.stderr
