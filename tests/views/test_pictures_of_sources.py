"""Pictures of figures in the sources: friction across the motion, path, display to 4 N, published tissues, digit."""

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad
from scipy.special import jv
from scipy.stats import truncnorm
from test_pictures import near, press, record
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.files import SCENES
from palpate.launch.load.launchfile import find
from palpate.launch.load.tissues import settings, tissues
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import ForceBand, Friction, Pose
from palpate.nodes.base import SettingError
from palpate.nodes.contact.digit import Digit
from palpate.records.reader import Recording
from palpate.views.pictures import band, friction, path, profiles
from palpate.views.pictures.models import tissues as published
from palpate.views.pictures.touch import TouchStreams
from palpate.views.run import Run

STATES = {  # of the pad on 15 kPa: x, delta, a [mm] at P [N], computed by Brent's method and by 40-digit Newton
    1.0: (2.14838, 7.11786, 7.546),
    3.0: (2.84781, 13.62382, 10.440),
    4.0: (3.05080, 16.21917, None),
}


def touch_of(file):
    return TouchStreams(Recording(file))


def run(name, file, *sets, scene=None, **given):
    scene = None if scene is None else SCENES / f"{scene}.yaml"
    outcome = execute(find(name).but(record=file, place="fused", overrides=sets, scene=scene, **given))
    assert outcome.result.ok, outcome.result.deaths
    return file


def labelled(axes, start):
    return next(line for line in axes.lines if str(line.get_label()).startswith(start))


def test_the_picture_of_friction_shows_the_part_across_the_motion(tmp_path):
    """The finger slides along x; the force has a constant part along +y, to the left."""
    slip = (0.05, 0.0, 0.0)
    rub = Friction(force=(0.3, 0.1, 0.0), bristle=(0.0, 0.0, 0.0), stick=False)
    streams = {"c": [press(1e-3)] * 60, "f": [rub] * 60, "p": [near(1e-3, slip)] * 60}
    axes = friction.draw_picture(touch_of(record(tmp_path / "r.mcap", streams))).axes[0]
    assert labelled(axes, "part across").get_ydata() == approx(np.full(60, 0.1), abs=1e-12)
    assert labelled(axes, "friction force").get_ydata() == approx(np.full(60, np.hypot(0.3, 0.1)))


def test_the_stream_and_the_picture_agree_on_a_touch(tmp_path):
    """A graph with the node, on the kidney: along and across of the stream are those of the picture."""
    graph = tmp_path / "parts.yaml"
    graph.write_text(
        "extends: kidney\n"
        "nodes:\n"
        "  parts: {use: friction.Components, in: {friction: friction, contact: contact, proximity: collision}}\n"
    )
    sets = (
        "scene.surface.vertices=1500",
        "scene.hand.begin=[-0.01, 0, 0.111]",
        "scene.hand.path=[{to: [-0.01, 0, 0.098], time: 0.15}, {to: [0.01, 0, 0.097], time: 0.2},"
        " {to: [0.01, 0.015, 0.097], time: 0.2}]",
    )
    file = tmp_path / "r.mcap"
    assert execute(find(str(graph)).but(record=file, place="fused", overrides=sets, duration=0.6)).result.ok
    sent = Recording(file).columns("parts")
    _, normal, size, _ = friction.sliding(touch_of(file))
    assert friction.across(touch_of(file)) == approx(sent["across"], abs=1e-15)
    assert normal.tolist() == sent["normal"].tolist()
    assert np.hypot(sent["along"], sent["across"]) == approx(size, abs=1e-9)
    # a finger that turns to the left drags its bristles to the right
    turned = (sent["time"] > 0.36) & (sent["time"] < 0.45)
    assert sent["across"][turned].min() < -0.02


