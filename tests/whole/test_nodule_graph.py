"""A fingertip slides over a nodule: force, pins, and a subject's force band."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, ForceBand, Pins, Surface, unpack
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.contact.force_band import band_at
from palpate.physics.display.pins import pin_grid
from palpate.records.reader import Recording


def run(path, *overrides, place="fused", duration=2.2):
    outcome = execute(find("nodule").but(duration=duration, record=path, place=place, overrides=overrides))
    assert outcome.result.ok, outcome.result.deaths
    payloads: dict[str, list[bytes]] = {}
    for name, _, payload in Recording(path).payloads():
        payloads.setdefault(name, []).append(payload)
    return payloads


@pytest.fixture(scope="module")
def felt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("nodule")
    return run(folder / "hard.mcap"), run(folder / "plain.mcap", "tissue.nodule_radius=0")


def test_the_force_rises_only_over_the_nodule(felt):
    hard, plain = ([unpack(m, Contact) for m in streams["contact"]] for streams in felt)
    x = np.array([c.foot[0] for c in hard])
    gain = np.array([c.force for c in hard]) / np.maximum([c.force for c in plain], 1e-3)
    sliding = slice(900, 2200)
    over, beside = np.abs(x[sliding] - 4e-3) < 1e-3, x[sliding] > 10e-3
    assert gain[sliding][over].mean() > 1.08
    assert gain[sliding][over].mean() > gain[sliding][beside].mean() + 0.04


def test_the_highest_pin_stays_on_the_nodule_while_the_finger_slides(felt):
    hard, plain = ([unpack(m, Pins) for m in streams["display"]] for streams in felt)
    feet = {c.tick: c.foot[0] for c in (unpack(m, Contact) for m in felt[0]["contact"])}
    grid = pin_grid(8, 8, 2e-3)
    for tick in (1400, 1500, 1600, 1700, 1800):
        a, b = (next(p for p in pins if p.tick == tick) for pins in (hard, plain))
        assert a.valid
        row, column = np.unravel_index(np.argmax(a.heights - b.heights), a.heights.shape)
        where = feet[tick] + grid[row, column, 0]
        assert where == approx(4e-3, abs=3e-3) and abs(grid[row, column, 1]) < 2.1e-3
        assert (a.heights - b.heights).max() > 0.15e-3


def test_on_beams_the_pins_show_the_nodule_at_its_dragged_position(tmp_path):
    """Friction drags the skin above the nodule by 2.6 mm. In 75 % of the frames the pins show the nodule within 3 mm of
    this position (finite elements: 78 %), and in less than 70 % within 3 mm of its rest position."""
    beams = "tissue.use=deformation.BeamBundle"
    hard, plain = run(tmp_path / "h.mcap", beams), run(tmp_path / "p.mcap", beams, "tissue.nodule_radius=0")
    settings = next(n for n in Recording(tmp_path / "h.mcap").about["plan"]["nodes"] if n["name"] == "tissue")[
        "settings"
    ]
    mesh = surface_mesh(settings["surface"], settings["vertices"], tuple(settings["position"]))
    above = np.hypot(mesh.vertices[:, 0] - 4e-3, mesh.vertices[:, 1]) < 4e-3
    feet = {c.tick: c.foot[0] for c in (unpack(m, Contact) for m in hard["contact"])}
    skins = {s.tick: s for s in (unpack(m, Surface) for m in hard["tissue"])}
    grid, off, drag = pin_grid(8, 8, 2e-3), [], []
    for a, b in zip(
        (unpack(m, Pins) for m in hard["display"]), (unpack(m, Pins) for m in plain["display"]), strict=True
    ):
        if not (a.tick >= 800 and abs(feet[a.tick] - 4e-3) < 7e-3):
            continue
        moved = np.zeros(len(mesh.vertices))
        moved[skins[a.tick - 1].nodes] = skins[a.tick - 1].displacement[:, 0]
        highest = np.unravel_index(np.argmax(a.heights - b.heights), a.heights.shape)
        off.append(feet[a.tick] + grid[highest][0] - 4e-3)
        drag.append(moved[above].mean())
    away, dragged = np.array(off), np.array(drag)
    assert len(away) > 60 and dragged.max() > 2e-3
    assert (np.abs(away - dragged) < 3e-3).mean() >= 0.75 and (np.abs(away) < 3e-3).mean() < 0.7


def test_the_band_follows_the_compression_of_the_finger(felt):
    contacts = {c.tick: c for c in (unpack(m, Contact) for m in felt[0]["contact"])}
    for band in (unpack(m, ForceBand) for m in felt[0]["band"][60:150:10]):
        mean, deviation, _ = band_at(contacts[band.tick].compression)
        assert (band.mean, band.deviation) == approx((float(mean), float(deviation)))


def test_placement_does_not_change_a_byte(tmp_path, felt):
    apart = run(tmp_path / "apart.mcap", place=None, duration=0.5)
    assert apart["display"] == felt[0]["display"][: len(apart["display"])]
    assert apart["band"] == felt[0]["band"][: len(apart["band"])]
