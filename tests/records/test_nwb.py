"""Spikes of afferents as NWB, read with pynwb."""

import sys

import numpy as np
import pytest
from pytest import approx
from test_export import TOUCH

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.physics.afferents.published import TYPES
from palpate.records.export import export
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    path = tmp_path_factory.mktemp("nwb") / "felt.mcap"
    sparse = "afferents.densities=[0.2e6, 0.3e6, 0.05e6]"
    assert execute(
        find("nodule").but(scene="afferents", duration=0.5, record=path, place="fused", overrides=(sparse,))
    ).result.ok
    return Recording(path)


def test_pynwb_reads_times_types_and_positions_of_the_units(felt, tmp_path):
    pynwb = pytest.importorskip("pynwb")
    (path,) = export(felt, "nwb", tmp_path / "a.nwb")
    assert not pynwb.validate(path=str(path))
    made = plan_of(felt).make("afferents").make_population()
    sent = list(felt.messages("afferents"))
    unit, moment = (np.concatenate([getattr(each, name) for each in sent]) for name in ("unit", "moment"))
    assert len(unit) > 50 and len(set(unit)) < len(made.kind)  # some are silent
    with pynwb.NWBHDF5IO(str(path), "r") as file:
        read = file.read()
        units = read.units
        assert len(units) == len(made.kind) and "electrodes" not in units.colnames and read.electrodes is None
        for n in range(len(units)):
            assert np.array_equal(units.get_unit_spike_times(n), moment[unit == n])
            assert units["afferent_type"][n] == TYPES[made.kind[n]]
            assert [units[name][n] for name in ("x", "y", "depth")] == approx(made.at[n])
            assert units.get_unit_obs_intervals(n)[0] == approx([sent[0].time * 1e-9, sent[-1].time * 1e-9])
        assert read.session_start_time.isoformat() == felt.about["date"]


def test_the_inspector_finds_no_critical_fault_and_no_violation(felt, tmp_path):
    inspector = pytest.importorskip("nwbinspector")
    (path,) = export(felt, "nwb", tmp_path / "a.nwb", subject={"subject_id": "S1", "age": "P30Y", "sex": "F"})
    found = list(inspector.inspect_nwbfile(nwbfile_path=str(path)))
    worst = inspector.Importance.BEST_PRACTICE_SUGGESTION
    assert not [message for message in found if message.importance.value > worst.value], found


def test_the_subject_is_a_simulation_a_participant_or_given(felt, tmp_path):
    pynwb = pytest.importorskip("pynwb")

    def subject(recording, **given):
        (path,) = export(recording, "nwb", tmp_path / "a.nwb", subject=given)
        with pynwb.NWBHDF5IO(str(path), "r") as file:
            read = file.read()
            assert read.units.resolution == approx(2e-4)
            return read.subject.subject_id, read.subject.age, read.subject.sex, read.subject.species

    assert subject(felt) == ("simulated-finger", "P18Y/", "U", "Homo sapiens")
    assert subject(felt, subject_id="S1", age="P3Y") == ("S1", "P3Y", "U", "Homo sapiens")
    beh = tmp_path / "data" / "sourcedata" / "sub-02" / "ses-01" / "beh"
    beh.mkdir(parents=True)
    (tmp_path / "data" / "participants.tsv").write_text("participant_id\tage\tsex\nsub-01\t9\tm\nsub-02\t31\tfemale\n")
    (beh / "x.mcap").write_bytes(felt.path.read_bytes())
    assert subject(Recording(beh / "x.mcap")) == ("sub-02", "P31Y", "F", "Homo sapiens")
    with pytest.raises(RecordingError, match="found colour, expected subject_id"):
        export(felt, "nwb", tmp_path / "b.nwb", subject={"colour": "blue"})
    with pytest.raises(RecordingError, match="other formats have no subject"):
        export(felt, "csv", tmp_path / "b", subject={"age": "P3Y"})


def test_bad_input_is_refused(felt):
    pytest.importorskip("pynwb")
    for recording, given, says in (
        (Recording(TOUCH), {}, "no stream of Spikes; `palpate run nodule"),
        (felt, {"out": felt.path}, "is the recording itself"),
        (felt, {"every": 2}, "needs every message"),
    ):
        with pytest.raises(RecordingError, match=says):
            export(recording, "nwb", **given)


def test_a_missing_package_is_an_error_with_the_install_command(felt, monkeypatch):
    monkeypatch.setitem(sys.modules, "pynwb", None)
    with pytest.raises(RecordingError, match=r'pynwb is not installed; pip install "palpate\[feel\]"'):
        export(felt, "nwb")
