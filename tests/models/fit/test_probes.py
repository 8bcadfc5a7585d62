"""Many sparse probes of one organ: reading, the pooled fit, the map over the surface, inclusions, the commands."""

import json
import math

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.probes import inclusion
from palpate.models.fit.probes.field import fit_field, matern
from palpate.models.fit.probes.fit import fit_probes
from palpate.models.fit.probes.inclusion import Ground, find_inclusions
from palpate.models.fit.probes.pooled import Rows, fit_pooled
from palpate.models.fit.probes.read import read_probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.rigs import Rig, closed_form
from palpate.nodes.base import SettingError
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.physics.materials.nodule import stiffness_map

BALL = Rig("ball", 8e-3)
DEPTH = np.linspace(0.05e-3, 0.78e-3, 10)


def hertz(young, touch, depth=DEPTH):
    return 16.0 / 9.0 * math.sqrt(8e-3) * young * np.maximum(depth - touch, 0.0) ** 1.5


def organ(seed, count=60, spread=0.3, noise=0.02):
    """Rows of probes with Young's moduli around 10 kPa, and the moduli."""
    random = np.random.default_rng(seed)
    young = 1e4 * np.exp(spread * random.standard_normal(count))
    touch = 1e-4 * random.standard_normal(count)
    peak = hertz(1e4, 0.0)[-1]
    forces = [hertz(e, t) + noise * peak * random.standard_normal(10) for e, t in zip(young, touch, strict=True)]
    return Rows.of([DEPTH] * count, forces), young


def table(rows, places=None, unit="mm", extra=""):
    lines = [f"probe,x [{unit}],y [{unit}],z [{unit}],depth [mm],force [N]{',' + extra if extra else ''}"]
    for i, (depths, forces) in enumerate(zip(rows.depth, rows.force, strict=True)):
        x, y, z = (float(3 * (i % 8)), float(3 * (i // 8)), 0.0) if places is None else 1e3 * places[i]
        lines += [f"{i + 1},{x:.4f},{y:.4f},{z:.4f},{1e3 * d:.5f},{f:.6f}" for d, f in zip(depths, forces, strict=True)]
    return "\n".join([*lines, ""])


def test_a_pooled_fit_finds_the_modulus_of_the_median_place_and_the_spread_between_places():
    rows, young = organ(1)
    fit = fit_pooled(rows, closed_form(BALL, "hertz"))
    low, high = fit.intervals["young"]
    assert low < 1e4 < high and 1.0 < high / low < 1.3 and not fit.withheld
    assert fit.spread == pytest.approx(0.3, abs=0.09)
    assert fit.noise == pytest.approx(0.02 * hertz(1e4, 0.0)[-1], rel=0.15)
    assert fit.touch[1] == pytest.approx(1e-4, rel=0.35)
    off = fit.shrunk - np.log(young)
    assert np.mean(np.abs(off) <= 1.96 * fit.shrunk_error) > 0.85
    # independent: with known touch points, the scatter of the best moduli of single probes
    assert np.std(off) < 0.5 * fit.spread


def test_intervals_of_the_median_contain_it():
    """Of 20 organs; at a coverage of 95 %, fewer than 16 have a probability of 1 in 400."""
    law, hits = closed_form(BALL, "hertz"), 0
    for seed in range(100, 120):
        low, high = fit_pooled(organ(seed, 25)[0], law).intervals["young"]
        hits += low <= 1e4 <= high
    assert hits >= 16


def test_a_law_that_the_mean_curve_does_not_follow_gives_no_interval_of_a_modulus():
    rows, _ = organ(2)
    bent = Rows(rows.depth, rows.force * (1.0 + 1.5 * rows.depth / DEPTH[-1]), rows.mask)
    assert "its modulus has no true value" in fit_pooled(bent, closed_form(BALL, "hertz")).withheld
    fit = fit_pooled(bent, closed_form(BALL, "power"))
    assert "no row before contact" in fit.withheld and 1.8 < fit.values["exponent"] < 2.6


@pytest.mark.parametrize(("law", "truth"), [("power", 1.5), ("exponential", 1200.0)])
def test_a_zero_of_the_force_that_all_probes_share_leaves_the_law(law, truth):
    """As of a robot whose sensor was not tared."""
    random, made = np.random.default_rng(0), closed_form(BALL, law)
    values = dict(zip([p.name for p in made.parameters], (50.0 if law == "exponential" else 3e4, truth), strict=True))
    touch, scale = 1e-4 * (1.5 + random.standard_normal(60)), np.exp(0.3 * random.standard_normal(60))
    bare = np.array([k * made.force(values, np.maximum(DEPTH - t, 0.0)) for k, t in zip(scale, touch, strict=True)])
    peak = np.median(bare[:, -1])
    zeros = 0.3 * peak + 0.02 * peak * random.standard_normal((60, 1))
    force = bare + zeros + 0.01 * peak * random.standard_normal(bare.shape)
    fit = fit_pooled(Rows.of([DEPTH] * 60, list(force)), made)
    low, high = fit.intervals[made.parameters[1].name]
    assert not fit.withheld and low < truth < high and high / low < 1.1
    assert fit.zero[0] == pytest.approx(0.3 * peak, abs=0.01 * peak)
    deeper = fit_pooled(Rows.of([DEPTH + 2e-4] * 60, list(force + 0.1 * peak)), made)  # the same curves, called deeper
    assert deeper.values[made.parameters[1].name] == pytest.approx(fit.values[made.parameters[1].name], rel=1e-2)
    late = np.array([k * made.force(values, DEPTH + 3e-4) for k in scale])
    assert "no row before contact" in fit_pooled(Rows.of([DEPTH] * 60, list(late + zeros)), made).withheld


def test_rows_beyond_the_law_and_probes_without_contact_are_left_out_with_the_reason(tmp_path):
    rows, _ = organ(3)
    rows.force[4] = 0.0
    (tmp_path / "a.csv").write_text(table(rows))
    probes = read_probes(tmp_path / "a.csv", {}, {})
    assert len(probes.names) == 59 and "probe 5: the force rises by 0 N" in probes.dropped[0]
    fit = fit_probes(probes, closed_form(Rig("ball", 6e-3), "hertz"))
    assert any(
        "rows are deeper than 0.6 mm and left out: the law hertz is valid to 0.6 mm" in text for text in fit.notes
    )
    with pytest.raises(SessionError, match="Take --law power or exponential"):
        fit_probes(probes, closed_form(Rig("ball", 2e-3), "hertz"))


def test_a_table_of_one_press_is_no_set_of_probes(tmp_path):
    (tmp_path / "a.csv").write_text("depth [mm],force [N]\n" + "".join(f"{k},{k}\n" for k in range(50)))
    assert read_probes(tmp_path / "a.csv", {}, {}) is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("x [mm]", "x"), "column 'x': no unit; give it with --unit x=UNIT, with mm"),
        (("y [mm]", "w [mm]"), "found the column 'x', expected x, y, z"),
        (("x [mm]", "x [m]"), r"the places span 21 m, expected at most 1 m"),
        (("2,3.0000", "2,nan"), "found 'nan', expected a finite number"),
    ],
)
def test_unusable_places_are_refused(tmp_path, change, message):
    (tmp_path / "a.csv").write_text(table(organ(4)[0]).replace(*change))
    with pytest.raises(SessionError, match=message):
        read_probes(tmp_path / "a.csv", {}, {})


