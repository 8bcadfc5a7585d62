"""Pictures label what a reader would misread: hold, steps of beams, stop of pins, scales, names of variants."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from msgspec import structs
from pytest import approx
from test_pictures import near, press, record

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Friction, Ledger, Pins, Slip, fields
from palpate.records.reader import Recording
from palpate.views import pictures
from palpate.views.pictures import compression, deformation, energy, force, grip, pins, style
from palpate.views.pictures.models import compare
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
    assert all(
        orders[name][1] == picture.OF_A_FINGER and callable(picture.draw_picture) for name, picture in known.items()
    )
    assert len(set(orders.values())) == len(orders)


def test_the_hold_is_marked_with_its_duration_and_change(tmp_path):
    axes = force.draw_picture(touch(tmp_path, c=held(1.0, 0.8))).axes[0]
    label = next(line.get_label() for line in axes.lines if line.get_label().startswith("hold"))
    assert label == "hold, 0.10 s (ring to dot): −0.20 N"
    ring, dot = (line for line in axes.lines if line.get_marker() == "o")
    assert ring.get_ydata() == approx([1.0]) and dot.get_ydata() == approx([0.8], abs=3e-3)


def test_without_a_hold_nothing_is_marked(tmp_path):
    depth = 1e-3 * np.r_[np.linspace(0, 1, 101), np.linspace(1, 0, 101)]
    axes = force.draw_picture(touch(tmp_path, c=[press(d) for d in depth.tolist()])).axes[0]
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
    texts = [text.get_text() for text in force.draw_picture(made).axes[0].texts]
    assert any(text.startswith("steps of up to 40 mN") for text in texts)


@pytest.mark.parametrize(("highest", "labelled"), [(4e-3, True), (3.9e-3, False)])
def test_pins_at_their_stop_are_labelled(tmp_path, highest, labelled):
    heights = np.full((2, 2), highest)
    sent = [Pins(heights=heights, actuator=1e-3, limited=labelled, valid=True)] * 30
    plan = {"nodes": [{"name": "pins", "class": "nowhere.PinArray", "settings": {"stroke": 4e-3}}, {"name": "c"}]}
    file = record(tmp_path / "r.mcap", {"pins": sent, "c": [press(1e-3)] * 30}, plan)
    figure = pins.draw_picture(TouchStreams(Recording(file)))
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
    numbers = {field.name: field.type() for field in fields(Ledger) if not field.shape}
    sent = [Ledger(**{**numbers, "generated": generated})] * 30
    figure = energy.draw_picture(touch(tmp_path, ledger=sent))
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
    axes.imshow(np.zeros((600, 1000, 3), dtype=np.uint8))  # no corner is empty
    deformation._scales(axes, 1e-4, 0.02)
    bars = {text.get_text(): text for text in axes.texts if text.get_text()}
    assert set(bars) == {"10 mm", "0.5 N"}
    spans = sorted(
        abs(each.xy[0] - each.xyann[0]) for each in axes.texts if hasattr(each, "arrow_patch") and each.arrow_patch
    )
    assert spans == approx([100.0, 100.0])


@pytest.mark.parametrize(("body", "corner"), [(np.s_[300:], (0.0, 0.0)), (np.s_[:, :600], (0.68, 0.8))])
def test_the_scales_are_in_the_emptiest_corner(body, corner):
    covered = np.zeros((600, 1000), dtype=bool)
    assert deformation.emptiest(covered, 0.32, 0.2) == (0.0, approx(0.8))
    covered[body] = True
    assert deformation.emptiest(covered, 0.32, 0.2) == approx(corner)


def test_one_of_the_moments_of_the_pins_is_nearest_to_the_nodule():
    force, x = np.r_[0.0, np.ones(100), 0.0], np.linspace(-1.0, 1.0, 102)
    plain, near = pins.moments(force), pins.moments(force, np.abs(x - 0.1))
    nearest = int(np.abs(x - 0.1).argmin())
    assert len(plain) == len(near) == pins.COLUMNS and nearest in near and nearest not in plain
    assert len(set(plain) - set(near)) == 1


def test_a_touch_that_slides_is_not_called_a_press(tmp_path):
    feet = [(x, 0.0, 0.105) for x in np.linspace(0.0, 0.02, 60).tolist()]
    depth = 1e-3 * np.r_[np.linspace(0, 1, 30), np.linspace(1, 0, 30)]
    slid = force.draw_picture(touch(tmp_path, c=[press(d, foot=f) for d, f in zip(depth.tolist(), feet, strict=True)]))
    assert "moved 20 mm along the surface" in slid.get_suptitle()


def test_a_rigid_body_has_no_share_of_the_approach_and_the_limit_of_the_fingertip_is_shown(tmp_path):
    """A plate that yields by 1 nm: 3 mm are the fingertip's, whose soft tissue is 2 mm thick."""
    depth = 1e-3 * np.r_[np.linspace(0, 3, 50), np.linspace(3, 0, 50)]
    c = [structs.replace(press(1e-9, 1e3 * d), compression=d) for d in depth.tolist()]
    plan = {"nodes": [{"name": "c", "class": "nowhere.Series", "settings": {"thickness": 2e-3}}]}
    made = TouchStreams(Recording(record(tmp_path / "r.mcap", {"c": c}, plan)))
    assert compression.draw_picture(made) is None
    labels = force.draw_picture(made).axes[0].get_legend_handles_labels()[1]
    assert any("law not valid" in label for label in labels)


