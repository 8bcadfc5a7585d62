"""Studies on real workers: stored results, and their state after errors."""

import fcntl
import json
import math
import re
import resource
import shutil
import time

import numba
import numpy as np
import pyarrow.parquet
import pytest
from expected_notes import STIFF

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.lane_values import extremes
from palpate.launch.run.tasks import runner
from palpate.physics.errors import PalpateError, RunError
from palpate.studies.sweeps import lane as lanes
from palpate.studies.sweeps import recorded as recording
from palpate.studies.sweeps.store import Store
from palpate.studies.sweeps.task import PointTask

KEEP = ("peak ball.force", "mean ball.force", "at 2 ms ball.indentation", "curve ball.force")
BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""
OVER = {"ball.young": [1e4, 2e4, 4e4], "ball.depth": ["1 mm", "2 mm"]}


@pytest.fixture
def ball(write):
    return write("ball.yaml", BALL)


@pytest.fixture
def printed():
    return []


def hertz(young, depth, radius=8e-3, poisson=0.5):
    return 4.0 / 3.0 * young / (1.0 - poisson**2) * math.sqrt(radius) * depth**1.5


def compute(task, *points):
    """The results of points in this process."""
    found = dict(task.compute(points))
    return [found[place] for place in range(len(points))]


def computed(study, folder, pool, **options):
    """Runs a study; the numbers of the points that it computed."""
    numbers = []
    study.run(folder, pool, done=lambda point, done, left: numbers.append(point.slot), **options)
    return sorted(numbers)


def test_a_row_for_each_point_with_numbers_and_curves(ball, pool, tmp_path):
    study = palpate.Study(ball, OVER, KEEP)
    assert computed(study, tmp_path, pool) == list(range(6))
    table = study.table()
    assert (
        list(table["ball.young"]) == [1e4, 1e4, 2e4, 2e4, 4e4, 4e4]
        and list(table["ball.depth"]) == ["1 mm", "2 mm"] * 3
    )
    depth = table["ball.depth"].map({"1 mm": 1e-3, "2 mm": 2e-3})
    forces = [hertz(e, d) for e, d in zip(table["ball.young"], depth, strict=True)]
    assert table["peak ball.force"].to_numpy() == pytest.approx(forces, rel=1e-12)
    shares = np.arange(1, 6) / 5
    assert table["mean ball.force"].to_numpy() == pytest.approx(np.array(forces) * np.mean(shares**1.5), rel=1e-12)
    assert table["at 2 ms ball.indentation"].to_numpy() == pytest.approx(depth * 3 / 5, rel=1e-12)
    units = table.attrs["units"]
    assert (units["peak ball.force"], units["ball.young"]) == ("N", "Pa") and not table["error"].any()
    assert "ball.depth" not in units  # its values are texts with a unit
    data = study.xarray()
    assert data["curve ball.force"].dims == ("ball.young", "ball.depth", "time")
    curve = data["curve ball.force"].sel({"ball.young": 2e4, "ball.depth": "2 mm"})
    assert curve.to_numpy() == pytest.approx(hertz(2e4, 2e-3) * shares**1.5, rel=1e-12)
    assert data["time"].to_numpy() == pytest.approx(np.arange(5) * 1e-3) and data["curve ball.force"].units == "N"
    assert data["ball.young"].units == "Pa"


@pytest.mark.notes(STIFF)
def test_the_bytes_do_not_depend_on_the_number_of_workers(pool, tmp_path):
    """On the shipped kidney: two workers, one worker, and `palpate.run` in this process."""
    over = {"tissue.stiffness": [2.5e3, 3.5e3], "hand": {"named": {"fast": press(0.05), "slow": press(0.08)}}}
    arguments = {"keep": ["peak contact.force", "curve contact.force"], "duration": 0.15}
    several = palpate.Study("kidney", over, **arguments).run(tmp_path / "two", pool)
    palpate.Study("kidney", over, **arguments).run(tmp_path / "one", workers=1)
    for file in (tmp_path / "two").rglob("*"):
        if file.is_file() and file.name not in ("log.jsonl", ".lock", "workers.log"):
            assert file.read_bytes() == (tmp_path / "one" / file.relative_to(tmp_path / "two")).read_bytes(), file
    assert not several.table()["error"].any()
    curves = several.xarray()["curve contact.force"].to_numpy().reshape(4, -1)
    assert curves.max() > 0.1
    for row, curve in zip(several.points, curves, strict=True):
        sets = [f"{path}={json.dumps(value)}" for path, value in row.values.items()]
        run = palpate.run("kidney", duration=0.15, record=tmp_path / f"{row.slot}.mcap", sets=sets)
        assert np.asarray(run.contact.force).tobytes() == curve.tobytes()


