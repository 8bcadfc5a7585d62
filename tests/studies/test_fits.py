"""`palpate bench fits`: presses are reproducible, a search resumes, no value of a small sample is silently wrong."""

import json

import numpy as np
import pytest
from pytest import approx
from scipy.stats import binomtest
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.tissue import fit as fitting
from palpate.models.fit.tissue import relaxing
from palpate.models.fit.tissue.estimate import Problem
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.measured import MeasuredPress, prepare_press
from palpate.models.fit.tissue.rigs import Rig, closed_form
from palpate.models.fit.tissue.tabulated import FINE, REFERENCE, curve
from palpate.studies.fits import report
from palpate.studies.fits import search as searching
from palpate.studies.fits.cases import CASES
from palpate.studies.fits.presses import NOISES, draw_press
from palpate.studies.fits.search import ENOUGH, FLAWS, Outcome, intervals_of, judge, search, strata
from palpate.studies.fits.tables import laws_of
from palpate.studies.fits.truth import elastic_force, true_force

SAMPLE = {"ball hertz": 4, "punch hertz": 3, "cylinder linear": 3, "ball power": 2}


@pytest.mark.parametrize("case", CASES)
def test_the_law_of_the_fit_agrees_with_the_true_force(case):
    """Two formulas, or two discretisations of an integral equation, of the same law."""
    drawn = draw_press(case, 3, 5).case
    s = np.linspace(0.01, 1.0, 60) * drawn.reach
    assert closed_form(drawn.rig, drawn.law).force(drawn.truth, s) == pytest.approx(elastic_force(drawn)(s), rel=1e-5)


@pytest.mark.parametrize("kind", [case.rpartition(" ")[2] for case in CASES if case.startswith("ball layer ")])
def test_the_relaxation_of_the_fit_converges_to_the_true_force(kind):
    """On ten times more rows its error falls, and is below 0.1 % of the peak."""
    drawn = draw_press(f"ball layer {kind}", 3, 5).case
    errors = []
    for rows in (60, 600):
        time = np.linspace(0.0, 4.0, rows)
        path = drawn.reach * np.clip(time / 2.0 - 0.2, -0.2, 0.8) / 0.8
        depth, force = true_force(drawn, time, path)
        press = MeasuredPress("p", time, depth, force, 0.0, 1e-9, 0.0)
        found = relaxing.force(kind, closed_form(drawn.rig, drawn.law), drawn.truth, press, 0.0)
        counted = relaxing.measured_rows(kind, press)
        assert counted.sum() > rows - 12  # of 60
        errors.append(np.abs(found - force)[counted].max() / force.max())
    assert errors[1] < 1e-3 and (errors[1] < 0.5 * errors[0] or errors[0] < 1e-6)


@pytest.mark.parametrize("case", CASES)
def test_a_press_is_drawn_again_from_its_numbers_and_its_law_has_a_true_value_for_each_parameter(case):
    one, other = draw_press(case, 3, 5), draw_press(case, 3, 5)
    assert np.array_equal(one.force, other.force) and one.case == other.case
    assert not np.array_equal(one.force[:10], draw_press(case, 3, 6).force[:10])
    law = closed_form(one.case.rig, one.case.law)
    assert {p.name for p in law.parameters} <= set(one.case.truth) and one.case.reach <= law.reach
    assert len(one.time) == len(one.depth) == len(one.force) and np.isfinite(one.force).all()
    assert (np.diff(one.time) > 0.0).all()


def test_presses_have_every_noise_and_every_flaw():
    drawn = [draw_press(case, 1, number) for case in ("ball hertz", "ball layer prony:1") for number in range(150)]
    assert {press.noise for press in drawn} == set(NOISES)
    assert {name for press in drawn for name in press.flaws} == set(FLAWS)


def test_no_press_of_a_seeded_sample_is_silently_wrong():
    outcomes = [judge(case, 1, number) for case, count in SAMPLE.items() for number in range(count)]
    assert not [outcome for outcome in outcomes if outcome.silent]
    missed = [outcome for outcome in outcomes if outcome.result == "missed"]
    assert len(missed) <= 2, missed  # of 12; the goal is 0.2 to 1
    assert max(outcome.apart for outcome in outcomes) < 1.1


@pytest.mark.parametrize(("case", "number"), [("ball layer prony:2", 20), ("ball layer prony:3", 4)])
def test_the_interval_includes_minima_that_are_nearly_as_good(case, number):
    """Two of 12 missed presses in 50 with several Prony terms: the true time was in another minimum, 1.6 and 1.8 times
    outside the interval."""
    outcome = judge(case, 8, number)
    assert outcome.result == "inside" and outcome.apart == 1.0


