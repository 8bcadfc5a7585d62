"""The Python API `import palpate`: runs and recordings in scripts and notebooks."""

import subprocess
import sys

import numpy as np
import pytest
from expected_notes import COARSE, STIFF, UNTAKEN
from shell_text import unwrapped
from short_touch import QUICK
from typer.testing import CliRunner

import palpate
from palpate import calling
from palpate.cli.__main__ import app
from palpate.launch.run.execute import execute
from palpate.physics.errors import ArgumentError
from palpate.records.reader import Recording


@pytest.fixture(scope="module")
def file(short_kidney):
    return short_kidney


@pytest.fixture(scope="module")
def run(file):
    return palpate.open(file)


def test_import_palpate_is_lazy_and_gives_access_to_all_packages():
    code = (
        "import sys, palpate; print('numpy' in sys.modules); import palpate.physics, palpate.models.fe;"
        "print(sorted(palpate.__all__) == sorted(set(palpate.__all__) & set(dir(palpate))), palpate.Run.__name__)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.split() == ["False", "True", "Run"]


def test_a_field_is_an_array_with_unit_and_times(run, file):
    columns = Recording(file).columns("contact")
    force = run.contact.force
    assert isinstance(force, np.ndarray)
    assert (force.unit, force.label) == ("N", "contact.force [N]")
    np.testing.assert_array_equal(force, columns["force"])
    np.testing.assert_array_equal(force.time, columns["time"])
    assert run.contact.normal.shape == (len(force), 3)
    assert run["contact.force"].unit == "N"


def test_rows_keep_their_times_and_arithmetic_returns_plain_arrays(run):
    force = run.contact.force
    pressed = force[force > 0.0]
    assert 0 < len(pressed) < len(force)
    np.testing.assert_array_equal(pressed.time, force.time[np.asarray(force) > 0.0])
    assert pressed.unit == "N"
    assert force[10:20].time[0] == force.time[10]
    assert run.contact.normal[5:9, 2].time.shape == (4,)
    assert type(force * 2.0) is np.ndarray
    assert isinstance(force.max(), float)
    assert isinstance(force[3], float)


def test_arrays_of_variable_length_are_returned_as_a_list(run):
    displacement = run.tissue.displacement
    assert isinstance(displacement, list)
    assert len(displacement) == len(run.tissue)
    assert len({array.shape for array in displacement}) > 1
    assert all(len(array) == len(nodes) for array, nodes in zip(displacement, run.tissue.nodes, strict=True))


def test_a_table_has_a_column_for_each_number(run):
    pytest.importorskip("pandas", reason="pandas is not installed (extra table)")
    table = run.frame("contact")
    assert table.index.name == "time [s]"
    np.testing.assert_array_equal(table["force [N]"], run.contact.force)
    np.testing.assert_array_equal(table["normal[2] [1]"], run.contact.normal[:, 2])
    assert "nodes [1]" not in run.frame("tissue")


def test_unknown_names_are_errors_with_the_known_names(run, tmp_path):
    with pytest.raises(AttributeError, match=r"no stream 'contakt'.*contact"):
        run.contakt  # noqa: B018
    with pytest.raises(AttributeError, match=r"no field 'forse'.*force"):
        run.contact.forse  # noqa: B018
    with pytest.raises(palpate.PalpateError, match="no stream"):
        run["nothing.force"]
    with pytest.raises(palpate.PalpateError, match="is a field"):
        run.frame("contact.force")
    with pytest.raises(palpate.PalpateError, match="No such file"):
        palpate.open(tmp_path / "none.mcap")


def test_a_stream_is_a_sequence_of_messages_and_a_run_a_set_of_streams(run):
    contact = run.contact
    assert contact[120].tick == 120 and contact[-1].tick == len(contact) - 1
    assert contact[120].force == contact.force[120]
    assert [message.tick for message in contact[10:13]] == [10, 11, 12]
    assert next(iter(contact)).tick == 0 and len(list(contact)) == len(contact)
    with pytest.raises(IndexError, match="has 350 messages"):
        contact[350]
    assert list(run) == run.streams and len(run) == len(run.streams)
    assert "contact" in run and "contakt" not in run
    with pytest.raises(palpate.PalpateError, match="expected the name of a stream"):
        run[3]


def test_a_field_prints_a_line_with_its_unit_and_range(run):
    force = run.contact.force
    peak = f"{float(force.max()):.4g}"
    assert str(force) == repr(force) == f"contact.force [N]: 350 values, 0 to {peak} N, from 0.000 s to 0.349 s"
    assert repr(run.contact.normal).startswith("contact.normal [1]: 350 x 3 values")
    assert repr(force[:0]) == repr(force[force > 1e9]) == "contact.force [N]: no messages"


def test_a_table_of_several_streams_joins_their_columns(run):
    pytest.importorskip("pandas", reason="pandas is not installed (extra table)")
    table = run.frame(["contact", "tissue"])
    np.testing.assert_array_equal(table["contact"]["force [N]"], run.contact.force)
    np.testing.assert_array_equal(table["tissue"]["stiffness [N/m^n]"], run.tissue.stiffness)
    np.testing.assert_array_equal(table.index, run.contact.time)
    with pytest.raises(palpate.PalpateError, match="no stream 'contakt'"):
        run.frame(["contact", "contakt"])
    with pytest.raises(palpate.PalpateError, match="found no stream"):
        run.frame([])


def test_force_is_plotted_over_indentation(run, file, tmp_path):
    (axes,) = run.plot("contact.force", over="contact.indentation").axes
    assert axes.get_xlabel() == "contact.indentation [mm]" and axes.get_ylabel() == "[N]"
    np.testing.assert_allclose(axes.lines[0].get_xdata(), 1e3 * np.asarray(run.contact.indentation))
    np.testing.assert_allclose(axes.lines[0].get_ydata(), run.contact.force)
    with pytest.raises(palpate.PalpateError, match="is a vector"):
        run.plot("contact.force", over="contact.normal")
    target = tmp_path / "xy.svg"
    arguments = ["picture", str(file), "contact.force", "--over", "finger.time", "-o", str(target)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code != 0 and "no field 'time'" in result.stderr
    arguments[4] = "tissue.stiffness"
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert target.read_bytes().startswith(b"<?xml")


def test_a_touch_is_compared_with_another_body(run, file):
    found = run.compare({"tissue": "deformation.Rigid"})
    first, other = found.variants
    assert first.name == "recorded" and other.swapped == ("tissue",)
    assert other.force.report()["rms"] > 0.0
    assert "tissue.use=deformation.Rigid: force error" in repr(found)
    assert len(found.plot().axes) == 4
    both = palpate.compare(file, [], "scene.tissue.stiffness=200", ["tissue.use=deformation.Rigid"], reference=[])
    assert [len(both.report()), both.report()[1]["force_N"]["rms"]] == [4, 0.0]
    with pytest.raises(palpate.PalpateError, match="found 3, expected"):
        run.compare(3)


@pytest.mark.parametrize(
    ("given", "printed"),
    [
        ({"tisue": "deformation.Rigid"}, "tisue='deformation.Rigid': found 'tisue', expected the name of a node"),
        ({"tissue": "deformation.Rigd"}, "tissue='deformation.Rigd': node 'tissue': use: 'deformation' has no class"),
        ({"tissue": {"stifness": 2e3}}, "tissue={'stifness': 2000.0}: node 'tissue', setting 'stifness': unknown"),
        ({"tissue": {"a=b": 3}}, "setting 'a=b': unknown"),
        ({"tissue": {"": 3}}, "tissue: found '', expected the name of a setting, as in tissue={'stiffness': 2e3}"),
        ({"tissue": "a: b: c"}, "tissue='a: b: c':1: not YAML"),
        ({"rate": 500}, "rate: no node has this name; expected sets=['rate=500']"),
    ],
)
def test_faults_of_keywords_quote_the_python_text(given, printed, tmp_path):
    for call in (lambda: palpate.run("kidney", record=tmp_path / "x.mcap", duration=0.01, **given),
                 lambda: next(palpate.steps("kidney", **given))):  # fmt: skip
        with pytest.raises(palpate.PalpateError) as error:
            call()
        assert printed in str(error.value) and "--set" not in str(error.value) and "Targets" not in str(error.value)


@pytest.mark.notes(COARSE, STIFF)
def test_steps_yields_the_messages_that_a_run_records(file):
    seen = []
    for tick in palpate.steps("kidney", duration=0.35, sets=QUICK):
        seen.append((tick.time, tick.contact.force, tick["controller"].force))
    run = palpate.open(file)
    assert [s[1] for s in seen] == run.contact.force.tolist()
    np.testing.assert_array_equal([s[2] for s in seen], run.controller.force)
    np.testing.assert_allclose([s[0] for s in seen], run.contact.time, atol=1e-12)


@pytest.mark.notes(COARSE, STIFF)
def test_settings_change_between_two_ticks():
    before = after = 0.0
    for tick in palpate.steps("kidney", duration=0.4, sets=QUICK):
        if tick.number == 249:
            before = tick.contact.force
            assert tick.settings("tissue")["stiffness"] != 5.0
            tick.set("tissue", stiffness=5.0, nodule_depth="7 mm")
            assert tick.settings("tissue")["stiffness"] == 5.0 and tick.settings("tissue")["nodule_depth"] == 0.007
        after = tick.contact.force
    assert tick.number == 399
    assert 0.0 < after < 0.5 * before


@pytest.mark.notes(COARSE)
def test_invalid_uses_of_a_step_are_errors():
    loop = palpate.steps("kidney", sets=QUICK)
    tick = next(loop)
    with pytest.raises(AttributeError, match=r"no stream 'contakt'.*contact"):
        tick.contakt  # noqa: B018
    with pytest.raises(palpate.PalpateError, match=r"no running node 'tisue'.*tissue"):
        tick.set("tisue", stiffness=1.0)
    with pytest.raises(palpate.PalpateError, match=r"no setting 'stifness'.*stiffness"):
        tick.set("tissue", stifness=1.0)
    with pytest.raises(palpate.PalpateError, match=r"tissue\.stiffness \[.*'2 s'"):
        tick.set("tissue", stiffness="2 s")
    assert next(loop).number == 1
    loop.close()
    with pytest.raises(StopIteration):
        next(loop)
    with pytest.raises(palpate.PalpateError, match="drives a device"):
        next(palpate.steps("falcon"))


@pytest.mark.notes(COARSE, STIFF)
def test_a_run_accepts_a_placement_and_is_fused_on_simulated_time(tmp_path, monkeypatch):
    placed = []
    monkeypatch.setattr(
        calling, "execute", lambda launch, *more, **how: placed.append(launch.place) or execute(launch, *more, **how)
    )
    one = palpate.run("kidney", record=tmp_path / "a.mcap", duration=0.02, sets=QUICK)
    two = palpate.run("kidney", record=tmp_path / "b.mcap", duration=0.02, sets=QUICK, place="two")
    assert placed[0] == "fused" and placed[1].name == "two.yaml"
    np.testing.assert_array_equal(one.controller.force, two.controller.force)
    apart = palpate.run("kidney", record=tmp_path / "d.mcap", duration=0.02, sets=QUICK, place="apart")
    assert list(apart.contact.force) == list(two.contact.force)
    with pytest.raises(palpate.PalpateError, match="placement"):
        palpate.run("kidney", record=tmp_path / "c.mcap", duration=0.02, place="nowhere")


def test_a_notebook_shows_the_contents_of_a_run_and_of_a_field(run):
    assert "<td>contact</td><td>Contact</td><td>350</td>" in run._repr_html_()
    assert "contact.force [N]" in run.contact.force._repr_html_()
    assert "contact" in dir(run)
    assert "force" in dir(run.contact)


@pytest.mark.notes(UNTAKEN, COARSE, STIFF)
def test_a_run_from_python_accepts_a_model_and_settings(tmp_path):
    file = tmp_path / "rigid.mcap"
    run = palpate.run(
        "kidney", record=file, duration="0.05 s", sets=QUICK, tissue="deformation.Rigid", controller={"delay": 2}
    )
    assert run.path == file
    assert len(run.contact) == 50
    nodes = {node["name"]: node for node in run.about["plan"]["nodes"]}
    assert nodes["tissue"]["use"] == "deformation.Rigid"
    assert nodes["controller"]["settings"]["delay"] == 2


@pytest.mark.parametrize(
    ("given", "fault_text"),
    [
        ({"graph": "kidnei"}, "kidney"),
        ({"tissue": "deformation.Jelly"}, "deformation"),
        ({"tissue": 3}, "expected a model"),
        ({"tissue": {"stiffness": object()}}, "tissue.stiffness: found object"),
        ({"duration": -1.0}, "expected a time"),
        ({"duration": "2 N"}, "duration"),
        ({"clock": "wall"}, "expected 'simulated' or 'real'"),
        ({"sets": "tissue.stiffness=2e3"}, "expected a list"),
        ({"nobody": "deformation.Rigid"}, "nobody"),
    ],
)
def test_wrong_arguments_are_errors_with_a_remedy(given, fault_text, tmp_path):
    with pytest.raises(palpate.PalpateError, match=fault_text):
        palpate.run(**{"record": tmp_path / "x.mcap", **given})


def test_fields_are_plotted_with_their_units(run, file, tmp_path):
    figure = run.plot("contact.force", "contact.indentation", "finger.position")
    assert [axes.get_ylabel() for axes in figure.axes] == ["[N]", "[mm]", "[mm]"]
    drawn = figure.axes[1].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, 1e3 * np.asarray(run.contact.indentation))
    target = tmp_path / "out" / "force.png"
    result = CliRunner().invoke(app, ["picture", str(file), "contact.force", "-o", str(target)])
    assert result.exit_code == 0
    assert target.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize(
    ("names", "fault_text"),
    [
        (["contact"], "contact.force"),
        (["tissue.displacement"], "changing length"),
        (["controller.state"], "not a number"),
        (["contact.forse"], "no field 'forse'"),
        (["contact.force", "-o", "x.gif"], "expected .png"),
    ],
)
def test_fields_that_cannot_be_plotted_are_errors_of_one_line(file, names, fault_text):
    result = CliRunner().invoke(app, ["picture", str(file), *names])
    assert result.exit_code != 0
    assert fault_text in unwrapped(result.stderr)
    assert "Traceback" not in result.output


def test_a_run_in_this_process_restores_the_state_of_the_garbage_collector(tmp_path):
    """Objects frozen by the caller stay frozen, and no others, since later collections would skip them."""
    code = """
import gc, palpate
for aside in (False, True):
    if aside:
        gc.freeze()
    before = gc.get_freeze_count()
    palpate.run("kidney", duration=0.002, record="short.mcap")
    print(before > 0, gc.get_freeze_count() > before / 2, gc.isenabled())
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False", "True", "True", "True", "True"]


@pytest.mark.parametrize("wrong", [5, b"x", ["x", 1], "a\0b"])
def test_arguments_of_a_wrong_type_are_errors_that_name_them(tmp_path, wrong):
    pytest.importorskip("pyarrow")
    ensemble = palpate.Ensemble("kidney", 1, duration=0.01)
    study = palpate.Study("kidney", {"tissue.stiffness": [200.0]}, duration=0.01)
    calls = {
        "record": lambda: palpate.run("kidney", record=wrong),
        "scene": lambda: palpate.run("kidney", record=tmp_path / "a.mcap", scene=wrong),
        "sets": lambda: palpate.run("kidney", record=tmp_path / "a.mcap", sets=wrong),
        "keep": lambda: palpate.Ensemble("kidney", 1, keep=wrong),
        "over": lambda: palpate.Ensemble("kidney", 1, wrong),
        "out": lambda: ensemble.run(out=wrong, quiet=True),
        "executor": lambda: ensemble.run(executor=wrong, quiet=True),
        "over ": lambda: palpate.Study("kidney", wrong),
        "keep ": lambda: palpate.Study("kidney", {"tissue.stiffness": [200.0]}, wrong),
        "folder": lambda: study.run(wrong),
        "executor ": lambda: study.run(tmp_path / "study", wrong),
    }
    for name, call in calls.items():
        with pytest.raises(ArgumentError, match=f"^{name.strip()}"):
            call()