def test_a_field_predicts_held_out_places_with_its_uncertainty():
    random = np.random.default_rng(5)
    places = np.column_stack([random.uniform(0.0, 0.1, (120, 2)), np.zeros(120)])
    true = np.linalg.cholesky(matern(cdist(places, places), 0.5, 0.03) + 1e-9 * np.eye(120)) @ random.standard_normal(
        120
    )
    values = 2.0 + true + 0.05 * random.standard_normal(120)
    field = fit_field(places[:90], values[:90], np.full(90, 0.05))
    value, error = field.at(places[90:])
    off = value - 2.0 - true[90:]
    assert np.std(off) < 0.5 * np.std(true) and not field.flat
    assert 0.8 < np.mean(np.abs(off) <= 2.0 * error) <= 1.0
    at = field.next_places(np.vstack([places[:5], [[0.5, 0.5, 0.0]]]), 1)
    assert at.tolist() == [5]  # the place far from all others


def test_places_that_are_not_similar_give_a_flat_field():
    random = np.random.default_rng(6)
    places = np.column_stack([random.uniform(0.0, 0.1, (80, 2)), np.zeros(80)])
    field = fit_field(places, random.standard_normal(80), np.full(80, 0.1))
    assert field.flat or field.length < 0.008


def lump(seed, radius=3e-3, top=1e-3, at=(0.012, 0.008)):
    """ln K at places above one ball, by the vertices' map of the nodule, averaged over discs of random points."""
    random = np.random.default_rng(seed)
    across, along = np.meshgrid(np.linspace(0.0, 0.015, 7), np.linspace(0.0, 0.024, 9))
    places = np.column_stack([along.ravel(), across.ravel(), np.zeros(along.size)])
    turn, away = random.uniform(0.0, 2.0 * np.pi, 2000), np.sqrt(1.0 - random.random(2000) ** (2.0 / 3.0))
    disc = 3.5e-3 * np.column_stack([away * np.cos(turn), away * np.sin(turn), np.zeros(2000)])
    normals = np.tile([0.0, 0.0, 1.0], (2000, 1))
    centre = [*at, -(radius + top)]
    factor = [stiffness_map(place + disc, normals, centre, radius, 100.0, 3.5e-3).mean() for place in places]
    return places, np.log(factor) + 0.03 * random.standard_normal(len(places))


@pytest.fixture
def few_draws(monkeypatch):
    """Half of the draws, one place for a ball, and no search for a second one: 6 times as fast."""
    monkeypatch.setattr(inclusion, "MOST", 1)
    monkeypatch.setattr(inclusion, "DRAWS", 5000)
    monkeypatch.setattr(inclusion, "BURN", 2000)
    monkeypatch.setattr(inclusion, "PEAKS", 1)