@pytest.mark.parametrize(
    ("case", "seed", "number", "name", "least"),
    [
        ("ball layer prony:2", 9, 0, "time_1", 10.0),
        ("ball layer prony:3", 11, 17, "share_3", 0.9),
        ("ball layer prony:3", 11, 1, "young", 3e5),
    ],
)
def test_prony_terms_that_a_record_does_not_determine_have_wide_intervals(case, seed, number, name, least):
    """The first share may be 0, so that its time is anything (it ended 1.95 times below the true one); and profiles
    ended where the search of a trial had been lost in the valley of fewer terms (`time_3` 1.5 times off). Guesses
    of the times came from the whole record, mostly a long approach, and the best minimum was not found."""
    press = draw_press(case, seed, number)
    measured = prepare_press("p", press.time, press.depth, press.force)
    found = fit_tissue([measured], press.case.rig, press.case.law, press.case.relaxation).estimate.intervals
    for key, interval in found.items():
        assert interval.low <= press.case.truth[key] <= interval.high, key
    assert found[name].high > least


def test_the_guess_of_times_does_not_depend_on_the_approach():
    for outside in (20, 2000):
        depth = np.r_[np.linspace(-1e-5 * outside, 0.0, outside), np.linspace(1e-5, 1e-3, 100), np.full(100, 1e-3)]
        press = prepare_press("p", 0.01 * np.arange(len(depth)), depth, 2e3 * np.maximum(depth, 0.0) ** 1.5)
        assert relaxing.contact_time(press) == approx(2.0, rel=0.1)


@pytest.mark.parametrize("count", [2, 3])
def test_starts_for_other_minima_keep_the_relaxation_but_a_small_term(count):
    """Terms of shares a_i of the whole and times, from the slowest to the fastest: what relaxes until any time differs
    from that of the minimum by at most what merging two terms changes."""
    rng = np.random.default_rng(count)
    time = np.geomspace(1e-3, 1e3, 50)

    def relaxed(x):
        shares, times = x[1 : 1 + 2 * count].reshape(-1, 2).T
        whole = shares * np.r_[1.0, np.cumprod(1.0 - shares)[:-1]]
        assert whole.sum() < 1.0 and (shares > 0.0).all()
        return whole @ (1.0 - np.exp(-time / np.exp(np.minimum.accumulate(times))[:, None]))

    for _ in range(20):
        apart = np.sort(rng.uniform(-3.0, 3.0, count))[::-1]
        x = np.r_[9.0, np.stack([rng.uniform(0.1, 0.6, count), apart], axis=1).ravel(), 0.5]
        starts = relaxing.other_orders(f"prony:{count}", 1, x)
        assert len(starts) == 2 * (count + 1) and all(y[0] == 9.0 and y[-1] == 0.5 for y in starts)
        lost = x[1::2][:count] * np.r_[1.0, np.cumprod(1.0 - x[1::2][:count])[:-1]]
        for y in starts:
            assert np.abs(relaxed(y) - relaxed(x)).max() < lost.max() + 0.05
    assert relaxing.other_orders("prony:1", 1, x) == []


@pytest.mark.parametrize("count", [1, 2, 3])
def test_derivatives_of_a_relaxing_press_are_those_of_its_forces(count):
    """By central differences; also where a time exceeds the one before it and has no effect."""
    drawn = draw_press(f"ball layer prony:{count}", 21, 0)
    press = prepare_press("p", drawn.time, drawn.depth, drawn.force)
    law = closed_form(drawn.case.rig, drawn.case.law)
    problem = Problem([press], law, drawn.case.relaxation, True, False)
    first, times = problem.start(), slice(2, 2 + 2 * count, 2)
    turned = first.copy()
    turned[times] = turned[times][::-1]
    for x in (first, turned):
        found = problem.jacobian(x)
        for k in range(1, 1 + 2 * count):
            ends = []
            for side in (1e-5, -1e-5):
                y = x.copy()
                y[k] += side
                ends.append(problem.law_forces(y)[0] * problem.weight[0])
            expected = (ends[0] - ends[1]) / 2e-5
            assert found[:, k] == approx(expected, abs=1e-7 + 1e-5 * np.abs(expected).max())
    assert count == 1 or not found[:, 2 * count].any()


