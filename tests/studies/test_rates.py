"""The lowest rate of an effect, compared with the closed form of a sampled and held signal, and on complete touches."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shell_text import unwrapped
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.records.compare import compare
from palpate.studies import rates
from palpate.studies.motions import at_speeds, others, peak_speeds
from palpate.studies.search import record_touch

WAVE = """
nodes:
  source: {use: nodes_for_rates.Still}
  wave:  {use: nodes_for_rates.Wave, in: {pose: source}, frequency: FREQUENCY}
  log:    {use: logger.Mcap, in: all}
wanted: [wave]
"""


PERIODS = {0.5: 2.0, 2.0: 1.0, 11.0: 1.0}
"""Duration [s] of a signal of a frequency [Hz]: an integer number of periods, so long that its ends are negligible."""


def wave(write, tmp_path, frequency: float, *sets: str):
    launch = find(str(write("wave.yaml", WAVE.replace("FREQUENCY", str(frequency)))))
    return record_touch(launch.but(duration=PERIODS[frequency], overrides=sets), tmp_path / "touch.mcap")


def off(every: int, frequency: float) -> float:
    """rms of sin(w t) - sin(w (t - k dt)), k = 0 ... every - 1 in turn, over whole periods at 1 kHz."""
    turns = [1.0 - math.cos(2.0 * math.pi * frequency * k * 1e-3) for k in range(every)]
    return math.sqrt(sum(turns) / every)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 11.0])
@pytest.mark.parametrize("error", [0.01, 0.05, 0.3])
def test_the_rate_is_the_lowest_that_keeps_the_error_of_a_sampled_and_held_signal(write, tmp_path, frequency, error):
    (rate,) = rates.lowest_rates(wave(write, tmp_path, frequency), error)
    assert rate.constant == pytest.approx(math.sqrt(2.0) / (2.0 * math.pi * frequency), rel=2e-3)
    assert rate.every == max(every for every in rates.DIVISORS if off(every, frequency) <= error)
    assert rate.output_error == pytest.approx(off(rate.every, frequency) if rate.every > 1 else 0.0, rel=0.02)


def test_a_lower_rate_in_the_graph_does_not_change_the_answer(write, tmp_path):
    """The touch is computed at each tick first."""
    fast, slow = (next(rates.lowest_rates(wave(write, tmp_path, 2.0, f"wave.every={n}"), 0.05)) for n in (1, 50))
    assert (slow.before, fast.before) == (50, 1)
    assert (slow.every, slow.constant, slow.output_error) == (
        fast.every,
        pytest.approx(fast.constant),
        pytest.approx(fast.output_error),
    )


def test_an_effect_without_influence_keeps_its_rate(write, tmp_path):
    (rate,) = rates.lowest_rates(wave(write, tmp_path, 2.0, "wave.amplitude=0", "wave.every=5"), 0.05)
    assert rate.every == 5 and math.isinf(rate.constant)


@pytest.fixture(scope="module")
def kidney(tmp_path_factory):
    """A sudden press and a slide, with exact positions: the counts of an encoder change from tick to tick."""
    path = "[{to: [0, 0, 0.0935], time: 0.15}, {to: [0.005, 0, 0.0935], time: 0.1, shape: linear}]"
    sets = ["scene.surface.vertices=400", "scene.hand.begin=[0, 0, 0.107]", f"scene.hand.path={path}",
            "scene.tissue.stiffness=3e3", "scene.tissue.exponent=1.5", "scene.tissue.damping=5",
            "scene.tissue.retardation=0", "device.resolution=0"]  # fmt: skip
    return record_touch(find("kidney").but(duration=0.25, overrides=sets), tmp_path_factory.mktemp("kidney") / "t.mcap")


def test_effects_of_the_force_path_are_rated_by_the_error_of_the_force(kidney):
    recording, ticks = kidney, 250
    picked = {rate.node: rate for rate in rates.lowest_rates(recording, 0.02)}
    assert set(picked) == {"friction", "tissue"}
    assert picked["friction"].in_loop and 0.0 < picked["friction"].force_error <= 0.02
    assert 0.0 < picked["friction"].output_error <= 0.02
    assert picked["tissue"].force_error < 1e-9  # the law of this body has no memory
    assert 0.0 < picked["tissue"].output_error <= 0.02  # but its shape is late
    _, one = rates.together([recording], list(picked.values()), 0.02)
    assert one.error <= 0.02
    base, variant = compare(recording, [one.texts], reference=[rate.override(1) for rate in picked.values()])
    for name, rate in picked.items():
        steps, measured = variant.nodes[name].count, ticks / 3.0  # of those that slept none is counted
        assert rate.every > 1 and base.nodes[name].count > 0.5 * measured and steps <= measured / rate.every * 1.2 + 2


def test_each_effect_runs_at_every_tick_where_no_lower_rate_keeps_the_error(tmp_path):
    path = "[{to: [0.005, 0, 0.0975], time: 0.1, shape: linear}]"
    sets = ["scene.surface.vertices=400", "scene.hand.begin=[0, 0, 0.104]", f"scene.hand.path={path}"]
    tight = list(
        rates.lowest_rates(record_touch(find("kidney").but(duration=0.1, overrides=sets), tmp_path / "t.mcap"), 1e-6)
    )
    assert [(rate.every, rate.idle) for rate in tight] == [(1, False), (1, False)]


def test_the_effect_with_the_largest_error_runs_more_often_until_the_total_error_is_kept(kidney):
    slow = [
        rates.Rate("friction", "friction", 1, True, 0.2, 200, 0.0, 0.3),
        rates.Rate("tissue", "deformation", 1, True),
    ]
    picked, one = rates.together([kidney], slow, 0.02)
    assert 1 < picked[0].every < 200 and picked[1].every == 1
    assert one.error <= 0.02


def test_a_missed_error_raises_the_rate_of_its_effect():
    """It is the effect with too large an output error, otherwise the one with the largest force error, or none."""
    slow = [rates.Rate("a", "x", 1, True, 0.4, 20, force_error=0.008), rates.Rate("b", "y", 5, False, 0.1, 10)]
    one = rates.Evaluation({}, error=0.005, outputs=(0.001, 0.02))
    assert [rate.every for rate in rates.raise_rate(slow, one, 0.01)] == [20, 5]
    raised = rates.raise_rate(slow, replace(one, error=0.02, outputs=(0.001, 0.002)), 0.01)
    assert [rate.every for rate in raised] == [10, 10] and raised[0].force_error == pytest.approx(0.004)
    assert rates.raise_rate(slow, one, 0.03) is None
    assert rates.raise_rate([replace(rate, every=1) for rate in slow], one, 0.01) is None


@pytest.mark.long
def test_rates_are_valid_at_the_stated_speeds_of_the_hand(tmp_path):
    """Control: with the rate that is enough for a slow slide, friction misses the error in the same slide at high
    speed."""
    tap = "scene.hand.path=[{to: [0, 0, 0.096], time: 0.15}, {to: [0, 0, 0.112], time: 0.15}]"
    sets = ["scene.surface.vertices=400", "scene.hand.begin=[0, 0, 0.110]", tap]
    launch = find("kidney").but(duration=0.32, overrides=sets)
    file, error = tmp_path / "slow.yaml", 0.01
    found = rates.rates(launch, error, file, speeds=(1.0, 4.0))
    assert found.met and list(found.at) == [1.0, 4.0] and max(one.error for one in found.at.values()) <= error
    text = file.read_text()
    assert "at 1, 4 times its speed" in text and "4 times its speed: force error" in text
    assert "output errors friction" in text
    motions = at_speeds(launch, (1.0, 4.0))
    assert motions[4.0].duration == 0.08 and motions[4.0].load().nodes["device"].settings["speed_factor"] == 4.0
    slide = at_speeds(find("kidney").but(**TAP), (0.5, 4.0))
    calm = record_touch(slide[0.5], tmp_path / "calm.mcap")
    alone, one = rates.together([calm], rates.lowest_rates(calm, error), error)
    assert one.most <= error
    assert rates.ran(slide[4.0], alone, tmp_path).most > 1.5 * error


def test_the_reported_worst_error_is_that_of_all_speeds(tmp_path, monkeypatch):
    """Also where another speed has the larger RMS."""
    launch = find("kidney").but(duration=0.05, overrides=["scene.surface.vertices=400"])
    real, calls = rates.try_rates, iter(range(1, 100))

    def tried(*given):
        number = next(calls)
        return replace(real(*given), error=1e-6 * number, worst=1e-3 / number)

    monkeypatch.setattr(rates, "try_rates", tried)
    found = rates.rates(launch, 0.01, tmp_path / "slow.yaml", speeds=(1.0, 2.0))
    assert found.at[2.0].worst > found.at[1.0].worst and found.at[2.0].error < found.at[1.0].error
    assert (found.measured.error, found.measured.worst) == (found.at[1.0].error, found.at[2.0].worst)


TAP = {
    "overrides": ["scene.surface.vertices=400", "scene.hand.begin=[0, 0, 0.110]",
                  "scene.hand.path=[{to: [0, 0, 0.096], time: 0.15}, "
                  "{to: [0.02, 0, 0.097], time: 0.1, shape: linear}]"],
    "duration": 0.26,
}  # fmt: skip


def test_the_error_of_the_friction_output_is_reported(tmp_path):
    """The expected error is computed here from the friction of both runs, tick by tick."""
    recording = record_touch(find("kidney").but(**TAP), tmp_path / "t.mcap")
    picked = {rate.node: rate for rate in rates.lowest_rates(recording, 0.05)}
    friction = picked["friction"]
    assert friction.every > 1
    forces = []

    def on_tick(players):
        forces.append([player.last("friction")[0].force for player in players])

    sets = [[rate.override(1) for rate in picked.values()], ["tissue.every=1", friction.override()]]
    compare(recording, sets[1:], reference=sets[0], on_tick=on_tick)
    full, held = np.array(forces)[:, 0], np.array(forces)[:, 1]
    off = np.sqrt(((held - full) ** 2).sum(1).mean()) / np.linalg.norm(full, axis=1).max()
    assert friction.output_error == pytest.approx(off, rel=0.02) and 0.0 < off <= 0.05


def test_other_motions_reach_the_stated_fastest_speed_and_stay_in_the_region():
    launch = find("kidney").but(**TAP)
    low, high = peak_speeds(launch, (0.5, 3.0))
    assert low == pytest.approx(0.5 * 1.875 * 0.014 / 0.15, rel=1e-6)
    assert high == pytest.approx(3.0 * math.dist((0, 0.096), (0.02, 0.097)) / 0.1, rel=1e-6)
    paths = []
    for motion in others(launch, (low, high), range(20)):
        hand = motion.load().nodes["device"].settings
        path, here, fastest = hand["path"], hand["begin"], 0.0
        for step in path:
            if step["to"] is not None:
                mean = math.dist(here, step["to"]) / step["time"]
                fastest = max(fastest, mean * (1.0 if step["shape"] == "linear" else 1.875))
                here = step["to"]
                assert 0.0 <= here[0] <= 0.02 and 0.096 <= here[2] <= 0.110 and here[1] == 0.0
        assert fastest == pytest.approx(high) and motion.duration < 5.0
        paths.append(json.dumps(path))
    assert len(set(paths)) == 20
    assert not list(others(launch, (0.0, 0.0), range(3)))


@pytest.mark.long
def test_predictions_are_valid_on_motions_not_used_for_the_choice(tmp_path):
    """Slides and taps up to the fastest speed in the file, of shapes and seeds that the search does not use."""
    launch, file, error = find("kidney").but(**TAP), tmp_path / "slow.yaml", 0.1
    found = rates.rates(launch, error, file, speeds=(1.0, 2.0))
    assert found.met and all(rate.every > 1 for rate in found.tried) and len(found.unseen) == rates.HELD_OUT
    assert found.predicted.error == max(one.error for one in found.unseen)
    low, high = (1e3 * speed for speed in found.reach)
    text = file.read_text()
    assert f"Valid for moves of the hand at {low:.3g} to {high:.3g} mm/s" in text and "12 other motions" in text
    draw = np.random.default_rng(7)
    measured = []
    for _ in range(6):
        path, here = [], np.array([0.0, 0.0, 0.110])
        for z in (0.0965, 0.0975, 0.108, 0.097, 0.110):
            there = np.array([draw.uniform(0.0, 0.02), 0.0, z])
            time = float(np.linalg.norm(there - here)) / (found.reach[1] * (draw.uniform(0.3, 1.0) if path else 1.0))
            path, here = [*path, {"to": there.tolist(), "time": time, "shape": "linear"}, {"hold": 0.02}], there
        length = sum(step.get("time", 0.0) + step.get("hold", 0.0) for step in path)
        motion = launch.but(overrides=[f"scene.hand.path={json.dumps(path)}"], duration=length)
        measured.append(rates.ran(motion, found.tried, tmp_path))
    measured = rates.worst_of(measured)
    text = [rates.errors_text(found.tried, one) for one in (found.predicted, measured)]
    print("predicted {}; measured {}".format(*text))
    assert measured.most <= error and measured.error <= 1.2 * found.predicted.error, measured
    assert measured.worst <= 1.2 * found.predicted.worst, measured


def test_prediction_motions_only_decide_whether_the_error_is_kept(tmp_path, monkeypatch):
    """A motion over the error runs again at the raised rates. The last twelve are new, and an error in them raises no
    rate."""
    launch, file, runs = find("kidney").but(**TAP), tmp_path / "slow.yaml", []

    def ran(motion, picked, folder):
        runs.append((str(motion.overrides), picked[0].every))
        return rates.Evaluation({}, error=0.02 if len(runs) in (3, 15) else 0.001, worst=0.1, outputs=(0.0,))

    start = [rates.Rate("friction", "friction", 1, True, 0.2, 20, force_error=0.01)]
    monkeypatch.setattr(rates, "record_touch", lambda motion, path: path)
    monkeypatch.setattr(rates, "lowest_rates", lambda *given: start)
    monkeypatch.setattr(
        rates, "together", lambda seen, picked, error: (list(picked), rates.Evaluation({}, outputs=(0.0,)))
    )
    monkeypatch.setattr(rates, "ran", ran)
    found = rates.rates(launch, 0.01, file, speeds=(1.0, 2.0))
    assert [every for _, every in runs] == [20] * 3 + [10] * (4 + 2 + 12)
    motions = [motion for motion, _ in runs]
    assert motions[2] == motions[3] and len(set(motions)) == 6 + 2 + 12
    assert not found.met and found.predicted.error == 0.02 and not file.exists()


def test_a_path_over_the_error_is_measured_at_every_speed_at_the_raised_rates(tmp_path, monkeypatch):
    runs = []

    def ran(motion, picked, folder):
        runs.append((motion.duration, picked[0].every))
        return rates.Evaluation({"x.every": picked[0].every}, error=0.02 if len(runs) == 8 else 0.001, outputs=(0.0,))

    start = [rates.Rate("friction", "friction", 1, True, 0.2, 20, force_error=0.01)]
    monkeypatch.setattr(rates, "record_touch", lambda motion, path: path)
    monkeypatch.setattr(rates, "lowest_rates", lambda *given: start)
    monkeypatch.setattr(
        rates, "together", lambda seen, picked, error: (list(picked), rates.Evaluation({}, outputs=(0.0,)))
    )
    monkeypatch.setattr(rates, "ran", ran)
    found = rates.rates(find("kidney").but(**TAP), 0.01, tmp_path / "slow.yaml", speeds=(1.0, 2.0))
    assert runs[6:10] == [(0.13, 20), (0.26, 20), (0.26, 10), (0.13, 10)]
    assert list(found.at) == [1.0, 2.0] and all(one.overrides == {"x.every": 10} for one in found.at.values())


def test_a_motion_without_a_scripted_hand_has_one_speed(write):
    launch = find(str(write("wave.yaml", WAVE.replace("FREQUENCY", "2"))))
    assert at_speeds(launch, (0.5, 2.0)) == {1.0: launch}


def test_the_command_writes_the_predicted_graph_and_runs_it(tmp_path, write, monkeypatch):
    graph = write("wave.yaml", WAVE.replace("FREQUENCY", "2"))
    file = tmp_path / "slow.yaml"
    given = ["rates", str(graph), "--error", "5 %", "--duration", "0.5 s", "-o", str(file)]
    ran = CliRunner().invoke(app, [*given, "--json"])
    assert ran.exit_code == 0, ran.output
    printed = json.loads(ran.stdout)
    assert printed["set"] == {"wave.every": 10}
    assert printed["effects"][0]["error"] == pytest.approx(off(10, 2.0), rel=0.02)
    assert find(str(file)).load().nodes["wave"].every == 10
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    ran = CliRunner().invoke(app, given[:-2])
    assert ran.exit_code == 0 and "113 ms" in ran.output and "predicted" in ran.output
    assert "palpate run runs/wave-rates.yaml" in ran.output and find("runs/wave-rates.yaml").duration == 0.5
    assert [file.name for file in Path().iterdir()] == ["runs"]


def spoilt(monkeypatch, times: int) -> None:
    """The force of the touch contributes to the error, and the first runs do not keep it."""
    found, measured, left = rates.lowest_rates, rates.try_rates, [times]

    def tried(recording, picked, texts=()):
        one = measured(recording, picked, texts)
        if left[0] and not texts:
            left[0] -= 1
            return replace(one, error=1e3)
        return one

    monkeypatch.setattr(rates, "try_rates", tried)
    monkeypatch.setattr(rates, "lowest_rates", lambda *a: (replace(rate, force_error=0.04) for rate in found(*a)))


def test_rates_are_raised_until_a_run_keeps_the_error(tmp_path, write, monkeypatch):
    graph, file = write("wave.yaml", WAVE.replace("FREQUENCY", "2")), tmp_path / "slow.yaml"
    given = ["rates", str(graph), "--error", "5 %", "--duration", "0.5 s", "-o", str(file)]
    spoilt(monkeypatch, 1)
    ran = CliRunner().invoke(app, [*given, "--json"])
    assert ran.exit_code == 0, ran.output
    assert json.loads(ran.stdout)["set"] == {"wave.every": 5}  # 10, if the run had kept it
    assert find(str(file)).load().nodes["wave"].every == 5


def test_nothing_is_written_where_no_run_keeps_the_error(tmp_path, write, monkeypatch):
    graph, file = write("wave.yaml", WAVE.replace("FREQUENCY", "2")), tmp_path / "slow.yaml"
    spoilt(monkeypatch, 100)
    ran = CliRunner().invoke(app, ["rates", str(graph), "--error", "5 %", "--duration", "0.5 s", "-o", str(file)])
    assert ran.exit_code == 1
    assert "Nothing is written" in unwrapped(ran.output) and not file.exists()


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (["kidney", "--error", "5"], "such as '1 %'"),
        (["kidney", "--error", "0 %"], "such as '1 %'"),
        (["kidney", "--error", "2 % force"], "such as '1 %'"),
        (["kidney", "--speeds", "fast"], "such as '0.5, 1, 2'"),
        (["kidney", "--speeds", "0, 1"], "expected numbers above 0"),
        (["fingertip-slide"], "no effect of this graph is a separate node"),
        (["falcon", "--set", "device.port=emulator"], "expected a simulated device"),
    ],
)
def test_invalid_input_is_an_error_of_one_line(given, text):
    ran = CliRunner().invoke(app, ["rates", *given])
    assert ran.exit_code == 2
    assert text in unwrapped(ran.output)
