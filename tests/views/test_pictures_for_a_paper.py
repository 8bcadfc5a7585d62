"""Pictures label what a reader would misread: hold, steps of beams, stop of pins, scales, names of variants."""

import re
from pathlib import Path

import numpy as np
import pytest
from pytest import approx
from test_pictures import press, record

from palpate.messages import Ledger, Pins, Slip, fields
from palpate.records.reader import Recording
from palpate.views import pictures
from palpate.views.pictures import compare, deformation, energy, force, pins
from palpate.views.pictures.touch import TouchStreams


def touch(path, **streams):
    return TouchStreams(Recording(record(path / "r.mcap", streams)))


def held(before, after):
    """A press of 1 mm in 50 ms, held for 100 ms while the force falls, and released."""
    depth = 1e-3 * np.r_[np.linspace(0, 1, 51), np.ones(100), np.linspace(1, 0, 51)]
    load = np.r_[np.linspace(0, before, 51), np.linspace(before, after, 100), np.linspace(after, 0, 51)]
    return [press(d, f) for d, f in zip(depth.tolist(), load.tolist(), strict=True)]


def test_a_file_with_draw_and_an_order_is_a_picture():
    """The files that define ORDER, by reading them, are those that are drawn, in this order."""
    orders = {}
    for file in Path(pictures.__path__[0]).glob("*.py"):
        if found := re.search(r"^ORDER, OF_A_FINGER = (\d+), (True|False)$", file.read_text(encoding="utf-8"), re.M):
            orders[file.stem] = (int(found[1]), found[2] == "True")
    known = pictures.pictures()
    assert list(known) == sorted(orders, key=orders.get) and len(known) >= 12
    assert all(orders[name][1] == picture.OF_A_FINGER and callable(picture.draw) for name, picture in known.items())
    assert len(set(orders.values())) == len(orders)


def test_the_hold_is_marked_with_its_duration_and_change(tmp_path):
    axes = force.draw(touch(tmp_path, c=held(1.0, 0.8))).axes[0]
    label = next(line.get_label() for line in axes.lines if line.get_label().startswith("hold of"))
    assert label == "hold of 0.10 s: -0.2 N"
    ring, dot = (line for line in axes.lines if line.get_marker() == "o")
    assert ring.get_ydata() == approx([1.0]) and dot.get_ydata() == approx([0.8], abs=3e-3)


def test_without_a_hold_nothing_is_marked(tmp_path):
    depth = 1e-3 * np.r_[np.linspace(0, 1, 101), np.linspace(1, 0, 101)]
    axes = force.draw(touch(tmp_path, c=[press(d) for d in depth.tolist()])).axes[0]
    assert not [line for line in axes.lines if line.get_marker() == "o"]


def test_the_steps_of_beams_are_those_in_which_one_comes_into_contact(tmp_path):
    """A force that rises by 1 mN per tick, by 40 mN when a second and a third beam touch, and by 90 mN without one."""
    steps = np.full(60, 1e-3)
    steps[[20, 40]], steps[50] = 0.04, 0.09
    load, beams = np.cumsum(steps), 1 + (np.arange(60) >= 20) + (np.arange(60) >= 40)
    slips = [
        Slip(contacts=int(n), fraction=0, front=0, incipient=False, gross=False, state=[], first=[], path=[],
             points=np.zeros((0, 2)))
        for n in beams
    ]  # fmt: skip
    c = [press(1e-5 * k, f) for k, f in enumerate(load.tolist())]
    made = touch(tmp_path, c=c, slip=slips)
    assert force.largest_step(made, 0.2) == approx(0.04)
    assert force.largest_step(made, 10.0) == 0.0
    texts = [text.get_text() for text in force.draw(made).axes[0].texts]
    assert any(text.startswith("steps of up to 40 mN") for text in texts)


@pytest.mark.parametrize(("highest", "labelled"), [(4e-3, True), (3.9e-3, False)])
def test_pins_at_their_stop_are_labelled(tmp_path, highest, labelled):
    heights = np.full((2, 2), highest)
    sent = [Pins(heights=heights, actuator=1e-3, limited=labelled, valid=True)] * 30
    plan = {"nodes": [{"name": "pins", "class": "nowhere.PinArray", "settings": {"stroke": 4e-3}}, {"name": "c"}]}
    file = record(tmp_path / "r.mcap", {"pins": sent, "c": [press(1e-3)] * 30}, plan)
    figure = pins.draw(TouchStreams(Recording(file)))
    labels = [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]
    assert any(label.startswith("stop of the pins, 4 mm") for label in labels) == labelled


def test_the_change_by_a_nodule_is_the_nodule():
    """A finger slides along x with a constant pattern of drag; near the nodule one pin rises."""
    drag = np.array([[0.3, 0.1], [0.2, 0.4]])
    x = np.linspace(-20e-3, 20e-3, 401)
    heights = np.repeat(drag[None], 401, axis=0)
    heights[np.abs(x) < 4e-3, 1, 0] += 1.0
    contact = {"foot": np.column_stack([x, 0 * x, 0 * x]), "force": np.ones(401)}
    plain = pins.without_nodule(heights, contact, 4e-3, np.zeros(3))
    assert (heights[200] - plain).tolist() == [[0.0, 0.0], [1.0, 0.0]]
    assert pins.without_nodule(heights, contact, 40e-3, np.zeros(3)) is None


@pytest.mark.parametrize(("generated", "panels"), [(0.0, 2), (2e-6, 2), (3e-4, 3)])
def test_an_empty_panel_of_generated_energy_is_left_out(tmp_path, generated, panels):
    numbers = {field.name: field.type() for field in fields(Ledger)}
    sent = [Ledger(**{**numbers, "generated": generated})] * 30
    figure = energy.draw(touch(tmp_path, ledger=sent))
    assert len(figure.axes) == panels
    assert any("generated by one part" in axes.get_title() + axes.get_title(loc="left") for axes in figure.axes)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("recorded", "recorded"),
        ("tissue.use=deformation.ReducedFE", "ReducedFE"),
        ("tissue.use=deformation.Rigid tissue.plate_stiffness=300", "Rigid, plate stiffness 300"),
        ("scene.finger.angle=45", "angle 45"),
    ],
)
def test_names_of_variants_are_readable(name, text):
    assert compare.readable(name) == text


def test_scales_are_round_and_fit():
    values = np.geomspace(1e-4, 1e4, 500)
    found = np.array([deformation.round_down(v) for v in values])
    assert (found <= values * (1 + 1e-9)).all() and (found > 0.39 * values).all()
    assert {f"{x:.0e}"[0] for x in found} == {"1", "2", "5"}


def test_the_scales_have_the_length_of_the_pixels(tmp_path):
    """10 pixels per mm and 200 pixels per newton in a picture of 1000 pixels: a bar of 10 mm and an arrow of 0.5 N."""
    from palpate.views.pictures.style import figure

    axes = figure(4, 3, "").subplots()
    axes.imshow(np.zeros((600, 1000, 3), dtype=np.uint8))
    deformation._scales(axes, 1e-4, 0.02)
    bars = {text.get_text(): text for text in axes.texts if text.get_text()}
    assert set(bars) == {"10 mm", "0.5 N"}
    spans = sorted(
        abs(each.xy[0] - each.xyann[0]) for each in axes.texts if hasattr(each, "arrow_patch") and each.arrow_patch
    )
    assert spans == approx([100.0, 100.0])