def test_a_search_resumes_and_counts_strata(tmp_path, monkeypatch):
    made = []

    def counted(name, seed, number, folder):
        made.append((name, number))
        result = "missed" if number == 1 else "inside"
        return Outcome(name, number, seed, {"noise": "white", "rise": 0.01}, result, 2.0, 1.6, [])

    monkeypatch.setattr(searching, "judge", counted)
    list(search(["ball hertz"], 2, 1, tmp_path, lambda share, what: None))
    with (tmp_path / searching.KEPT).open("a") as file:
        file.write('{"case": "ball hertz", "num')  # was cut off
    found = list(search(["ball hertz"], 4, 1, tmp_path, lambda share, what: None))
    assert made == [("ball hertz", n) for n in range(4)] and len(found) == 4
    counts = {name: len(each) for name, each in strata(found).items()}
    assert counts == {"ball hertz": 4, "noise: white": 4, "flaw: rise": 4}
    assert [outcome.silent for outcome in found] == [False, True, False, False]
    result = CliRunner().invoke(
        app, ["bench", "fits", "--presses", "4", "--case", "ball hertz", "-o", str(tmp_path), "--json"]
    )
    found = json.loads(result.stdout)
    assert result.exit_code == 1 and not found["ok"] and found["rows"][0]["silent"] == 1
    assert found["worst"][0]["command"].startswith("palpate fit tissue ")
    assert len(made) == 4 and (tmp_path / "ball-hertz-1.csv").exists()
    shown = CliRunner().invoke(app, ["bench", "fits", "--presses", "4", "--case", "ball hertz", "-o", str(tmp_path)])
    assert "flaw: rise" in shown.output and "75.0%" in shown.output


