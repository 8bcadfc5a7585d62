"""An FMU of a graph, run by FMPy: what it computes is what `palpate run` computes."""

import sys

import fmpy
import numpy as np
import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.stepping import Stepper

TIME = 0.55  # [s] the finger is in the kidney
OUTPUT = ["contact.force", "contact.indentation", "controller.force.z", "statics.torques.x"]


def exported(folder, *more):
    file = folder / "touch.fmu"
    result = CliRunner().invoke(app, ["build", "fmu", "kidney", "-o", str(file), *more])
    assert result.exit_code == 0, result.output
    return str(file)


def simulated(file, until=TIME, step=1e-3, **more):
    return fmpy.simulate_fmu(
        file, stop_time=until, step_size=step, output_interval=step, output=OUTPUT, fmi_type="CoSimulation", **more
    )


@pytest.mark.parametrize("stiffness", [None, 6e3])
def test_its_outputs_are_those_of_a_run_to_the_bit(tmp_path, stiffness):
    file = exported(tmp_path)
    model = fmpy.read_model_description(file, validate=True)
    assert model.fmiVersion == "3.0" and {v.name for v in model.modelVariables} >= {*OUTPUT, "set.tissue.stiffness"}
    units = {v.name: v.unit for v in model.modelVariables}
    assert units["contact.force"] == "N" and units["contact.indentation"] == "m"
    sets = [] if stiffness is None else [f"tissue.stiffness={stiffness}"]
    run = palpate.run("kidney", duration=TIME, sets=sets, record=tmp_path / "run.mcap")
    start = {} if stiffness is None else {"set.tissue.stiffness": stiffness}
    found = simulated(file, start_values=start)
    count = len(run.contact.force)
    assert found["contact.force"].max() > 0.1 and count == round(TIME * 1000)
    for name, field in (("contact.force", run.contact.force), ("contact.indentation", run.contact.indentation)):
        assert np.array_equal(found[name][:count], np.asarray(field))
    assert np.array_equal(found["controller.force.z"][:count], np.asarray(run.controller.force)[:, 2])
    assert np.array_equal(found["statics.torques.x"][:count], np.asarray(run.statics.torques)[:, 0])


def test_a_steered_hand_follows_its_input(tmp_path):
    file = exported(tmp_path, "--set", "device.use=device.Steered")
    down = np.array([(0.0, -0.08), (TIME, -0.08)], dtype=[("time", np.float64), ("device.velocity.z", np.float64)])
    found = simulated(file, input=down)
    stepper = Stepper(find("kidney").but(overrides=["device.use=device.Steered"]))
    stepper.start()
    forces = []
    for number in range(round(TIME * 1000)):
        if number:
            stepper.node("device").steer([0.0, 0.0, -0.08])
        forces.append(stepper.tick().contact.force)
    stepper.stop()
    assert max(forces) > 0.1 and np.array_equal(found["contact.force"][: len(forces)], forces)


def test_a_step_that_is_no_whole_number_of_ticks_is_refused(tmp_path):
    with pytest.raises(fmpy.fmi1.FMICallException):
        simulated(exported(tmp_path), until=0.01, step=0.0015)


def test_a_graph_of_ones_own_with_a_class_of_ones_own_whatever_its_name(tmp_path, monkeypatch):
    """What runs the unit has not imported the class, and the name of the file begins with no letter."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "soft_organ.py").write_text(
        "from palpate.nodes.deformation import MassSpring\n\n\nclass Soft(MassSpring):\n    stiffness = 1e3\n"
    )
    (tmp_path / "3-soft.yaml").write_text("extends: kidney\nnodes: {tissue: {use: soft_organ.Soft}}\n")
    result = CliRunner().invoke(app, ["build", "fmu", "3-soft.yaml"])
    assert result.exit_code == 0, result.output
    sys.modules.pop("soft_organ")
    assert simulated("3-soft.fmu")["contact.force"].max() > 0.1


def test_what_is_not_for_it_is_refused(tmp_path):
    assert CliRunner().invoke(app, ["export", "a.mcap", "--to", "csv", "--set", "rate=500"]).exit_code == 2
    result = CliRunner().invoke(app, ["build", "fmu", "kidney", "-o", str(tmp_path / "no" / "k.fmu")])
    assert result.exit_code != 0 and "k.fmu" in result.output + str(result.exception)


def test_a_graph_with_a_device_is_refused(tmp_path):
    result = CliRunner().invoke(app, ["build", "fmu", "falcon", "-o", str(tmp_path / "f.fmu")])
    assert result.exit_code != 0 and "'device' drives a device" in result.output + str(result.exception)


def test_without_pythonfmu_it_says_what_to_install(tmp_path, monkeypatch):
    for name in ("pythonfmu3", "pythonfmu3.builder"):
        monkeypatch.setitem(sys.modules, name, None)
    result = CliRunner().invoke(app, ["build", "fmu", "kidney", "-o", str(tmp_path / "k.fmu")])
    assert result.exit_code != 0 and 'pip install "palpate[fmu]"' in result.output + str(result.exception)
