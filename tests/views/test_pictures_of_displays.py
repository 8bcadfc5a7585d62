"""Pictures of a sliding fingertip, of pins and of the force band: their data, and that they are drawn."""

import numpy as np
import pytest
from pytest import approx
from test_pictures import UP, press, record, surface

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, ForceBand, Friction, Pins, Slip, Surface
from palpate.physics.display.pins import pin_grid
from palpate.records.reader import Recording
from palpate.views.errors import PictureError
from palpate.views.pictures import draw_pictures, force, pad, pins, slip, softness
from palpate.views.pictures.touch import TouchStreams


def run(graph, folder, *sets, duration):
    file = folder / f"{graph}.mcap"
    outcome = execute(find(graph).but(record=file, place="fused", duration=duration, overrides=sets))
    assert outcome.result.ok, outcome.result.deaths
    return file


def drawn(file, folder):
    lines: list[str] = []
    made = draw_pictures(file, folder, lines.append)
    assert all(path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" and path.stat().st_size > 10_000 for path in made)
    return {path.stem for path in made}, "\n".join(lines)


@pytest.fixture
def without_3d(monkeypatch):
    def refuse(touch):
        raise PictureError("not tested here")

    monkeypatch.setattr("palpate.views.pictures.deformation.Views", refuse)


@pytest.fixture(scope="module")
def slide(tmp_path_factory):
    sets = ("scene.finger.hold='0.3 s'", "finger.pitch='2.4 mm'")
    return run("fingertip-slide", tmp_path_factory.mktemp("slide"), *sets, duration=2.6)


@pytest.fixture(scope="module")
def nodule(tmp_path_factory):
    sets = ("scene.surface.vertices=4000",)
    return run("nodule", tmp_path_factory.mktemp("nodule"), *sets, duration=1.8)


def test_a_slide_has_pictures_of_force_phases_and_pad(slide, tmp_path):
    made, printed = drawn(slide, tmp_path)
    assert made == {"force", "slip", "pad"} and printed == ""


def test_a_press_on_the_display_has_pictures_of_pins_and_softness(tmp_path):
    made, printed = drawn(run("softness", tmp_path, duration=2.0), tmp_path)
    assert made == {"pins", "softness", "profiles"} and printed == ""


def test_a_nodule_has_pictures_of_force_band_and_pins(nodule, tmp_path, without_3d):
    made, _ = drawn(nodule, tmp_path)
    assert made == {"path", "force", "compression", "friction", "device", "pins"}
    assert len(force.draw_picture(TouchStreams(Recording(nodule))).axes) == 3


def test_a_force_picture_without_a_band_has_two_panels(tmp_path):
    assert (
        len(
            force.draw_picture(
                TouchStreams(Recording(record(tmp_path / "r.mcap", {"c": [press(1e-3), press(2e-3)]})))
            ).axes
        )
        == 2
    )


def test_the_phases_of_a_slide_match_the_messages_of_the_fingertip(slide):
    contact, friction, printed, at = slip.slides(TouchStreams(Recording(slide)))
    assert contact["time"][at.begin] == approx(0.8, abs=2e-3)
    assert printed["incipient"][at.warned] and not printed["incipient"][at.begin : at.warned].any()
    assert printed["gross"][at.gross] and not printed["gross"][at.begin : at.gross].any()
    assert contact["force"][at.end] > 0 and not contact["force"][at.end + 1 :].any()
    assert np.abs(friction["force"][: at.begin]).max() < 1e-9


def test_phases_without_slip_or_contact():
    nothing = np.zeros(10, dtype=bool)
    assert slip.phases(np.ones(10), np.zeros(10), nothing, nothing) == (None, None, None, 9)
    assert slip.phases(np.zeros(10), np.zeros(10), nothing, nothing) == (None, None, None, 9)
    rubbing = np.r_[np.zeros(4), np.ones(6)]
    assert slip.phases(np.ones(10), rubbing, nothing, nothing) == (4, None, None, 9)
    late = np.arange(10) > 6
    assert slip.phases(np.ones(10), rubbing, late, late) == (4, 7, 7, 9)


def test_the_pad_is_shown_from_full_depth_to_gross_slip():
    at = slip.Phases(150, 200, 300, 400)
    depth = np.minimum(np.arange(401), 100) * 1e-5
    assert pad.moments(np.ones(401), depth, at) == [100, 149, 200, 250, 300]
    assert pad.moments(np.ones(401), depth, slip.Phases(None, None, None, 400)) == [100, 250, 400]


def test_the_pressures_are_assigned_to_the_nodes_of_the_pad():
    printed = Slip(contacts=2, fraction=0, front=0, incipient=False, gross=False, state=[1, 0, 1], first=[-1.0] * 3,
                path=[0.0] * 3, points=[[0, 0], [1e-3, 0], [2e-3, 0]])  # fmt: skip
    sent = Surface(nodes=[0, 2], displacement=np.zeros((2, 3)), stiffness=1, exponent=1, damping=0,
                   rest_indentation=0, previous_indentation=0, pressure=[5.0, 7.0])  # fmt: skip
    assert pad._pressure(printed, sent).tolist() == [5.0, 0.0, 7.0]
    assert pad._pressure(printed, surface()).tolist() == [0.0] * 3 == pad._pressure(printed, None).tolist()


def test_subtracting_the_ring_mean_leaves_the_asymmetric_part():
    places = pin_grid(6, 6, 2.0)
    round_ = np.exp(-np.hypot(places[..., 0], places[..., 1]) / 3)
    assert pins.ring_mean(round_, places) == approx(round_)
    lump = round_.copy()
    lump[2, 4] += 1.0
    rest = lump - pins.ring_mean(lump, places)
    assert rest.argmax() == 2 * 6 + 4 and rest.max() == approx(1 - 1 / 8) and rest.sum() == approx(0, abs=1e-12)


def test_moments_of_pins_are_in_contact():
    force = np.r_[np.zeros(100), np.ones(200), np.zeros(100)]
    rows = pins.moments(force)
    assert len(rows) == 5 and all(force[row] > 0 for row in rows)
    assert pins.moments(np.zeros(5)) == [] and pins.moments(np.ones(1)) == [0]


def test_incomplete_streams_draw_nothing_and_raise_nothing(tmp_path):
    flat = Pins(heights=np.zeros((2, 3)), actuator=0.0, limited=False, valid=False)
    band = ForceBand(mean=0.0, deviation=0.0, levels=(0.5,), quantiles=(0.0,), sample=0.0, valid=True)
    one = Slip(
        contacts=0,
        fraction=0,
        front=0,
        incipient=False,
        gross=False,
        state=[],
        first=[],
        path=[],
        points=np.zeros((0, 2)),
    )
    rub = Friction(force=(0.0, 0.0, 0.0), bristle=UP, stick=True)
    cases = (
        ({"pins": [flat] * 2}, set()),
        ({"pins": [flat] * 2, "c": [press(0.0)] * 2}, set()),
        ({"pins": [flat] * 2, "c": [press(1e-3)] * 2}, {"force", "compression", "pins"}),
        ({"slip": [one]}, set()),
        ({"slip": [one] * 2, "c": [press(1e-3)] * 2, "f": [rub] * 2}, {"force", "compression", "slip"}),
        ({"band": [band] * 2, "c": [press(1e-3)] * 2}, {"force", "compression"}),
    )
    for k, (streams, expected) in enumerate(cases):
        made, printed = drawn(record(tmp_path / "r.mcap", streams), tmp_path / str(k))
        assert made == expected and printed == "", streams


def test_a_node_that_cannot_be_rebuilt_only_loses_its_picture(tmp_path):
    sent = Pins(heights=np.full((2, 2), 1e-3), actuator=1e-3, limited=False, valid=True)
    nodes = {"pins": "nowhere.PinArray", "c": "nowhere.Contact"}
    plan = {"nodes": [{"name": name, "class": kind, "settings": {}} for name, kind in nodes.items()]}
    recording = Recording(record(tmp_path / "r.mcap", {"pins": [sent] * 3, "c": [press(1e-3)] * 3}, plan))
    assert (
        softness.draw_picture(TouchStreams(recording)) is None
        and pins.draw_picture(TouchStreams(recording)) is not None
    )


def test_messages_of_a_touch_are_found_by_tick(slide):
    touch = TouchStreams(Recording(slide))
    messages = touch.at(Contact, [3, 700, 99999])
    assert sorted(messages) == [3, 700] and messages[700].tick == 700
    assert touch.at(Pins, [3]) == {}


def _title(axes):
    return axes.get_title() or axes.get_title(loc="left")


# --- content of the pictures of a touch ------------------------------------------------------------------------------


def test_a_quiet_force_keeps_its_peak_and_a_noisy_one_is_averaged():
    time = np.arange(2000) * 1e-3
    peak = np.where(time < 0.5, 5.0 * time, 0.4 + 2.1 * np.exp(-(time - 0.5) / 0.01))
    assert force.smooth_force(peak, time).max() == peak.max()
    noisy = peak + 0.05 * np.random.default_rng(0).standard_normal(len(time))
    assert np.std(np.diff(force.smooth_force(noisy, time)[1000:])) < 0.3 * np.std(np.diff(noisy[1000:]))


@pytest.mark.parametrize("unload", [0.05, 0.25, 4.0])
def test_loading_hold_and_unloading_are_found_at_any_speed(unload):
    """Pressed at 4 mm/s, held for 1 s, unloaded at `unload` mm/s."""
    time = np.arange(0.0, 1.5 + 2.0 / unload, 1e-3)
    way = np.minimum(4e-3 * time, 2e-3) - np.maximum(time - 1.5, 0) * unload * 1e-3
    wanted = np.select([time <= 0.5 + 1e-9, time <= 1.5 + 1e-9], [1, 0], -1)
    assert np.count_nonzero(force.movement(way, time) != wanted) <= 1


def test_a_still_finger_and_a_single_sample_count_as_rest():
    assert not force.movement(np.full(50, 1e-3), np.arange(50) * 1e-3).any()
    assert not force.movement(np.array([1e-3]), np.array([0.0])).any()


@pytest.mark.parametrize(
    ("sets", "duration", "title", "panels"),
    [
        (("scene.finger.distance=0", "scene.finger.lift='4 mm/s'"), 1.5, "Press, hold and lift", 2),
        (("scene.finger.distance=0", "scene.finger.lift='0.25 mm/s'"), 1.5,
         "Press, hold and unload: the recording ends in contact", 2),
        ((), 1.2, "Press, hold and slide: the recording ends in contact", 5),
    ],
)  # fmt: skip
def test_a_press_without_a_slide_has_no_empty_panels_and_another_title(tmp_path, sets, duration, title, panels):
    file = run(
        "fingertip-slide", tmp_path, "scene.finger.hold='0.3 s'", "finger.pitch='2.4 mm'", *sets, duration=duration
    )
    figure = slip.draw_picture(TouchStreams(Recording(file)))
    assert figure.get_suptitle() == title and len(figure.axes) == panels
    if panels == 2:  # relaxed at the end of the hold, not after unloading
        printed = [float(word) for word in _title(figure.axes[0]).split() if word.replace(".", "").isdigit()]
        contact = TouchStreams(Recording(file)).contact
        held = contact["force"][np.flatnonzero(contact["compression"] >= contact["compression"].max() * (1 - 1e-9))]
        assert printed == approx([held[0], contact["compression"].max() * 1e3, held[-1]], abs=0.06)


def test_the_pad_is_drawn_as_seen_from_below(slide):
    """Seen from below, with y upwards, x grows to the left."""
    figure = pad.draw_picture(TouchStreams(Recording(slide)))
    left, right = figure.axes[0].get_xlim()
    low, high = figure.axes[0].get_ylim()
    assert left > right and low < high


def test_every_axis_has_a_label_with_a_unit(slide, nodule):
    drawings = [(picture, slide) for picture in (force, slip, pad)] + [(picture, nodule) for picture in (force, pins)]
    for picture, file in drawings:
        for axes in picture.draw_picture(TouchStreams(Recording(file))).axes:
            for label in (axes.get_xlabel(), axes.get_ylabel()):
                assert not label.strip().startswith("["), (picture.__name__, label)