def test_a_stiff_ball_is_found_with_position_depth_and_radius(few_draws):
    places, values = lump(7)
    ground = Ground.of(places, None, 3.5e-3)
    (one,), _, scores = find_inclusions(ground, values, np.full(len(places), 0.02), 100.0)
    assert scores[1] < scores[0] - 10.0
    off = (one.position - [0.012, 0.008, 0.0]) @ ground.axes.T
    assert (np.abs(off) < 1e-3).all() and (np.abs(off) < np.array(one.across)).all()
    assert one.depth[1] < 4e-3 < one.depth[2] and one.radius[1] < 3e-3 < one.radius[2]


def call(*words):
    return CliRunner().invoke(app, ["fit", *map(str, words)], env={"COLUMNS": "200"})


def test_the_command_fits_sparse_probes_together_and_writes_a_scene(tmp_path):
    rows, _ = organ(8)
    (tmp_path / "a.csv").write_text(table(rows))
    done = call(
        "tissue", tmp_path / "a.csv", "--rig", "ball", "--radius", "8 mm", "--law", "hertz", "-o", tmp_path / "out"
    )
    assert done.exit_code == 0, done.output
    assert "60 probes, 600 rows; young of 95 % of the places" in done.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["parameters"]["young"]["low"] < 1e4 < report["parameters"]["young"]["high"]
    assert call("tissue", tmp_path / "a.csv", "--rig", "ball", "--radius", "8 mm", "--law", "hertz", "--relaxation",
                "prony:1", "-o", tmp_path / "b").exit_code == 2  # fmt: skip


def test_the_map_predicts_held_out_probes_better_than_their_mean_curve_and_is_the_map_of_a_scene(tmp_path, few_draws):
    places, away = lump(9)
    random, rows = np.random.default_rng(9), []
    for value in away:
        rows.append(hertz(1e4 * math.exp(value), 5e-6 * random.standard_normal()) + 2e-4 * random.standard_normal(10))
        rows[-1] += 0.05  # [N] the sensor was not tared
    (tmp_path / "a.csv").write_text(table(Rows.of([DEPTH] * len(rows), rows), places))
    out = tmp_path / "out"
    done = call("map", tmp_path / "a.csv", "--rig", "ball", "--radius", "8 mm", "--law", "hertz", "-o", out)
    assert done.exit_code == 0, done.output
    report = json.loads((out / "report.json").read_text())
    assert report["held_out"]["map"] < 0.5 * report["held_out"]["mean_curve"]
    assert len(report["next_places"]) == 6
    assert {one.name for one in out.iterdir()} >= {"map.csv", "map.png", "held_out.png", "scene.yaml", "report.md"}
    body = MassSpring(surface="plane", vertices=2500, position=(0.0, 0.0, 0.105), measured_map=str(out / "map.csv"))
    factor = body.hardness()
    assert factor.max() > 1.2 and (factor == 1.0).sum() > 1000
    stiff = body.mesh().vertices[int(np.argmax(factor))]
    middle = np.array([0.012, 0.008]) - places[:, :2].mean(axis=0)
    assert np.linalg.norm(np.abs(stiff[:2]) - np.abs(middle)) < 3e-3  # the axes of the plane may point either way


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x [m],y [m],z [m]\n", "expected factor too|cannot|no header|header"),
        ("x [m],y [m],z [m],factor\n0,0,0,1\n", "found 1 places, expected at least 4"),
        ("x [m],y [m],z [m],factor\n0,0,0,1\n0,1,0,1\n1,0,0,-2\n1,1,0,1\n", r"row 4: found the factor -2"),
        ("x [s],y [mm],z [mm],factor\n" + "0,0,0,1\n" * 5, "unit 's' is that of a time; expected a length"),
        ("x [m],y [m],z [m],factor\n" + "".join(f"{9 + k},9,9,1\n" for k in range(5)), "from the surface"),
    ],
)
def test_an_unusable_map_is_refused(tmp_path, text, message):
    (tmp_path / "map.csv").write_text(text)
    with pytest.raises(SettingError, match=message):
        MassSpring(surface="plane", vertices=400, measured_map=str(tmp_path / "map.csv")).hardness()


def test_a_zero_that_drifts_from_probe_to_probe_leaves_the_modulus():
    """By five peaks over the file: the zero of each probe is fitted, and its spread has no fixed limit."""
    rows, _ = organ(3)
    zero = 5.0 * np.median(rows.force.max(axis=1)) * np.arange(60)[:, None] / 60
    law = closed_form(BALL, "hertz")
    still, drifting = (fit_pooled(Rows(rows.depth, f, rows.mask), law) for f in (rows.force, rows.force + zero))
    assert drifting.values["young"] == pytest.approx(still.values["young"], rel=0.03)
    low, high = drifting.intervals["young"]
    assert not drifting.withheld and low < 1e4 < high
