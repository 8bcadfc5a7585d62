"""The vibration of a texture: its spectrogram, its waveform and the sliding speed."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.mlab import specgram

from palpate.messages.vibration import Vibration
from palpate.records.export.vibration import samples
from palpate.records.stored import RecordingError
from palpate.views.pictures.style import FRICTION, SPEED, figure
from palpate.views.pictures.touch import TouchStreams

ORDER, OF_A_FINGER = 60, False

_spectrogram: Any = specgram  # its type hints lack arrays
WINDOW = 0.05  # [s]
RANGE = 50.0  # [dB]
LEAST = 0.02  # [1] share of the time in which a frequency must be louder than RANGE to be in the picture
HIGHEST = 1000.0  # [Hz] highest frequency that a finger feels


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None if nothing slid over a texture."""
    stream = touch.stream_of(Vibration)
    if stream is None:
        return None
    try:
        force, sampling, speed = samples(touch.recording, [stream])
    except RecordingError:
        return None
    begin = float(next(iter(touch.recording.messages(stream))).time) / 1e9
    width = int(WINDOW * sampling)
    if len(force) < 2 * width:
        return None
    power, frequency, time = _spectrogram(force, NFFT=width, Fs=sampling, noverlap=3 * width // 4, pad_to=4 * width)
    level = 10.0 * np.log10(np.maximum(power, 1e-30) / power.max())
    out = figure(11.5, 7.0, "Vibration of the texture under the finger")
    upper, lower = out.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    mesh = upper.pcolormesh(begin + time, frequency, level, vmin=-RANGE, vmax=0.0, cmap="magma", rasterized=True)
    # Begin and end of a slide have all frequencies for a moment.
    loud = frequency[((level > -RANGE).mean(axis=1) > LEAST) & (frequency <= HIGHEST)]
    upper.set(ylabel="frequency [Hz]", ylim=(0.0, 1.2 * max(loud, default=HIGHEST)))
    label = "power density of the lateral force [dB of its peak]"
    out.colorbar(mesh, ax=upper, label=label, location="top", fraction=0.06, aspect=60)
    at = begin + np.arange(len(force)) / sampling
    slid = at[speed > 0.0]
    lower.set_xlim(slid[0] - WINDOW, slid[-1] + WINDOW)
    lower.plot(at, 1e3 * force, color=FRICTION, linewidth=0.4, rasterized=True)
    lower.set(xlabel="time [s]", ylabel="lateral force [mN]")
    right = lower.twinx()
    right.grid(False)
    right.plot(at, 1e3 * speed, color=SPEED, linewidth=1.2)
    right.set_ylabel("sliding speed [mm/s]", color=SPEED)
    return out
