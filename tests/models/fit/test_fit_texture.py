"""`palpate fit texture` on recordings made of known models."""

import json
import re

import numpy as np
import pytest
from pytest import approx
from scipy.signal import lfilter
from shell_text import unwrapped
from strokes_of_a_surface import FORCES, SAMPLING, SPEEDS, resonance, strokes
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.texture import ENOUGH, rms_interval
from palpate.nodes.base.texture_file import read_texture
from palpate.physics.texture.autoregressive import line_spectrum, spectrum


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return strokes(tmp_path_factory.mktemp("texture") / "stroke.csv", 8000)


@pytest.fixture(scope="module")
def long_recording(tmp_path_factory):
    """70 windows at each speed and force."""
    return strokes(tmp_path_factory.mktemp("texture") / "long.csv", 14000)


def fit(*given):
    return CliRunner().invoke(app, ["fit", "texture", *map(str, given)])


def test_the_fit_recovers_the_models_and_predicts_the_held_out_speed(recording, tmp_path):
    target = tmp_path / "wood.json"
    result = fit(recording, "-o", target, "--json")
    assert result.exit_code == 0, result.output
    data, found = json.loads(result.output), read_texture(target)
    assert data["quantity"] == found.quantity == "force" and found.sampling == approx(SAMPLING, rel=1e-3)
    assert len(found.models) == len(SPEEDS) * len(FORCES)
    for model in found.models:
        assert min(abs(model.speed / speed - 1) for speed in SPEEDS) < 0.02
    speed, errors = found.held_out
    assert speed == approx(0.06, rel=0.02)
    assert max(abs(error) for frequency, error in errors if frequency < 800) < 2.0


def test_the_interval_has_about_its_nominal_coverage(long_recording, tmp_path):
    """Of the power above the 20 Hz of the high-pass."""
    fit(long_recording, "-o", tmp_path / "a.json")
    at, inside = np.linspace(20.0, SAMPLING / 2, 20_000), []
    for m in read_texture(tmp_path / "a.json").models:
        assert m.interval[0] < m.rms < m.interval[1] < m.interval[0] + 0.3 * m.rms
        speed = min(SPEEDS, key=lambda one: abs(one - m.speed))
        lsf = line_spectrum(resonance(speed))
        inside.append(
            m.interval[0] < np.trapezoid(spectrum(lsf, 0.3 * m.force * speed, SAMPLING, at), at) ** 0.5 < m.interval[1]
        )
    assert np.mean(inside) >= 0.75  # of eight, 95 % each


def test_the_table_names_speeds_intervals_and_the_error(recording, tmp_path):
    result = fit(recording, "-o", tmp_path / "b.json", "--held-out", "0.06")
    assert (
        result.exit_code == 0
        and "95 % interval" in result.output
        and re.search(r"held out, (59|60)\.?\d* mm/s", result.output)
    )
    again = fit(recording, "-o", tmp_path / "b.json")
    assert again.exit_code == 2 and "exists" in again.output


@pytest.mark.parametrize(
    ("rows", "options", "fault_text"),
    [
        ("t,speed,normal\n0,1,1\n", (), "expected lateral too"),
        ("t,speed,normal,lateral\n0,1,1,x\n", (), "row 2"),
        ("t,speed,normal,lateral\n" + "".join(f"{i * i},1,1,{i}\n" for i in range(9)), (), "equal steps"),
        ("t,speed,normal,lateral\n" + "".join(f"{i},1,1,{i}\n" for i in range(9)), (), "rows at 1 Hz"),
        ("t,speed,normal,lateral\n" + "".join(f"{i / 1e3},{1 + i % 2},1,{i % 3}\n" for i in range(900)), (), "steady"),
        (
            "t,speed,normal,lateral\n" + "".join(f"{i / 1e3},1,1,{i % 3}\n" for i in range(900)),
            ("--held-out", "3"),
            "1 m/s",
        ),
    ],
)
def test_a_bad_recording_is_an_error_with_the_reason(tmp_path, rows, options, fault_text):
    (tmp_path / "bad.csv").write_text(rows)
    result = fit(tmp_path / "bad.csv", *options)
    assert result.exit_code == 2 and fault_text in unwrapped(result.output)
    assert fit(tmp_path / "none.csv").exit_code == 2


def test_a_recording_that_is_not_text_is_an_error(tmp_path):
    (tmp_path / "bad.csv").write_bytes(bytes(range(256)))
    result = fit(tmp_path / "bad.csv")
    assert result.exit_code == 2 and "not a text file in UTF-8" in unwrapped(result.output)


@pytest.mark.parametrize(("windows", "wander", "least"), [(60, 0.0, 0.92), (60, 0.2, 0.9)])
def test_the_interval_is_right_for_windows_that_depend_on_each_other(windows, wander, least):
    """Levels of windows with a gain that wanders with a time constant of 3 windows; 400 recordings, true rms 1."""
    rng, inside = np.random.default_rng(2), 0
    for _ in range(400):
        log_gain = wander * lfilter([0.6975], [1.0, -np.exp(-1 / 3)], rng.normal(size=windows + 50))[50:]
        low, high = rms_interval(rng.gamma(3.0, 1 / 3.0, windows) * np.exp(2.0 * log_gain - 2.0 * wander**2))
        inside += low < 1.0 < high
    assert least < inside / 400 < 0.99


def test_no_interval_is_given_for_a_recording_too_short_to_show_how_the_gain_wanders(recording, tmp_path):
    assert rms_interval(np.random.default_rng(0).gamma(3.0, 1 / 3.0, ENOUGH - 1)) is None
    head, *rows = recording.read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join([head, *rows[:3000]]))
    result = fit(tmp_path / "short.csv")
    assert result.exit_code == 0, result.output
    assert f"withheld: fewer than {ENOUGH} steady windows" in unwrapped(result.output)
    assert all(model.interval is None for model in read_texture(tmp_path / "short.json").models)