def test_lanes_give_the_results_of_separate_runs(monkeypatch):
    """Two structures, lanes that are used again; the results equal those of recorded runs, byte for byte."""
    over = {"tissue.use": ["deformation.MassSpring", "deformation.Rigid"], "hand": [press(0.05), press(0.08)]}
    keep = ("peak contact.force", "at 0.1 s controller.force[2]", "mean controller.force", "curve contact.indentation")
    study = palpate.Study("kidney", over, keep, duration=0.15)
    task, ran, execute = PointTask(study.launch, study.keep), [], recording.execute
    points = [study.points[place] for place in (0, 2, 1, 3)]
    compute(task, points[0])  # compiles
    monkeypatch.setattr(recording, "execute", lambda *given: ran.append(given) or execute(*given))
    for module in (recording, lanes):
        monkeypatch.setattr(module, "warm", lambda *given: None)
    together, one_by_one = compute(task, *points), [compute(task, point)[0] for point in points]
    assert not ran
    monkeypatch.setattr(lanes, "compute", lambda *given: ())
    for place, single in enumerate(compute(task, *points)):
        for lane in (together[place], one_by_one[place]):
            assert lane.error == single.error == "" and lane.numbers == single.numbers and lane.numbers
            for name, curve in single.curves.items():
                assert all(a.tobytes() == b.tobytes() for a, b in zip(curve, lane.curves[name], strict=True))
    assert len(ran) == 4 and len({lane.numbers["peak contact.force"] for lane in together}) > 2


@pytest.mark.parametrize(("values", "loaded"), [([20.0, 30.0, 24.0, 23.0, 28.0], 4), ([20.0, -1.0, 24.0], 9)])
def test_numbers_that_reach_settings_unchanged_load_the_graph_a_few_times(monkeypatch, values, loaded):
    """For each of two bodies; if an extreme value is invalid, each point loads the graph, an invalid one twice."""
    over = {"tissue.use": ["deformation.MassSpring", "deformation.Rigid"], "contact.finger_stiffness": values}
    study, loads = palpate.Study("kidney", {**over, "hand": [press(0.05)]}, ("peak contact.force",), duration=0.15), []
    varied = {path: extremes(values) for path, values in study.space.columns().items()}
    points = study.points
    single = [compute(PointTask(study.launch, study.keep), point)[0] for point in points]
    load = LaunchFile.load
    monkeypatch.setattr(LaunchFile, "load", lambda launch: loads.append(1) or load(launch))
    task = PointTask(study.launch, study.keep, None, varied)
    several = compute(task, *points)
    assert [one.numbers for one in several] == [one.numbers for one in single]
    assert [one.error for one in several] == [one.error for one in single]
    assert len({one.numbers["peak contact.force"] for one in several if not one.error}) == 2 * sum(
        v > 0 for v in values
    )
    assert len(loads) <= loaded


def press(time):
    return {"hand_stiffness": 500, "hand_damping": 10, "mass": 0.2, "begin": [0, 0, 0.1095],
            "path": [{"to": [0, 0, 0.104], "time": time}, {"hold": 0.1}]}  # fmt: skip


