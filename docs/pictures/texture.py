"""Draw the pictures of docs/texture.md: the spectrogram of the graph, and rendered and specified spectra.

python docs/pictures/texture.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Proximity
from palpate.nodes.texture import Spectral
from palpate.physics.texture.surface import density, third_octaves
from palpate.records.reader import Recording
from palpate.views.pictures import texture
from palpate.views.pictures.style import ENERGY, FINGER, FRICTION, NORMAL, SPEED, figure, look
from palpate.views.pictures.touch import TouchStreams

FOLDER = Path(__file__).parent
SPECTRUM = ((200.0, 1.0), (800.0, 1.0), (4000.0, 0.02))
RMS, FORCE, SAMPLING = 0.06, 1.0, 10e3


def stroke(speed: float) -> np.ndarray:
    """Lateral force [N] of a steady stroke over 1 m."""
    contact = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=FORCE, compression=0.0, indentation=0.0,
                      compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
    near = Proximity(foot=(0, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0.0, approach=0.0,
                     slip=(speed, 0.0, 0.0))  # fmt: skip
    rubbed = Friction(force=(0.5 * FORCE, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=False)
    bus = FakeBus(Spectral(spectrum=SPECTRUM, roughness=RMS), rate=50.0, contact=contact, proximity=near)
    return np.concatenate([vibration.lateral for _, vibration in bus.publish(*[rubbed] * round(50 / speed))])


def spectra() -> None:
    out = figure(9.0, 4.6, "Rendered (points) and specified (lines) third-octave levels, 1 N")
    axes = out.subplots()
    for speed, colour in zip((0.02, 0.05, 0.1, 0.2, 0.3), (NORMAL, FINGER, SPEED, FRICTION, ENERGY), strict=True):
        x = stroke(speed)
        at, power = np.fft.rfftfreq(len(x), 1 / SAMPLING), 2 * np.abs(np.fft.rfft(x)) ** 2 / len(x) ** 2
        fine = np.linspace(1.0, 4100.0 * speed, 200_000)
        wanted = density(np.array(SPECTRUM), fine / speed)
        wanted *= (RMS * FORCE) ** 2 / wanted.sum()
        centres = third_octaves(200.0 * speed, 4000.0 * speed)

        def levels(frequency, values, centres=centres):
            low, high = centres / 10**0.05, centres * 10**0.05
            return [
                10 * np.log10(values[(frequency >= a) & (frequency < b)].sum()) for a, b in zip(low, high, strict=True)
            ]

        axes.plot(centres, levels(fine, wanted), color=colour, linewidth=1.2)
        axes.plot(centres, levels(at, power), "o", color=colour, markersize=4, label=f"{1e3 * speed:.0f} mm/s")
    axes.set(xscale="log", xlabel="frequency [Hz]", ylabel="level [dB re 1 N]")
    axes.legend()
    out.savefig(FOLDER / "texture-spectra.png", dpi=100)


def main() -> None:
    with look():
        spectra()
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "texture.mcap"
            assert execute(find("texture").but(record=file, place="fused")).result.ok
            drawing = texture.draw_picture(TouchStreams(Recording(file)))
            assert drawing is not None
            drawing.savefig(FOLDER / "texture.png", dpi=90)


if __name__ == "__main__":
    from target import parser

    parser(__doc__).parse_args()
    main()