def test_the_bars_of_a_grip_show_when_a_finger_slides(tmp_path):
    """A finger that sticks for 0.2 s, slides at 10 mm/s for 0.2 s, and creeps without sticking for 0.2 s."""
    speed = np.repeat([0.0, 0.01, 1e-5], 200).tolist()
    friction = [Friction(force=(0.1, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=v == 0.0) for v in speed]
    made = touch(tmp_path, f=friction, p=[near(1e-3, (v, 0.0, 0.0)) for v in speed], c=[press(1e-3)] * 600)
    time, found = grip.slides(made)
    assert time[found].min() == approx(0.2, abs=0.03) and time[found].max() == approx(0.4, abs=0.03)
    assert found.sum() == approx(200, abs=20)


def test_the_text_is_legible_at_the_width_of_two_columns(tmp_path):
    """At 180 mm all texts of the pictures of a run have 5 points or more, and titles end in the figure."""
    file = tmp_path / "nodule.mcap"
    assert execute(find("nodule").but(record=file, place="fused", duration=1.0)).result.ok
    made = TouchStreams(Recording(file))
    with style.look():
        figures = {name: picture.draw_picture(made) for name, picture in pictures.pictures().items()}
        figures = {name: figure for name, figure in figures.items() if figure is not None}
        assert set(figures) >= {"force", "compression", "friction", "device", "pins"}
        for name, figure in figures.items():
            figure.draw_without_rendering()
            texts = [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]
            sizes = [text.get_fontsize() * 180.0 / 25.4 / figure.get_figwidth() for text in texts]
            assert min(sizes) >= 5.0, name
            titles = [axes.title for axes in figure.axes] + [axes._left_title for axes in figure.axes]
            for text in (each for each in titles if each.get_text()):
                assert text.get_window_extent().x1 <= figure.bbox.x1, (name, text.get_text())


MACHADO = {
    "normal vision": np.eye(3),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Machado, Oliveira and Fernandes, IEEE TVCG 15 (2009) 1291-1298, severity 1: linear RGB as others see it."""


def lightness_and_hue(colour, seen):
    """CIE L*a*b* of a colour #rrggbb."""
    value = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = to_xyz @ np.clip(seen @ linear, 0, 1) / to_xyz.sum(axis=1)
    x, y, z = (np.cbrt(v) if v > 0.008856 else 7.787 * v + 16 / 116 for v in (x, y, z))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize(("sight", "least"), list(zip(MACHADO, (25, 20, 20, 13), strict=True)))
def test_the_colours_of_lines_are_distinct_for_everyone(sight, least):
    """CIE76 differences; 2.3 is just noticeable."""
    lines = (style.INK, style.FINGER, style.TISSUE, style.NORMAL, style.FRICTION, style.SPEED, style.ENERGY)
    seen = {colour: lightness_and_hue(colour, MACHADO[sight]) for colour in lines}
    assert min(np.linalg.norm(seen[a] - seen[b]) for a, b in itertools.combinations(lines, 2)) > least


def test_the_colours_of_surfaces_are_those_of_their_bar():
    """The process that draws the surface interpolates them without matplotlib, which rounds down."""
    bar = style.deformation_colours()(np.arange(256), bytes=True).astype(int)
    assert np.abs(style.deformation_table().astype(int) - bar).max() <= 1


def test_panels_are_within_their_margins():
    """Margins and gaps [inch] of a grid, from the positions of its panels."""
    drawn = style.figure(10.0, 8.0, "title", layout="none")
    grid = drawn.subplots(3, 2)
    style.place_panels(drawn, 3, 2, left=1.0, right=0.5, bottom=0.7, top=0.6, across=0.4, down=0.3)
    size = np.array([10.0, 8.0])
    low, high = (
        np.array([[getattr(axes.get_position(), end) for axes in row] for row in grid]) for end in ("min", "max")
    )
    assert low[2, 0] * size == approx([1.0, 0.7]) and (1.0 - high[0, 1]) * size == approx([0.5, 0.6])
    assert (low[0, 1] - high[0, 0])[0] * 10.0 == approx(0.4) and (low[0, 0] - high[1, 0])[1] * 8.0 == approx(0.3)


@pytest.mark.parametrize("layout", ["none", "constrained"])
def test_the_title_covers_no_panel(layout):
    drawn = style.figure(8.0, 5.0, "What a title says", layout=layout)
    axes = drawn.subplots()
    axes.set_title("of a panel")
    if layout == "none":
        style.place_panels(drawn, 1, 1)
    drawn.canvas.draw()
    title = drawn.texts[0].get_window_extent()
    assert title.y0 > axes.title.get_window_extent().y1 and title.y1 <= drawn.bbox.y1