def test_a_second_run_computes_missing_points_and_reports_changes(ball, pool, tmp_path, printed):
    assert computed(palpate.Study(ball, OVER, KEEP), tmp_path, pool) == list(range(6))
    assert computed(palpate.Study(ball, OVER, KEEP), tmp_path, pool, report=printed.append) == []
    assert printed == ["6 points, 6 stored, 0 to compute"]
    more = palpate.Study(ball, OVER | {"ball.young": [1e4, 1.5e4, 2e4, 4e4]}, KEEP)
    printed.clear()
    assert len(computed(more, tmp_path, pool, report=printed.append)) == 2
    changed = "changed: study.over.ball.young: 4 values, 10000 to 40000, was 3 values, 10000 to 40000"
    assert changed in printed and printed[-1] == "8 points, 6 stored, 2 to compute"
    assert more.table()["peak ball.force"].to_numpy()[2] == pytest.approx(hertz(1.5e4, 1e-3))
    assert more.xarray()["curve ball.force"].to_numpy()[1, 0, -1] == pytest.approx(hertz(1.5e4, 1e-3))
    other = palpate.Study(ball, OVER, KEEP, sets=["ball.radius=4 mm"])
    printed.clear()
    assert len(computed(other, tmp_path, pool, report=printed.append)) == 6
    assert any("changed: graph.nodes.ball.radius: 4 mm, was nothing" in line for line in printed)
    assert other.table()["peak ball.force"][0] == pytest.approx(hertz(1e4, 1e-3, radius=4e-3))
    assert computed(palpate.Study(ball, OVER, KEEP), tmp_path, pool) == [], "the former study is complete"
    assert len(Store(tmp_path, write=False).rows) == 14