def test_the_path_is_where_the_finger_was_coloured_by_its_force(tmp_path):
    sets = ("scene.surface.vertices=1500", "scene.hand.begin=[-0.02, 0, 0.111]",
            "scene.hand.path=[{to: [-0.02, 0, 0.098], time: 0.15}, {to: [0.02, 0, 0.097], time: 0.3}]")  # fmt: skip
    touch = touch_of(run("kidney", tmp_path / "r.mcap", *sets, duration=0.5))
    above, side, _ = path.draw_picture(touch).axes
    place, contact = touch[Pose]["position"] * 1e3, touch.contact
    for axes, (x, y) in ((above, (0, 1)), (side, (0, 2))):
        line = labelled(axes, "in free space").get_xydata()
        assert line == approx(place[:, [x, y]], abs=1e-12)
        body, pressed = axes.collections
        faces = np.concatenate([face.vertices for face in body.get_paths()])
        assert np.ptp(faces[:, 0]) == approx(110.0, abs=0.5)  # the kidney's length
        assert pressed.get_array().max() == approx(contact["force"].max())
        assert len(pressed.get_segments()) == (contact["force"][1:] > 0.0).sum()


def test_marks_of_the_path_are_the_ends_and_extremes_of_touches_with_a_distance():
    time = np.arange(200) * 1e-3
    force = np.where((time >= 0.05) & (time < 0.15), np.sin((time - 0.05) / 0.1 * np.pi), 0.0)
    place = np.stack([1e3 * time, 0.0 * time, 0.0 * time], axis=1)  # 1 mm per tick
    assert path.marks(time, place, force) == [0, 50, 100, 150, 199]
    assert path.marks(time, 0.0 * place + time[:, None] * 1e-9, force)[0] == 0
    assert path.marks(time, np.zeros((200, 3)), force) == [0]


@pytest.fixture(scope="module")
def display(tmp_path_factory):
    """`palpate run softness --scene softness-4-newtons`."""
    return run("softness", tmp_path_factory.mktemp("display") / "r.mcap", scene="softness-4-newtons", duration=3.0)


def test_one_command_drives_the_display_to_four_newtons_with_profiles_and_states(display):
    figure = profiles.draw_picture(touch_of(display))
    left, middle, right = figure.axes
    assert figure.get_suptitle() == "The display from 0 to 4 N, on tissue of 15 kPa"
    cells = {key: cell.get_text().get_text() for key, cell in right.tables[0].get_celld().items()}
    for force, (x, delta, radius) in STATES.items():
        (row,) = (i for (i, j), text in cells.items() if j == 0 and i > 0 and text == f"{force:g}")
        assert float(cells[row, 1]) == approx(x, abs=6e-4) and float(cells[row, 2]) == approx(delta, abs=6e-4)
        assert radius is None or float(cells[row, 3]) == approx(radius, abs=6e-4)
        assert cells[row, 4] == "outside"
        profile = labelled(left, f"{force:g} N").get_ydata()
        assert profile[0] == approx(x + delta, abs=6e-4)  # on the axis: deformation and rigid motion
        state = labelled(middle, "rigid motion").get_xydata()
        assert np.interp(force, *state.T) == approx(delta, abs=6e-4)
    assert labelled(left, "0 N").get_ydata() == approx(np.zeros(300))
    grey = next(patch for patch in middle.patches if "outside" in str(patch.get_label()))
    assert grey.get_label() == "outside Hertz theory, above 0.098 N"


def test_the_display_of_the_run_follows_the_states(display):
    sent = Run(display)
    at = int(np.argmax(sent["sensor"]["force"] >= 4.0)) + 900
    assert 1e3 * sent["display"]["actuator"][at] == approx(STATES[4.0][1], abs=1e-3)


def test_published_tissues_are_drawn_with_the_shipped_law(tmp_path):
    """The law of the patch against an independent one: the pressure (1 - r²/R²)² on a frictionless half-space, whose
    compliance is I (1 - nu²)/(pi E R) with I = int (48 J3(x)/x³)² dx; the kidney's support adds up to 10 %."""
    target = tmp_path / "kidney.png"
    done = CliRunner().invoke(app, ["list", "tissues", "kidney-assumed", "-o", str(target)])
    assert done.exit_code == 0 and target.read_bytes()[:4] == b"\x89PNG", done.output
    depth = np.linspace(0.0, 10e-3, 50)
    integral = quad(lambda x: (48.0 * jv(3, x) / x**3) ** 2, 0.0, 400.0, limit=400)[0]
    assert integral == approx(2.4082, abs=1e-4)
    kidneys = {name: record for name, record in tissues()[0].items() if published.organ_of(name) == "kidney"}
    assert len(kidneys) == 5
    for name, entry in kidneys.items():
        plane = published.plane_modulus(entry)
        force = published.patch_force(settings(name, published.NOWHERE), depth)
        assert force[1:] == approx(depth[1:] * np.pi * plane * 8e-3 / integral, rel=0.1)
    ball = published.ball_force(published.plane_modulus(kidneys["kidney-assumed"]), depth)
    # the scene's former constant, K = 3.0e3 N/m^1.5 of a ball of 8 mm on 19 kPa (nu 0.45), here nu 0.499
    assert ball[1:] / depth[1:] ** 1.5 == approx(np.full(49, 3.0e3), rel=0.07)
    assert published.spread_of(kidneys["kidney-human-45Hz"]) == approx(0.5 / 4.9)


