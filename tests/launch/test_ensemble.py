"""Parallel touches: each lane of an ensemble is bit-equal to its single run."""

import subprocess
import sys
import threading

import numpy as np
import pytest
from expected_notes import BEYOND, COARSE, ENERGY, FAST, FLAT, RIGID, STIFF, UNTAKEN

import palpate
from palpate.launch.load.launchfile import find
from palpate.launch.run import lane_runner, lane_values
from palpate.launch.run.busy import free_memory
from palpate.physics.errors import ArgumentError, RunError

TOUCH = (
    "scene.surface.vertices=600", "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.0935], time: 0.1}, {to: [0.01, 0, 0.0925], time: 0.1},"
    "{to: [0, 0, 0.113], time: 0.1}]",
)  # fmt: skip
KEEP = ("contact.force", "controller.force", "tissue.rest_indentation")
LANES = 6


def ensemble(body="deformation.MassSpring", over=None, **given):
    given = {"keep": KEEP, "sets": TOUCH, "duration": 0.3} | given
    return palpate.Ensemble("kidney", given.pop("lanes", LANES), over, tissue=body, **given)


def single(body, sets, duration=0.3):
    """The fields of KEEP from `palpate.steps`, one row per tick."""
    ticks = palpate.steps("kidney", sets=(*TOUCH, *sets), duration=duration, tissue=body)
    return np.array([(t.contact.force, *t.controller.force, t.tissue.rest_indentation) for t in ticks])


def table(data, lane):
    return np.column_stack([np.asarray(data[name])[lane] for name in KEEP])


@pytest.mark.parametrize(
    "body",
    [
        "deformation.MassSpring", "deformation.Rigid", "deformation.BeamBundle",
        pytest.param("deformation.ReducedFE", marks=pytest.mark.long),
    ],
)  # fmt: skip
@pytest.mark.notes(ENERGY, COARSE)
@pytest.mark.notes(UNTAKEN, body=("deformation.Rigid", "deformation.BeamBundle"))
@pytest.mark.notes(FLAT, RIGID, STIFF, body="deformation.Rigid")
def test_a_lane_equals_its_single_run(body):
    drawn = np.random.default_rng(11)
    over = {
        "scene.finger.finger_damping": drawn.uniform(5.0, 11.0, LANES),
        "friction.mu_slide": drawn.uniform(0.3, 0.6, LANES),
        "scene.hand.path": [
            [{"to": [float(x), 0.0, 0.0935], "time": 0.1}, {"hold": float(hold)}]
            for x, hold in zip(drawn.uniform(-5e-3, 5e-3, LANES), drawn.uniform(0.01, 0.1, LANES), strict=True)
        ],
    }
    data = ensemble(body, over).run(quiet=True)
    assert np.asarray(data["contact.force"]).max() > 0.5
    for lane in drawn.choice(LANES, 2, replace=False).tolist():
        path = ", ".join(str(part).replace("'", "") for part in over["scene.hand.path"][lane])
        sets = [
            f"scene.finger.finger_damping={float(over['scene.finger.finger_damping'][lane])!r}",
            f"friction.mu_slide={float(over['friction.mu_slide'][lane])!r}",
            f"scene.hand.path=[{path}]",
        ]
        assert table(data, lane).tobytes() == single(body, sets).tobytes()


@pytest.mark.notes(COARSE, STIFF)
def test_results_do_not_depend_on_other_lanes_or_threads():
    over = {"tissue.stiffness": np.linspace(2e3, 4e3, LANES)}
    one, many = (ensemble(over=over, threads=threads).run(quiet=True) for threads in (1, 4))
    alone = ensemble(over={"tissue.stiffness": 2e3}, lanes=1).run(quiet=True)
    for name in KEEP:
        assert np.asarray(one[name]).tobytes() == np.asarray(many[name]).tobytes()
        assert np.asarray(one[name])[0].tobytes() == np.asarray(alone[name])[0].tobytes()
    assert len({np.asarray(one["contact.force"])[lane].tobytes() for lane in range(LANES)}) == LANES