@pytest.mark.parametrize("what", ["removed", "cut", "empty", "all", "times removed"])
def test_points_whose_curves_were_damaged_are_computed_again(ball, pool, tmp_path, what):
    """The rows were kept, and the curves of a missing file were NaN."""
    study = palpate.Study(ball, OVER, KEEP)
    whole = study.run(tmp_path, pool).xarray()["curve ball.force"].to_numpy().copy()
    name = "curve ball.force time" if what == "times removed" else "curve ball.force"
    file = next(each for each in sorted((tmp_path / "curves.zarr" / name / "c").rglob("*")) if each.is_file())
    content = file.read_bytes()
    match what:
        case "all":
            shutil.rmtree(tmp_path / "curves.zarr")
        case "cut":
            file.write_bytes(content[: len(content) // 2])
        case "empty":
            file.write_bytes(b"")
        case _:
            file.unlink()
    with pytest.warns(RuntimeWarning, match=r"the curves of 6 points were changed or removed"):
        Store(tmp_path, write=False)
    with pytest.warns(RuntimeWarning, match=r"the curves of 6 points were changed or removed"):
        assert len(computed(palpate.Study(ball, OVER, KEEP), tmp_path, pool)) == 6
    again = palpate.Study(ball, OVER, KEEP)
    assert computed(again, tmp_path, pool) == []
    assert np.array_equal(again.xarray()["curve ball.force"].to_numpy(), whole)


def test_curves_of_different_lengths_are_stored_in_one_folder(ball, pool, tmp_path):
    long, short = (palpate.Study(ball, OVER, KEEP, duration=d).run(tmp_path, pool) for d in ("8 ms", "3 ms"))
    for study, count in ((long, 8), (short, 3)):
        curve = study.xarray()["curve ball.force"]
        assert curve.shape == (3, 2, count) and curve.notnull().all()
    rates = palpate.Study(ball, {"rate": [1000, 2000]}, ["curve ball.force"]).run(tmp_path / "rates", pool).xarray()
    assert rates["curve ball.force"].dims == ("rate", "tick") and rates["time"].dims == ("rate", "tick")
    assert rates["time"].sel(rate=2000).to_numpy() == pytest.approx(np.arange(10) * 5e-4)
    assert rates["curve ball.force"].sel(rate=1000).notnull().sum() == 5


def test_workers_that_cannot_start_end_the_study(ball, tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "SERVE", "raise SystemExit('no room for workers')")
    with pytest.raises(RunError, match=r"ended at its start: exit code 1; \S*workers\.log has what it printed"):
        palpate.Study(ball, OVER, KEEP).run(tmp_path)
    assert "no room for workers" in (tmp_path / "workers.log").read_text()


def test_a_recording_in_the_working_folder_is_no_dependency(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    study = palpate.Study("kidney", {"tissue.stiffness": [2e3, 3e3]}, ["peak contact.force"])
    (tmp_path / "palpate.mcap").write_bytes(b"the default file of logger.Mcap")
    assert palpate.Study("kidney", {"tissue.stiffness": [2e3, 3e3]}, ["peak contact.force"]).points == study.points


def test_changed_code_of_a_custom_class_makes_new_points(write, monkeypatch, tmp_path):
    write("mylab_sweep.py", "from nodes_for_studies import Ball as _Ball\nclass Ball(_Ball):\n    pass\n")
    graph = write("own.yaml", BALL.replace("nodes_for_studies", "mylab_sweep"))
    monkeypatch.syspath_prepend(tmp_path)
    first = palpate.Study(graph, OVER, KEEP)
    assert palpate.Study(graph, OVER, KEEP).points == first.points
    write("mylab_sweep.py", "from nodes_for_studies import Ball as _Ball\nclass Ball(_Ball):\n    poisson = 0.4\n")
    assert not {point.key for point in palpate.Study(graph, OVER, KEEP).points} & {point.key for point in first.points}


def test_the_compilation_of_kernels_is_not_counted(ball, tmp_path, monkeypatch):
    """Neither while this process compiles them nor while it waits for another one that does."""
    folder = tmp_path / "kernels-of-this-test"
    folder.mkdir()
    monkeypatch.setattr(recording.kernel_cache, "folder", lambda: folder)
    monkeypatch.setattr(recording, "_warmed", set())
    monkeypatch.setattr(recording, "execute", lambda *_: numba.njit(lambda x: x + 1.0)(1.0))
    graph = LaunchFile(graph=ball)
    reported = []
    with open(folder / "warm.lock", "a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)

        def begins():
            reported.append(time.monotonic())
            if len(reported) == 3:
                fcntl.flock(held, fcntl.LOCK_UN)

        recording.warm(graph, graph.load(), begins)
    assert len(reported) == 4 and [file.name for file in folder.glob("warm-*")]
    recording.warm(graph, graph.load(), begins)
    assert len(reported) == 4


def test_points_that_fail_are_rows_with_their_error(ball, pool, tmp_path):
    over = {"ball.young": [1e4, 2e4], "ball.what": ["", "fail", "kill", "hang"]}
    study = palpate.Study(ball, over, ["peak ball.force"], limit="2 s")
    assert computed(study, tmp_path, pool) == list(range(8))
    errors = list(study.table()["error"])
    assert errors == 2 * [
        "",
        "node 'ball', start: ValueError: the mesh is inside out",
        "its process ended: SIGKILL",
        "took longer than 2 s",
    ]
    assert study.table()["peak ball.force"].isna().tolist() == [False, True, True, True] * 2
    assert computed(study, tmp_path, pool) == [], "they are not computed again"
    study.limit = 10.0
    assert computed(palpate.Study(ball, {**over, "ball.what": ["", "fail"]}, ["peak ball.force"]), tmp_path, pool,
                    retry=True) == [1, 5]  # fmt: skip


LIMITED = BALL.replace("Ball", "Limited")


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("law", "lowest"),
    [
        ({"norm": [0.0, 2e-3]}, 0.0),
        ({"uniform": ["-3 mm", "2 mm"]}, 0.0),
        ({"uniform": [-3e-3, -1e-3]}, 0.0),
    ],
)
def test_a_sample_out_of_range_is_a_row_at_any_position(write, pool, tmp_path, seed, law, lowest):
    """Also as the first sample, and if all samples are out of range."""
    graph = write("ball.yaml", LIMITED)
    study = palpate.Study(graph, {"ball.radius": law}, KEEP[:1], samples=5, seed=seed, design="random")
    assert computed(study, tmp_path / "out", pool) == list(range(5))
    table = study.table()
    bad = table["ball.radius"] <= lowest
    assert bad.any() and list(table["error"].str.contains("expected a number > 0")) == list(bad)
    assert table["peak ball.force"].notna().tolist() == list(~bad)


def test_a_list_may_begin_with_a_value_out_of_range(write, pool, tmp_path):
    over = {"ball.radius": [-1e-3, 2e-3], "ball.young": {"linspace": [-1e3, 2e3, 3]}}
    study = palpate.Study(write("ball.yaml", LIMITED), over, ["peak ball.force"]).run(tmp_path / "out", pool)
    assert (study.table()["error"] == "").tolist() == [False, False, False, False, True, True]
    assert study.axis_label("ball.radius") == "ball.radius [m]"


@pytest.mark.parametrize(
    ("over", "printed"),
    [
        ({"ball.radius": {"norm": [0.0, 1e-3]}, "ball.yuong": {"norm": [1e3, 1.0]}}, "setting 'yuong': unknown"),
        ({"ball.radius": {"norm": ["0 s", "1 s"]}}, "a time; expected a length"),
        ({"ball.radius": [-1e-3]}, "found -0.001; expected a number > 0"),
    ],
)
def test_an_error_independent_of_the_values_is_reported_before_anything_runs(write, over, printed):
    samples = 4 * any(isinstance(value, dict) for value in over.values())
    with pytest.raises(GraphError, match=re.escape(printed)) as raised:
        palpate.Study(write("ball.yaml", LIMITED), over, KEEP, samples=samples, seed=1)
    assert len(raised.value.faults) == 1


def test_a_long_point_delays_no_other_point(ball, pool, tmp_path):
    """It is started first, on one of two workers; the short ones run on the other."""
    gate, order = tmp_path / "gate", []
    points = [(str(gate), 1e4), *(("", 1e3 * k) for k in range(1, 13))]
    study = palpate.Study(ball, {"ball.gate, ball.young": points}, ["peak ball.force"])

    def done(point, done, left):
        order.append(point.slot)
        if len(order) == 12:
            gate.touch()

    study.run(tmp_path / "study", pool, done=done)
    assert order[-1] == 0 and len(order) == 13 and not study.table()["error"].any()


def test_ctrl_c_keeps_the_finished_points(ball, pool, tmp_path):
    study, done = palpate.Study(ball, {"ball.pause": list(np.arange(10) * 0.01)}, KEEP), []

    def interrupt(point, computed, left):
        done.append(point.slot)
        if len(done) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.run(tmp_path, pool, done=interrupt)
    assert {row["slot"] for row in Store(tmp_path, write=False).rows.values()} == set(done)
    assert computed(study, tmp_path, pool) == sorted(set(range(10)) - set(done))
    assert not study.table()["error"].any()


def test_a_full_disk_ends_the_study_and_loses_nothing(ball, pool, tmp_path):
    study = palpate.Study(ball, OVER, KEEP)
    study.run(tmp_path, pool)
    stored = (tmp_path / "points.parquet").read_bytes()
    more = palpate.Study(ball, OVER | {"ball.radius": ["5 mm", "6 mm"]}, KEEP)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.raises(RunError, match=r"File too large\. All points in points.parquet stay"):
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (len(stored) // 2, hard))
            more.run(tmp_path, pool)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (tmp_path / "points.parquet").read_bytes() == stored
    assert not study.table()["error"].any()
    more.run(tmp_path, pool)
    assert not more.table()["error"].any()


def test_a_point_counts_as_stored_only_with_its_curves(ball, pool, tmp_path):
    """The row was kept when the disk was full while the curves were written, so the study never computed them again."""
    over = {"ball.young": list(np.linspace(1e4, 4e4, 40))}
    study = palpate.Study(ball, over, ("peak ball.force", "curve ball.force"), duration=0.5,
                          sets=["ball.steps=500"])  # fmt: skip
    study.run(tmp_path / "whole", pool)
    sizes = [file.stat().st_size for file in (tmp_path / "whole" / "curves.zarr").rglob("*") if file.is_file()]
    limit = max(sizes) // 2
    assert (tmp_path / "whole" / "points.parquet").stat().st_size < limit
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.raises(RunError, match=r"File too large\. All points in points.parquet stay\. Run it again"):
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
            study.run(tmp_path / "full", pool)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    study.run(tmp_path / "full", pool)
    whole, full = (Store(tmp_path / name, write=False) for name in ("whole", "full"))
    for name in ("curve ball.force", "curve ball.force time"):
        assert np.array_equal(full.curves(name, range(40)), whole.curves(name, range(40)))


def test_a_full_disk_is_not_an_error_of_the_point(ball, tmp_path):
    study = palpate.Study(ball, OVER, KEEP)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
        done = compute(PointTask(study.launch, study.keep), study.points[0])[0]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert done.lost and not done.error


def test_two_studies_cannot_write_to_one_folder(ball, pool, tmp_path):
    held = Store(tmp_path)
    with pytest.raises(RunError, match="another process writes this study"):
        palpate.Study(ball, OVER, KEEP).run(tmp_path, pool)
    held.close()
    palpate.Study(ball, OVER, KEEP).run(tmp_path, pool)


def test_a_worker_with_other_versions_computes_nothing(ball, pool, tmp_path):
    study = palpate.Study(ball, OVER, KEEP)
    study._about["versions"] |= {"numpy": "1.0"}
    with pytest.raises(RunError, match=r"would not give the same bytes: numpy \d\S* there, 1.0 here"):
        study.run(tmp_path, pool)


def test_complete_recordings_are_optional(ball, pool, tmp_path):
    study = palpate.Study(ball, {"ball.young": [1e4, 2e4]}, ["peak ball.force", "recording"])
    study.run(tmp_path, pool)
    for force, name in study.table()[["peak ball.force", "recording"]].to_numpy():
        assert palpate.open(tmp_path / "recordings" / name).ball.force.max() == force
    assert len(list((tmp_path / "recordings").iterdir())) == 2


def test_stored_results_open_with_other_tools(ball, pool, tmp_path):
    palpate.Study(ball, OVER, KEEP).run(tmp_path, pool)
    table = pyarrow.parquet.read_table(tmp_path / "points.parquet")
    assert table.column_names == ["key", "base", "slot", *sorted([*KEEP[:3], *OVER]), "error"]
    assert {json.loads(line)["key"] for line in (tmp_path / "log.jsonl").read_text().splitlines()} == set(
        table["key"].to_pylist()
    )
    (tmp_path / "points.parquet").write_bytes(b"PAR1 and no more")
    with pytest.raises(RunError, match="is not of a study, or damaged"):
        palpate.Study(ball, OVER, KEEP).run(tmp_path, pool)


def test_pictures_of_numbers_and_curves(ball, pool, tmp_path):
    study = palpate.Study(ball, OVER, KEEP)
    with pytest.raises(RunError, match="was not run"):
        study.table()
    study.run(tmp_path, pool)
    (axes,) = study.plot("peak ball.force").axes
    assert [line.get_label() for line in axes.lines] == ["1 mm", "2 mm"] and axes.get_xlabel() == "ball.young [Pa]"
    assert axes.lines[1].get_ydata() == pytest.approx([hertz(e, 2e-3) for e in (1e4, 2e4, 4e4)])
    (axes,) = study.plot("ball.force").axes
    assert len(axes.lines) == 6 and axes.get_ylabel() == "ball.force [N]"
    legend = axes.get_legend()
    assert legend is not None and legend.get_title().get_text() == "ball.young [Pa]"
    (dashed,) = axes.figure.legends  # dashes mark the other path: all lines differ
    assert dashed.get_title().get_text() == "ball.depth" and [t.get_text() for t in dashed.texts] == ["1 mm", "2 mm"]
    assert len({(line.get_color(), line.get_linestyle()) for line in axes.lines}) == 6
    with pytest.raises(PalpateError, match=r"Did you mean 'ball\.force'"):
        study.plot("ball.forze")
    from matplotlib import pyplot

    given, (left, right) = pyplot.subplots(1, 2)
    assert study.plot("peak ball.force", ax=right) is given and right.lines and not left.lines
    assert study.plot("peak ball.force") is pyplot.gcf() is not given
    pyplot.close("all")


def test_varied_settings_have_their_unit():
    rates = palpate.Study("kidney", {"rate": [500, 1000]}, duration=0.1)
    assert rates.axis_label("rate") == "rate [Hz]"
    other = {"tissue.use": ["deformation.ReducedFE"], "tissue.young": [1e4, 2e4]}  # not in the graph
    assert palpate.Study("kidney", other, duration=0.1).axis_label("tissue.young") == "tissue.young [Pa]"


def test_an_invalid_value_does_not_change_the_unit():
    study = palpate.Study("kidney", {"tissue.stiffness": [2e3, 3e3, -1.0]}, duration=0.1)
    assert study.axis_label("tissue.stiffness") == "tissue.stiffness [N/m^n]"


def test_missing_units_of_a_changed_graph_are_reported(ball):
    study = palpate.Study(ball, {"ball.young": [1e4, 2e4]}, KEEP)
    ball.write_text(BALL.replace("Ball}", "Bull}"), encoding="utf-8")
    with pytest.raises(PalpateError, match="has no class 'Bull'"):
        _ = study.units


def test_long_values_are_replaced_by_their_number_in_legends(ball, pool, tmp_path):
    flags = [str(tmp_path / f"{'long' * 20}{number}") for number in (1, 2)]
    study = palpate.Study(ball, {"ball.young": [1e4, 2e4], "ball.flag": flags}, KEEP).run(tmp_path / "out", pool)
    (axes,) = study.plot("peak ball.force").axes
    assert [line.get_label() for line in axes.lines] == ["#1", "#2"]
    assert list(study.table()["ball.flag"]) == 2 * flags