def test_a_picture_of_tissues_needs_a_name_and_a_picture_file(tmp_path):
    for words in (["-o", "x.png"], ["kidney-assumed", "-o", "x.txt"], ["kidney-nobody", "-o", "x.png"]):
        done = CliRunner().invoke(app, ["list", "tissues", *words])
        assert done.exit_code == 2 or "no tissue" in str(done.exception), done.output


def test_a_digit_predicts_the_force_of_the_subject_at_its_commanded_depth():
    """Against the published table and scipy's truncated normal law, along any closing direction."""
    mean = [0.02100, 0.24919, 0.73183, 1.38392, 2.09062, 2.72747]
    deviation = [0.02272, 0.03311, 0.04825, 0.07032, 0.10248, 0.14934]
    closing = np.array([0.6, 0.0, -0.8])
    touch = np.array([0.01, -0.02, 0.11])
    digit = Digit(closing=(6.0, 0.0, -8.0), touch=tuple(touch.tolist()), levels=(0.025, 0.975))
    aside = np.array([0.8, 5.0, 0.6]) * 1e-3  # across the closing direction
    places = [touch + closing * 1e-3 * d + aside for d in (1, 2, 3, 4, 5)]
    for k, sent in enumerate(FakeBus(digit).publish(*map(pose, places)), 1):
        assert sent.mean == approx(mean[k], abs=6e-6) and sent.deviation == approx(deviation[k], abs=6e-6)
        law = truncnorm(-sent.mean / sent.deviation, np.inf, sent.mean, sent.deviation)
        assert sent.quantiles == approx(law.ppf([0.025, 0.975]), rel=1e-6) and sent.valid
    apart, deeper = FakeBus(digit).publish(pose(touch - closing * 1e-3), pose(touch + closing * 6e-3))
    assert apart.mean == 0.0 and apart.valid and deeper.mean == approx(mean[5], abs=6e-6) and not deeper.valid
    with pytest.raises(SettingError, match="closing"):
        Digit(closing=(0.0, 0.0, 0.0))


def pose(place):
    return Pose(position=tuple(map(float, place)), velocity=(0.0, 0.0, 0.0), dt=1e-3)


def test_the_graph_of_a_digit_draws_its_depth_and_force_with_the_band(tmp_path):
    file = run("digit", tmp_path / "r.mcap", duration=1.5)
    touch = touch_of(file)
    left, right, below = band.draw_picture(touch).axes
    sent = Recording(file).columns("digit")
    assert labelled(left, "predicted force").get_ydata() == approx(sent["mean"])
    depth = below.lines[0].get_ydata()
    held = (sent["time"] > 1.35) & (sent["time"] < 1.5)
    assert depth[held] == approx(np.full(held.sum(), 2.0), abs=0.05)
    assert sent["mean"][held] == approx(np.full(held.sum(), 0.73183), abs=0.03)
    assert (sent["quantiles"][:, 0] <= sent["sample"]).all() and (sent["sample"] <= sent["quantiles"][:, 2]).all()
    assert labelled(right, "mean of the subject").get_xydata()[0, 1] == approx(0.021, abs=1e-3)
    other = {"d": [ForceBand(mean=0.0, deviation=0.0, levels=(0.5,), quantiles=(0.0,), sample=0.0, valid=True)] * 3}
    assert band.draw_picture(touch_of(record(tmp_path / "o.mcap", other))) is None