@pytest.mark.notes(UNTAKEN, STIFF, COARSE, FAST, FLAT, RIGID)
def test_lanes_of_different_bodies_and_effects_equal_their_single_runs():
    """Each combination of nodes is started once, in whatever order its lanes come."""
    bodies = ["deformation.MassSpring", "deformation.Rigid", "deformation.BeamBundle"]
    over = {"tissue.use": bodies * 2, "scene.tissue.friction": [True] * 3 + [False] * 3,
            "scene.finger.finger_damping": np.linspace(6.0, 9.0, LANES)}  # fmt: skip
    data = ensemble(over=over).run(quiet=True)
    assert [str(value) for value in data["tissue.use"].values] == bodies * 2
    for lane in range(LANES):
        sets = [f"scene.finger.finger_damping={float(over['scene.finger.finger_damping'][lane])!r}",
                f"scene.tissue.friction={'true' if lane < 3 else 'false'}"]  # fmt: skip
        assert table(data, lane).tobytes() == single(bodies[lane % 3], sets).tobytes(), lane


@pytest.mark.notes(COARSE, STIFF)
def test_results_have_units_times_and_varied_settings():
    pytest.importorskip("xarray")
    asked = ensemble(over={"tissue.stiffness": [1e3, 2e3]}, lanes=2, every=10)
    data = asked.run(quiet=True)
    assert data["controller.force"].dims == ("lane", "time", "axis") and data["controller.force"].units == "N"
    assert data["tissue.stiffness"].values.tolist() == [1e3, 2e3]
    whole = ensemble(over={"tissue.stiffness": [1e3, 2e3]}, lanes=2).run(quiet=True)
    assert data["time"].values.tolist() == whole["time"].values[::10].tolist()
    assert (data["contact.force"].values == whole["contact.force"].values[:, ::10]).all()
    assert 0 < asked.memory.lanes < 2 * 60_000 and asked.memory.shared > 0


