"""The vibration of a texture as sound (WAV), and as MPEG haptics (ISO/IEC 23090-31, `.hjif`)."""

import json
import wave
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, cast

import numpy as np

from palpate.messages.vibration import Vibration
from palpate.physics.archive import replacing
from palpate.physics.texture.surface import third_octaves
from palpate.records.export import source
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

STEP = 0.02  # [s] between keyframes
LEAST = 1e-3  # [1] smallest amplitude of an exported band, as a fraction of the peak
NOISE = 0.898  # [1] noise bandwidth of a band's filter over its width: integral of 1/(1 + x^8)^2 from 0 to infinity


def samples(recording: Recording, streams: Sequence[str] = ()) -> tuple[np.ndarray, float, np.ndarray]:
    """Lateral force [N] (n), its sampling [Hz] and the sliding speed [m/s] (n) of the first stream of vibrations.

    RecordingError: no such stream, or nothing slid.
    """
    found = source(recording, Vibration, streams, "`palpate run texture` records one")
    blocks = cast(list[Vibration], list(recording.messages(found)))
    force = np.concatenate([np.zeros(0), *(block.lateral for block in blocks)])
    if not np.any(force):
        raise RecordingError(f"{recording.path}: nothing slid, so {found!r} is silent; expected a finger that "
                             "presses on the surface and moves along it")  # fmt: skip
    return force, blocks[0].sampling, np.repeat([b.speed for b in blocks], [len(b.lateral) for b in blocks])


def write_wav(recording: Recording, target: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """One channel of 16 bits; full scale is the largest force."""
    force, sampling, _ = samples(recording, streams)
    with replacing(target) as part, wave.open(str(part), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(sampling))
        file.writeframes(np.round(force * (32767.0 / np.abs(force).max())).astype("<i2").tobytes())
    return [target]


def write_hjif(recording: Recording, target: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Amplitudes of sines at the centres of third-octave bands, 50 times a second; the channel's gain is in newtons."""
    force, sampling, _ = samples(recording, streams)
    with replacing(target) as part:
        part.write_text(json.dumps(haptics(force, sampling, recording.path.stem)), encoding="utf-8")
    return [target]


def haptics(force: np.ndarray, sampling: float, name: str) -> dict[str, Any]:
    """The document of a force [N] (n)."""
    from scipy.signal import butter, sosfiltfilt  # slow to import

    # Amplitude of the force in each third-octave band, as RMS over intervals of `STEP`. A decoder interpolates linearly
    # between keyframes, where the mean square is (a^2 + ab + b^2)/3.
    width = max(round(STEP * sampling), 1)
    count = len(force) // width
    bands: list[dict[str, Any]] = []
    levels = []
    for centre in third_octaves(10.0, 0.45 * sampling):
        edges = centre * 10.0 ** np.array([-0.05, 0.05])
        if len(force) < 64 or count < 2:
            break
        part = sosfiltfilt(butter(4, edges, "bandpass", fs=sampling, output="sos"), force)[: count * width]
        level = np.sqrt(2.0 * np.mean(part.reshape(count, width) ** 2, axis=1) / NOISE)
        between = np.mean((level[1:] ** 2 + level[1:] * level[:-1] + level[:-1] ** 2) / 3.0)
        if between > 0.0:
            levels.append((centre, edges, level * np.sqrt(np.mean(level**2) / between)))
    # One sine effect per band, with a keyframe per interval. Decoders clip the sum of all bands at 1.
    gain = float(np.max(sum(level for *_, level in levels))) if levels else 1.0
    for number, (centre, edges, level) in enumerate(levels):
        if level.max() < LEAST * gain:
            continue
        frames = [{"relative_position": round(1e3 * STEP * (i + 0.5)), "frequency_modulation": round(centre),
                   "amplitude_modulation": round(float(a / gain), 5)} for i, a in enumerate(level)]  # fmt: skip
        effect = {
            "effect_type": "Basis",
            "id": number,
            "position": 0,
            "phase": 0.0,
            "base_signal": "Sine",
            "keyframes": frames,
        }
        bands.append({"band_type": "VectorialWave", "lower_frequency_limit": round(edges[0]),
                      "upper_frequency_limit": round(edges[1]), "effects": [effect]})  # fmt: skip
    # Wrap the bands in a channel, a perception and the document.
    channel = {
        "id": 0, "description": "lateral force; gain in newtons", "gain": gain, "mixing_coefficient": 1.0,
        "body_part_mask": 0, "bands": bands,
    }  # fmt: skip
    perception = {
        "id": 0, "avatar_id": 1, "description": "texture", "perception_modality": "Vibrotactile", "effect_library": [],
        "channels": [channel],
    }  # fmt: skip
    return {
        "version": "2023", "profile": "Main", "level": 2, "date": datetime.now().strftime("%Y-%m-%d"),
        "description": f"palpate: {name}", "timescale": 1000, "avatars": [{"id": 1, "lod": 0, "type": "Vibration"}],
        "perceptions": [perception], "syncs": [],
    }  # fmt: skip