def test_an_interrupted_search_reports_what_it_found(tmp_path, monkeypatch):
    def judged(name, seed, number, folder):
        if number == 3:
            raise KeyboardInterrupt
        return Outcome(name, number, seed, {"noise": "white"}, "inside", 1.0, 1.0, [])

    monkeypatch.setattr(searching, "judge", judged)
    arguments = ["bench", "fits", "--presses", "9", "--case", "ball hertz", "-o", str(tmp_path)]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 130 and "3 presses" in shown.output and "stopped" in shown.output
    found = json.loads(CliRunner().invoke(app, [*arguments, "--json"]).stdout)
    assert found["interrupted"] and found["presses"] == 3 and found["rows"][0]["coverage"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--case", "sphere"], "--case: found sphere, expected some of ball hertz"),
        (["--presses", "0"], "--presses"), (["--seed", "-1"], "--seed"), (["--first", "x"], "--first"),
        (["-o", "/dev/null"], "/dev/null"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_one_line(arguments, message):
    wrong = CliRunner().invoke(app, ["bench", "fits", "--presses", "1", *arguments])
    assert wrong.exit_code == 2 and message in unwrapped(wrong.output) and "Traceback" not in wrong.output


@pytest.fixture(scope="module")
def bonded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    laws_of("bonded neo_hooke", folder)
    return folder


def test_a_press_of_a_tabulated_law_has_the_force_of_the_finer_mesh_at_every_size(bonded):
    drawn = [draw_press("bonded neo_hooke", 3, number, bonded).case for number in (1, 2)]
    for case in drawn:
        assert case.rig.height == pytest.approx(case.rig.radius) and case.rig.plates == "bonded"
        s = np.linspace(0.2, 1.0, 5) * case.reach
        # computed again at this size, on the mesh of the table
        expected = case.truth["young"] / REFERENCE * curve(case.rig, "neo_hooke", {}, s, FINE)
        assert case.force(s) == pytest.approx(expected, rel=1e-2)  # interpolation where the rim touches
    assert drawn[0].rig != drawn[1].rig
    assert len(list(bonded.glob("*.npz"))) == 2  # kept


def test_the_interval_includes_the_error_of_the_mesh(bonded, monkeypatch):
    """The table of a fit is 1 to 2 % too soft. Of 12 presses with noise of 0.3 % of the peak, no interval misses the
    true value; without the error of the mesh 3 do. In the others the misfit is seen, and widens or withholds the
    interval."""
    missed = []
    for included in (True, False):
        if not included:
            monkeypatch.setattr(fitting, "include_mesh_error", lambda *_: "")
        rng = np.random.default_rng(1)
        for number in range(12):
            case = draw_press("bonded neo_hooke", 5, number, bonded).case
            time = np.linspace(0.0, 1.0, 300)
            depth = case.reach * (1.4 * time - 0.4)
            force = np.where(depth > 0.0, case.force(np.maximum(depth, 1e-9)), 0.0)
            force = force + 3e-3 * force.max() * rng.standard_normal(300)
            press = prepare_press("p", time, depth, force)
            fit = fit_tissue([press], case.rig, case.law, drift="none", table=case.table)
            value, low, high = fit.young
            missed.append(not low <= case.truth["young"] <= high)
            assert value == pytest.approx(case.truth["young"], rel=0.03)
            if included:
                assert any("mesh and table: error of the force of at most" in note for note in fit.notes)
    assert sum(missed[:12]) == 0 and sum(missed[12:]) >= 2


def test_a_table_that_was_cut_off_is_computed_again(bonded, tmp_path):
    for path in bonded.glob("*.npz"):
        (tmp_path / path.name).write_bytes(path.read_bytes()[:300])
    used, true = laws_of("bonded neo_hooke", tmp_path)
    kept = laws_of("bonded neo_hooke", bonded)
    s = np.linspace(1e-4, used.reach, 9)
    assert np.array_equal(true.force({"young": 1e4}, s), kept[1].force({"young": 1e4}, s))


def test_strata_by_law_and_by_disturbance_are_two_tables(tmp_path):
    found = [
        Outcome(
            "ball hertz",
            n,
            1,
            {"noise": "white", "rise": 0.01},
            "inside" if n % 20 else "missed",
            1.0,
            1.0,
            [],
            [] if n % 20 else ["young"],
        )
        for n in range(ENOUGH)
    ]
    found += [Outcome("punch hertz", n, 1, {"noise": "hum"}, "inside", 1.0, 1.0, []) for n in range(5)]
    by = {row["stratum"]: (row["by"], row["enough"], row["presses"]) for row in report.rows(found)}
    assert by["ball hertz"] == ("law", True, 1000) and by["punch hertz"] == ("law", False, 5)
    assert by["noise: white"] == ("disturbance", True, 1000) and by["flaw: rise"] == ("disturbance", True, 1000)
    shown = report.text(found, [], [])
    assert "1 of 2 strata have 1000 presses; each: 1 within, 1 open, 0 low, 0 high" in shown
    law, disturbance = shown.split("by disturbance,")
    assert "ball hertz" in law and "flaw: rise" not in law and "1000*" in law and "flaw: rise" in disturbance


@pytest.mark.parametrize(
    ("notes", "silent"),
    [
        ([], True), (["press.csv: 9 rows after the deepest are excluded"], True),
        (["the force drifts before contact, by 1 N; a linear baseline was fitted, which widens the intervals"], True),
        (["mesh and table: error of the force of at most 2 %"], True),
        (["9 rows are excluded", "the intervals may be too narrow. Record more rows in contact"], False),
    ],
)  # fmt: skip
def test_a_note_on_what_was_fitted_does_not_excuse_a_wrong_value(notes, silent):
    outcome = Outcome("ball hertz", 0, 1, {"noise": "white"}, "missed", 2.0, 1.6, notes, ["young"])
    assert outcome.wrong and outcome.silent == silent


def test_two_intervals_of_95_percent_contain_both_values_less_often():
    """Hunt-Crossley's given intervals were right in 91.7 %, of both parameters together: 95 % of each."""
    outside = [["young"]] * 4 + [["damping"]] * 5 + [["young", "damping"]] + [[]] * 90
    found = [
        Outcome("ball layer hunt-crossley", n, 1, {"noise": "white"}, "missed" if out else "inside", 1.0, 1.0, [], out)
        for n, out in enumerate(outside)
    ]
    row = report.rows(found)[0]
    assert row["coverage"] == pytest.approx(0.90) and row["each"] == pytest.approx(1.0 - 11 / 200)
    assert intervals_of("ball hertz") == 1 and intervals_of("ball layer prony:3") == 7
    assert intervals_of("cylinder ogden2") == 4 and intervals_of("bonded ogden") == 2 == intervals_of("fingertip power")


def test_a_stratum_is_broken_only_if_chance_does_not_explain_its_share():
    """The range of a share is that of the exact binomial test: 83 % of 30 presses may be 95 %, 85 % of 1000 not."""
    for inside, presses in ((24, 28), (950, 1000), (28, 28), (0, 5)):
        expected = binomtest(inside, presses).proportion_ci(0.95, "exact")
        assert report.chance(inside / presses, presses) == pytest.approx(tuple(expected), abs=1e-9)
    assert report.chance(0.0, 0) == (0.0, 1.0)

    def row(missed, presses):
        results = ["missed"] * missed + ["inside"] * (presses - missed)
        return report.rows([
            Outcome("ball hertz", n, 1, {"noise": "white"}, result, 1.0, 1.0, [], ["young"] * (result == "missed"))
            for n, result in enumerate(results)
        ])[0]  # fmt: skip

    cases = {(5, 30): "open", (150, 1000): "low", (50, 1000): "within", (0, 100): "open", (5, 1000): "high"}
    assert {(missed, n): row(missed, n)["verdict"] for missed, n in cases} == cases


def test_results_go_to_the_file_that_is_named_and_are_not_fitted_again(tmp_path, monkeypatch):
    results = tmp_path / "kept" / "sample.jsonl"
    arguments = ["bench", "fits", "--case", "ball hertz", "-o", str(tmp_path), "--results", str(results), "--json"]
    runner = CliRunner()
    first = json.loads(runner.invoke(app, [*arguments, "--presses", "2"]).stdout)
    assert first["presses"] == 2 and len(results.read_text().splitlines()) == 2
    monkeypatch.setattr(searching, "judge", lambda *_: pytest.fail("fitted again"))
    assert json.loads(runner.invoke(app, [*arguments, "--presses", "2"]).stdout)["rows"] == first["rows"]
    assert not (tmp_path / searching.KEPT).exists()


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_no_press_of_a_larger_sample_is_silently_wrong(case):
    """If 95 % are right, more than 15 % of 40 are missed in 1 % of the draws."""
    outcomes = [judge(case, 7, number) for number in range(8 if "prony:" in case else 40)]
    assert not [outcome for outcome in outcomes if outcome.silent]
    assert sum(outcome.result == "missed" for outcome in outcomes) <= 0.15 * len(outcomes)


@pytest.mark.parametrize(
    ("case", "seed", "number"),
    [("punch exponential", 12, 5), ("fingertip power", 13, 24), ("punch exponential", 13, 61)],
)
def test_a_rise_before_contact_has_the_length_and_the_end_that_fit_best(case, seed, number):
    """Its length was one of four, and it ended where a fit without it begins: the intervals of these presses ended
    1.32, 2.7 (without a note) and 1.02 times away from the true values."""
    outcome = judge(case, seed, number)
    assert outcome.result in ("inside", "withheld"), outcome
    assert any("rises before contact" in note for note in outcome.notes)


def test_an_interval_keeps_what_it_was_widened_by():
    """The note said that a press which touches from its first row on is included, but the fit with a zero that drifts
    replaced the interval: it ended 2.25 times below the true stiffness. The search for the rise began only at the touch
    point without it, and ended in a minimum whose stiffness is 2.75 times off, with 1.19 times the squares."""
    outcome = judge("ball exponential", 14, 39)
    assert outcome.result in ("inside", "withheld") and any("from the first row on" in note for note in outcome.notes)
    assert outcome.off < 1.2


def test_prony_terms_that_the_rows_do_not_determine_are_reported():
    """A time that ended 2.25 times off, in a flat valley along which the second term takes its place, without a note:
    heavy-tailed noise put the true values three standard errors away."""
    outcome = judge("ball layer prony:2", 14, 1)
    assert not outcome.silent
    assert any("do not determine 2 Prony terms" in note and "prony:1" in note for note in outcome.notes)


def test_correlated_noise_on_a_slow_rise_does_not_hide_the_value():
    """It was counted over all rows, so that the fit with a bend, which the noise does not show, replaced the interval:
    1.516 times off, without a note."""
    assert judge("punch exponential", 14, 48).apart < 1.1


def test_noise_with_a_gain_on_an_untared_sensor_is_seen():
    """The zero of a load cell was counted as force of the law, so that noise that grows with the force looked constant,
    and the zero was held at the largest force: the interval ended 3.7 times below the true stiffness without a note."""
    outcome = judge("ball power", 9, 279)
    assert outcome.result == "inside" and any("noise grows with the force" in note for note in outcome.notes)


def test_errors_of_an_untared_press_are_relative_to_its_force():
    """They were relative to the largest reading, which is negative if the zero is."""
    s = np.linspace(0.0, 1e-3, 60)
    force = 2e3 * s**1.5
    noise = 7e-5 * np.random.default_rng(0).standard_normal(60)  # [N]
    press = prepare_press("press.csv", None, s, force - 3.0 * force.max() + noise)
    fit = fit_tissue([press], Rig("ball", 8e-3), "power", drift="none")
    assert fit.estimate.pressed[0].max() == approx(force.max(), rel=0.02)
    assert fit.errors()["rms_of_peak"] == approx(7e-5 / force.max(), rel=0.3)