@pytest.mark.notes(COARSE)
def test_without_xarray_results_are_arrays_with_units(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    data = ensemble(lanes=1, duration=0.01).run(quiet=True)
    assert data["contact.force"].unit == "N" and data["contact.force"].shape == (1, 10) and len(data["time"]) == 10


NODES = '''
from typing import Annotated
import numpy as np
from palpate.messages import Contact, DeviceState, Force, Friction, Ledger, Pose
from palpate.nodes import CompiledNode, Out
from palpate.compiler.kernel import kernel

class Spring(CompiledNode):
    """A wall that becomes infinitely stiff, divides by zero or sets a fault, according to `how`."""

    how: Annotated[int, "1"] = 0

    @kernel
    def compute(
        own, contact: Contact | None, friction: Friction | None, pose: Pose, ledger: Ledger | None,
        device: DeviceState | None, out: Out[Force], dt,
    ):
        if pose.position[2] < 0.1:
            if own.how == 1:
                out.force[1] = np.inf
            elif own.how == 2:
                out.force[1] = 1.0 / (own.how - 2)
            elif own.how == 3:
                own.fault = 7

    def start(self):
        if self.how == 4:
            raise ValueError("this one does not start")
        super().start()

    def explain(self, fault, *messages):
        return ValueError(f"too deep: {fault}, {messages[2].position[2] < 0.1}")
'''


@pytest.fixture
def spring(tmp_path, monkeypatch):
    (tmp_path / "springs.py").write_text(NODES)
    monkeypatch.syspath_prepend(str(tmp_path))
    return {"use": "springs.Spring"}


@pytest.mark.notes(COARSE, BEYOND, FAST)
def test_a_lane_that_fails_is_reported_and_the_others_finish(spring):
    asked = ensemble(over={"controller.how": [0, 1, 2, 3, 4, 0]}, controller=spring)
    with pytest.warns(RuntimeWarning, match="4 of 6 lanes failed:\nlane 1 .*how=1.*'controller', step at tick"):
        data = asked.run(quiet=True)
    errors = [str(error) for error in np.asarray(data["error"])]
    assert errors[0] == errors[5] == ""
    assert "force" in errors[1] and "inf" in errors[1]
    assert "division" in errors[2] and "too deep: 7, True" in errors[3] and "does not start" in errors[4]
    force = np.asarray(data["contact.force"])
    assert np.isfinite(force[[0, 5]]).all() and force[0].tobytes() == force[5].tobytes()
    tick = int(errors[3].split("tick ")[1].split(":")[0])
    assert force[3, :tick].tobytes() == force[0, :tick].tobytes() and np.isnan(force[3, tick:]).all()
    with pytest.raises(RunError, match="2 of 2 lanes failed"):
        ensemble(over={"controller.how": 3}, lanes=2, controller=spring).run(quiet=True)


@pytest.mark.parametrize(
    ("given", "printed"),
    [
        ({"over": {"tissue.stiffness": [1e3, 2e3]}}, "found 2 values, expected 6"),
        ({"over": {"stiffness": 1e3}}, "expected a setting, such as tissue.stiffness"),
        ({"over": {"tissue.stifness": 1e3}}, "stifness"),
        ({"over": {"tissue.stiffness": [1e3, 2e3, -1.0, 1e3, 1e3, 1e3]}}, "lane 2"),
        ({"over": {"scene.hand.begin": [[0, 0, 0.11]] * 4 + [[0, 0, 0.5]] * 2}}, "lane 4: .*out of its reach"),
        (
            {"over": {"scene.tissue.friction": [True, False] * 3}, "keep": ["friction.force"]},
            "lane 1.*keep 'friction.force': node 'friction' does not run",
        ),
        ({"keep": ["contact.forse"]}, "no field 'forse'"),
        ({"keep": ["contacts.force"]}, "no stream 'contacts'"),
        ({"keep": ["tissue.displacement"]}, "change in length"),
        ({"keep": []}, "keep: found nothing"),
        ({"lanes": 0}, "lanes: found 0"),
    ],
)
def test_wrong_input_is_an_error_with_a_remedy(given, printed):
    with pytest.raises(palpate.PalpateError, match=f"(?s){printed}"):
        ensemble(**given)


@pytest.mark.notes(COARSE)
def test_results_that_do_not_fit_into_the_memory_are_refused_with_the_number_that_does(monkeypatch):
    with pytest.raises(ArgumentError, match=r"GB are free; expected at most \d+ lanes, .*touches.zarr"):
        ensemble(lanes=10**6, duration=1e4).run()
    monkeypatch.setattr("palpate.ensemble.free_memory", lambda: (1 << 28) + 1e6)
    with pytest.raises(ArgumentError, match=r"expected at most (\d+) lanes") as caught:
        ensemble(lanes=2000).run()
    fits = int(str(caught.value).split("at most ")[1].split()[0])
    assert 75 < fits <= 83  # of (1 + 3 + 1) * 8 bytes * 300 ticks
    ensemble(lanes=fits, duration=0.01).run(quiet=True)


def test_free_memory_is_that_of_the_machine_and_of_the_group_of_processes(tmp_path):
    system = tmp_path / "meminfo"
    assert free_memory(tmp_path, system) == float("inf")
    system.write_text("MemTotal: 4 kB\nMemAvailable:    3 kB\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert free_memory(tmp_path, system) == 3072.0
    (tmp_path / "memory.max").write_text("2000\n")
    (tmp_path / "memory.current").write_text("500\n")
    assert free_memory(tmp_path, system) == 1500.0


def test_nodes_in_python_and_devices_are_errors_with_their_names():
    with pytest.raises(ArgumentError, match=r"'sensor' .*runs in Python"):
        palpate.Ensemble("softness", 2, keep=["sensor.force"], duration=0.1)
    with pytest.raises(ArgumentError, match="drives a device"):
        palpate.Ensemble("falcon", 2, duration=0.1)


def test_ctrl_c_ends_the_threads_within_a_block(monkeypatch):
    asked = ensemble(over={"tissue.stiffness": np.linspace(2e3, 4e3, 64)}, lanes=64, duration=60.0, every=1000)
    before, calls = threading.active_count(), []

    def interrupted(ticks):
        calls.append(ticks)
        raise KeyboardInterrupt

    run = lane_runner.LaneRunner.run
    monkeypatch.setattr(
        lane_runner.LaneRunner, "run", lambda self, prepare, columns, done: run(self, prepare, columns, interrupted)
    )
    with pytest.raises(KeyboardInterrupt):
        asked.run(quiet=True)
    assert len(calls) == 1 and threading.active_count() == before


READ_ONLY = """
import ctypes, mmap, sys
import numpy as np
import palpate
from palpate.launch.load.launchfile import find
from palpate.launch.run import lanes

libc = ctypes.CDLL(None, use_errno=True)

class ReadOnly(dict):
    "Arrays that a kernel cannot write to: a write would crash the process."

    def setdefault(self, key, array):
        if key not in self:
            memory = mmap.mmap(-1, max(array.nbytes, 1))
            copy = np.frombuffer(memory, array.dtype, array.size).reshape(array.shape)
            copy[...] = array
            address = copy.__array_interface__["data"][0]
            assert libc.mprotect(ctypes.c_void_p(address), ctypes.c_size_t(len(memory)), 1) == 0
            self[key] = copy
        return self[key]

lanes.Pool = ReadOnly
for body in sys.argv[2:]:
    keep = ["contact.force", "tissue.rest_indentation"]
    given = palpate.Ensemble("kidney", 2, keep=keep, sets=eval(sys.argv[1]), duration=0.3, tissue=body)
    assert len(given._prepared) == 2
    print(body, float(np.asarray(given.run(quiet=True)["contact.force"]).max()) > 0.5, given.memory[1] > 0)
"""


@pytest.mark.long
def test_no_kernel_writes_to_shared_arrays():
    bodies = [f"deformation.{name}" for name in ("MassSpring", "Rigid", "BeamBundle", "ReducedFE")]
    command = [sys.executable, "-c", READ_ONLY, repr(TOUCH), *bodies]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [word for body in bodies for word in (body, "True", "True")]


def test_numbers_that_reach_settings_unchanged_load_the_graph_only_a_few_times(monkeypatch):
    loads = []
    prepare = lane_values.prepare
    monkeypatch.setattr(lane_values, "prepare", lambda launch, keep: loads.append(1) or prepare(launch, keep))
    drawn = np.random.default_rng(2)
    over = {"tissue.stiffness": drawn.uniform(1e3, 2e3, 40), "scene.finger.finger_damping": drawn.uniform(5, 9, 40),
            "device.seed": list(range(40))}  # fmt: skip
    few = ensemble(over={name: over[name] for name in list(over)[:2]}, lanes=40)
    assert len(loads) <= 6
    many = ensemble(over=over, lanes=40)  # the graph is loaded for each lane if values are integers
    assert len(loads) > 40
    for one, other in zip(few._prepared, many._prepared, strict=True):
        for a, b in zip(one.job.nodes, other.job.nodes, strict=True):
            settings = [{k: v for k, v in node.settings.items() if k != "seed"} for node in (a, b)]
            assert settings[0] == settings[1]


@pytest.mark.parametrize("known", [1, 2, 3, 5])
def test_results_do_not_depend_on_the_number_of_graphs_in_memory(monkeypatch, known):
    """Lanes of three bodies in turn, more than are kept: their graphs are loaded again."""
    tissues = ["deformation.MassSpring", "deformation.Rigid", "deformation.BeamBundle"]
    values = [11.0, 10.0, 9.0, 8.0, 7.0, 6.0]
    over = {"tissue.use": tissues * 2, "scene.finger.finger_damping": values}
    expected = [one.job for one in prepared(over)]
    monkeypatch.setattr(lane_values, "KNOWN", known)
    assert [one.job for one in prepared(over)] == expected
    found = [[node.settings.get("finger_damping") for node in job.nodes if node.name == "contact"] for job in expected]
    assert found == [[value] for value in values]


def prepared(over):
    launch = find("kidney").but(duration=0.1, overrides=TOUCH)
    prepare = lane_values.Preparation(
        lambda values: lane_values.prepare(lane_values.with_values(launch, values, 0), [("contact", "force")]),
        {path: lane_values.extremes(values) for path, values in over.items()},
    )
    return [prepare({path: values[lane] for path, values in over.items()}) for lane in range(LANES)]
