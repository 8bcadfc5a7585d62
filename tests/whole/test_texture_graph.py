"""The graph `texture`: replay, energy, sound, MPEG haptics, spectrogram."""

import json
import wave

import numpy as np
import pytest
from pytest import approx
from scipy.signal import butter, sosfilt

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Ledger
from palpate.records.changed import change_plan
from palpate.records.export import export
from palpate.records.export.vibration import haptics, samples
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError
from palpate.records.verify import verify


def run(path, duration, *overrides):
    outcome = execute(find("texture").but(duration=duration, record=path, place="fused", overrides=overrides))
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return run(tmp_path_factory.mktemp("texture") / "stroke.mcap", 1.3)


def test_it_replays_bit_for_bit_and_generates_no_energy(recording):
    assert verify(recording, change_plan(recording, ())).first is None
    ledger = recording.columns(recording.stream_of(Ledger))
    assert np.diff(ledger["friction_dissipated"]).min() > -1e-15 and not ledger["tripped"].any()
    assert ledger["generated"].max() < 1e-6  # [J] of the whole display; the same without a texture
    assert abs(ledger["unexplained"][-1]) < 1e-12 and ledger["friction_dissipated"][-1] > 1e-3


def test_the_vibration_starts_with_the_slip(recording):
    force, sampling, speed = samples(recording)
    assert sampling == 10e3 and len(force) == 13_000
    assert not force[speed == 0.0].any() and not force[:6000].any()
    steady = slice(9000, 13_000)
    assert speed[steady].mean() == approx(0.03, rel=0.05) and force[steady].std() > 0.01


def test_a_wav_has_the_samples(recording, tmp_path):
    (path,) = export(recording, "wav", tmp_path / "a.wav")
    with wave.open(str(path)) as file:
        assert (file.getnchannels(), file.getsampwidth(), file.getframerate()) == (1, 2, 10_000)
        played = np.frombuffer(file.readframes(file.getnframes()), "<i2") / 32767.0
    force = samples(recording)[0]
    assert played == approx(force / np.abs(force).max(), abs=2e-5)


def test_without_slip_there_is_no_sound(tmp_path):
    still = run(tmp_path / "still.mcap", 0.3)
    with pytest.raises(RecordingError, match="nothing slid"):
        export(still, "wav", tmp_path / "a.wav")
    with pytest.raises(RecordingError, match="every message"):
        export(still, "wav", tmp_path / "a.wav", every=2)
    assert not (tmp_path / "a.wav").exists()


NUMBER, TEXT, WHOLE = {"type": "number"}, {"type": "string"}, {"type": "integer"}


def needs(**properties):
    return {"type": "object", "required": list(properties), "properties": properties}


def several(items, **more):
    return {"type": "array", "items": items, **more}


FRAME = needs(
    relative_position=WHOLE, amplitude_modulation={"type": "number", "maximum": 1}, frequency_modulation=NUMBER
)
EFFECT = needs(
    effect_type={"enum": ["Basis"]}, id=WHOLE, position=WHOLE, phase=NUMBER, base_signal={"enum": ["Sine"]},
    keyframes=several(FRAME),
)  # fmt: skip
BAND = needs(
    band_type={"enum": ["VectorialWave"]}, lower_frequency_limit=WHOLE, upper_frequency_limit=WHOLE,
    effects=several(EFFECT, minItems=1),
)  # fmt: skip
CHANNEL = needs(
    id=WHOLE, description=TEXT, gain=NUMBER, mixing_coefficient=NUMBER, body_part_mask=WHOLE,
    bands=several(BAND, maxItems=63),
)  # fmt: skip
VIBRATION = {"enum": ["Vibration", "Vibrotactile"]}
POSITIVE = {"type": "integer", "minimum": 1}
PERCEPTION = needs(
    id=WHOLE,
    avatar_id=POSITIVE,
    description=TEXT,
    perception_modality=VIBRATION,
    effect_library=several({}),
    channels=several(CHANNEL),
)
HJIF = needs(
    version={"pattern": "^20(2[3-9]|[3-9][0-9])$"},
    profile={"enum": ["Main", "Simple Parametric"]},
    level={"enum": [1, 2]},
    date={"pattern": r"^\d{4}-\d\d-\d\d$"},
    description=TEXT,
    timescale={"type": "integer", "maximum": 48000},
    avatars=several(needs(id=POSITIVE, lod=WHOLE, type=VIBRATION)),
    perceptions=several(PERCEPTION),
    syncs=several({}),
)
"""Requirements of the reader and the checks of the reference software (MPEGGroup/HapticReferenceSoftware)."""


def test_mpeg_haptics_meet_the_requirements_of_the_reference_decoder(recording, tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    (path,) = export(recording, "hjif", tmp_path / "a.hjif")
    document = json.loads(path.read_text())
    jsonschema.validate(document, HJIF)
    channel = document["perceptions"][0]["channels"][0]
    assert channel["bands"] and 0.0 < channel["gain"] < 1.0


def decoded(document, t):
    """The force [N] at t [s]: the clipped sum of the sines, as the reference decoder computes it."""
    channel = document["perceptions"][0]["channels"][0]
    total = np.zeros_like(t)
    for band in channel["bands"]:
        frames = band["effects"][0]["keyframes"]
        at = np.array([frame["relative_position"] for frame in frames]) / 1e3
        level = np.interp(t, at, [frame["amplitude_modulation"] for frame in frames])
        total += level * np.sin(2 * np.pi * frames[0]["frequency_modulation"] * t)
    return channel["gain"] * np.clip(total, -1.0, 1.0)


def test_mpeg_haptics_reproduce_the_levels_of_the_bands():
    random, sampling = np.random.default_rng(0), 4000.0
    t = np.arange(8000) / sampling
    force = 0.2 * np.sin(2 * np.pi * 100 * t) + 0.05 * np.sin(2 * np.pi * 398 * t) + 1e-4 * random.normal(size=8000)
    document = haptics(force, sampling, "two")
    assert 10 * np.log10(np.mean(decoded(document, t) ** 2) / np.mean(force**2)) == approx(0.0, abs=1.0)
    bands = document["perceptions"][0]["channels"][0]["bands"]
    loudest = max(bands, key=lambda band: band["effects"][0]["keyframes"][50]["amplitude_modulation"])
    assert loudest["lower_frequency_limit"] < 100 < loudest["upper_frequency_limit"]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_mpeg_haptics_keep_the_level_of_noise_though_decoders_clip(seed):
    sampling = 8000.0
    sos = butter(2, (40.0, 800.0), "bandpass", fs=sampling, output="sos")
    force = sosfilt(sos, np.random.default_rng(seed).normal(size=80_000))
    out = decoded(haptics(force, sampling, "noise"), np.arange(80_000) / sampling)
    assert 10 * np.log10(np.mean(out**2) / np.mean(force**2)) == approx(0.0, abs=0.5)


def test_the_picture_is_a_spectrogram(recording):
    pytest.importorskip("matplotlib")
    from palpate.views.pictures import texture
    from palpate.views.pictures.touch import TouchStreams

    figure = texture.draw_picture(TouchStreams(recording))
    upper, lower = figure.axes[:2]
    assert "frequency" in upper.get_ylabel() and 100.0 < upper.get_ylim()[1] <= 1200.0 and "force" in lower.get_ylabel()
