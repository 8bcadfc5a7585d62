"""Constants of a body fitted to a reference: known ones are recovered, and the residual is reported."""

import json

import numpy as np
import pytest
from pressing import Spreader
from pytest import approx
from scipy.interpolate import RegularGridInterpolator
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.launch.load.launchfile import find
from palpate.messages import Load
from palpate.nodes.deformation import BeamBundle
from palpate.physics.errors import ArgumentError
from palpate.studies.accuracy.sites import load_reference
from palpate.studies.fit_body import fit_body, power_law

TAP = (
    "scene.surface.vertices=400",
    "scene.hand.begin=[0, 0, 0.110]",
    "scene.hand.path=[{to: [0, 0, 0.096], time: 0.1}, {hold: 0.05}, {to: [0, 0, 0.112], time: 0.1}]",
)


@pytest.mark.parametrize(
    ("n", "c", "tau"), [(1.0, 0.0, 0.0), (1.5, 5.0, 0.0), (2.2, 1.0, 0.0), (1.0, 0.0, 0.02), (1.4, 2.0, 0.007)]
)
def test_a_power_law_is_recovered_from_its_force(n, c, tau):
    t = np.linspace(0.01, 1.0, 300)
    depth, rate = 5e-3 * np.sin(3.0 * t) ** 2 + 1e-5, 5e-3 * 3.0 * np.sin(6.0 * t)
    force = 900.0 * np.maximum(depth + tau * rate, 0.0) ** n * (1.0 + c * rate)
    found = power_law(depth[force > 0.0], rate[force > 0.0], force[force > 0.0])
    assert found["exponent"] == approx(n, abs=2e-3) and found["damping"] == approx(c, abs=0.02)
    assert found["retardation"] == approx(tau, rel=0.01)
    assert found["stiffness"] * 5e-3 ** found["exponent"] == approx(900.0 * 5e-3**n, rel=1e-3)


def test_a_spring_fitted_to_another_spring_gets_the_constants_of_that_spring(tmp_path):
    launch = find("kidney").but(duration=0.27, overrides=TAP)
    file = tmp_path / "fitted.yaml"
    fitted = fit_body(launch, file, ["tissue.stiffness=900", "tissue.exponent=1.3", "tissue.damping=2"])
    assert fitted.overrides["tissue.stiffness"] == approx(900.0, rel=0.05)
    assert fitted.overrides["tissue.exponent"] == approx(1.3, abs=0.01)
    assert fitted.after["force"] < 0.01 < 0.05 < fitted.before["force"]
    settings = find(str(file)).load().nodes["tissue"].settings
    assert settings["exponent"] == fitted.overrides["tissue.exponent"] and "after:  force" in file.read_text()


def test_a_fit_that_makes_the_force_no_better_says_so(tmp_path):
    """Fitted to itself, a spring can only become worse."""
    launch = find("kidney").but(duration=0.27, overrides=TAP)
    fitted = fit_body(launch, tmp_path / "fitted.yaml", ["tissue.stiffness=257"])
    assert fitted.before["force"] == 0.0 and "keep the old ones" in fitted.caution


def test_a_spring_with_a_stiffness_map_gets_the_constants_of_a_half_space(tmp_path):
    """The reference has no map; the expected K is that of the reference divided by the factor of the map at the top of
    the kidney, 1.02 to 1.03."""
    (tmp_path / "mapped.yaml").write_text("extends: kidney\nscene: {tissue: {stiffness_map: basis}}\n")
    launch = find(str(tmp_path / "mapped.yaml")).but(duration=0.27, overrides=TAP)
    reference = ["tissue.stiffness_map=uniform", "tissue.stiffness=900", "tissue.exponent=1.3", "tissue.damping=2"]
    fitted = fit_body(launch, tmp_path / "fitted.yaml", reference)
    assert fitted.overrides["tissue.stiffness"] == approx(900.0 / 1.025 ** (2 * 1.3 - 1), rel=0.05)
    assert find(str(tmp_path / "fitted.yaml")).load().nodes["tissue"].settings["stiffness_map"] == "basis"


def test_a_bundle_fitted_to_one_of_twice_the_moduli_gets_these_moduli(tmp_path):
    beams = ("tissue.use=deformation.BeamBundle",)
    launch = find("kidney").but(duration=0.27, overrides=TAP + beams)
    fitted = fit_body(launch, tmp_path / "fitted.yaml", ["tissue.moduli=[272e3, 68e3]"])
    assert fitted.overrides["tissue.moduli"] == approx([272e3, 68e3], rel=0.15)
    assert fitted.after["force"] < 0.3 * fitted.before["force"]


SLAB = """
extends: kidney
surface: {surface: plane, vertices: 3000, position: [0, 0, 0.105]}
tissue: {friction: false, relaxations: [0, 0], retardation: 0}
hand:
  begin: [0, 0, 0.110]
  path: [{to: [0, 0, 0.0985], time: 0.4}, {hold: 0.1}]
"""


@pytest.mark.long
def test_a_bundle_fitted_on_the_slab_has_the_indentation_of_two_full_solvers_and_another_shape(tmp_path):
    """Compared with the stored reference of the slab's middle, which is independent of the bundle and of its fit."""
    (tmp_path / "slab.yaml").write_text(SLAB)
    beams = ("collision.use=collision.Mesh", "tissue.use=deformation.BeamBundle")
    launch = find("kidney").but(duration=0.5, overrides=beams, scene=tmp_path / "slab.yaml")
    fitted = fit_body(launch, tmp_path / "fitted.yaml")
    moduli, right = fitted.overrides["tissue.moduli"], load_reference("middle")
    depth, shape = pressed(moduli, right)
    shipped, _ = pressed(BeamBundle().moduli, right)
    assert np.abs(depth / right.indentation - 1.0).max() < 0.025
    assert (shipped / right.indentation < 0.7).all()
    at, deep = shape[4]  # 0.5 N
    exact = RegularGridInterpolator((right.x, right.y), right.shape[4])(np.abs(at))
    off = (deep - exact) / right.indentation[4]
    assert 0.2 < np.sqrt(np.mean(off**2)) < 0.3 and np.abs(off).max() < 0.5
    assert deep.max() == approx(1.25 * exact.max(), rel=0.03)


def pressed(moduli, right):
    """Indentation [m] of a bundle of these moduli at the forces of a reference, and its displayed surface within 16 mm
    of the position: points [m] (k,2) and depth [m] (k)."""
    body = BeamBundle(surface="plane", position=(0.0, 0.0, 0.0), moduli=moduli, relaxations=(0.0, 0.0))
    body.start()
    up, foot, spreader = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), Spreader(body.mesh(), 8e-3)
    depth, shapes = [], []
    for force in right.force:
        count = spreader.spread(foot, up, (0.0, 0.0, -force))
        nodes, forces = spreader.nodes[:count].copy(), spreader.forces[:count].copy()
        surface = body.step([Load(nodes=nodes, forces=forces, foot=foot, normal=up)], dt=1e-3)
        depth.append(surface.previous_indentation)
        at, deep = body.mesh().vertices[:, :2], np.zeros(len(body.mesh().vertices))
        deep[surface.nodes] = -surface.displacement[:, 2]
        near = np.linalg.norm(at, axis=1) < 16e-3
        shapes.append((at[near], deep[near]))
    return np.array(depth), shapes


def test_the_command_prints_the_remaining_error_of_a_spring_relative_to_the_elements(tmp_path):
    given = ["fit", "body", "kidney", "--duration", "0.27 s", "-o", str(tmp_path / "f.yaml"), "--json"]
    ran = CliRunner().invoke(app, [*given, *(word for text in TAP for word in ("--set", text))])
    assert ran.exit_code == 0, ran.output
    printed = json.loads(ran.stdout)
    assert printed["set"]["tissue.exponent"] < 1.3  # under a patch of fixed width the force is nearly linear
    assert printed["after"]["force"] < 0.7 * printed["before"]["force"] and printed["after"]["shape"] > 0.02


def test_an_unreadable_graph_is_an_error_before_the_time_estimate(tmp_path):
    file = tmp_path / "empty.yaml"
    file.touch()
    refused = CliRunner().invoke(app, ["fit", "body", str(file), "-o", str(tmp_path / "f.yaml")])
    assert refused.exit_code == 2 and "a touch of" not in refused.output


def test_a_body_without_a_constant_and_a_touch_in_the_air_are_errors(tmp_path):
    with pytest.raises(ArgumentError, match="expected one with a constant to calibrate"):
        fit_body(find("kidney").but(duration=0.1, overrides=["tissue.use=deformation.Rigid"]), tmp_path / "x.yaml")
    with pytest.raises(ArgumentError, match="samples in contact"):
        fit_body(find("kidney").but(duration=0.1, overrides=TAP[:1]), tmp_path / "x.yaml", ["tissue.stiffness=900"])
    assert not list(tmp_path.iterdir())


def test_relaxation_times_are_recovered_and_a_press_beyond_the_strain_limit_is_reported(tmp_path):
    """For a bundle with other moduli and other relaxation times, from a touch that presses, holds and releases."""
    launch = find("kidney").but(duration=0.27, overrides=(*TAP, "tissue.use=deformation.BeamBundle"))
    fitted = fit_body(launch, tmp_path / "f.yaml", ["tissue.moduli=[180e3, 45e3]", "tissue.relaxations=[2e-3, 40e-3]"])
    assert fitted.overrides["tissue.moduli"] == approx([180e3, 45e3], rel=0.02)
    assert fitted.overrides["tissue.relaxations"] == approx([2e-3, 40e-3], rel=0.05)
    assert fitted.after["force"] < 0.01 < fitted.before["force"] and not fitted.caution
    thin = ("scene.tissue.layers=[0.4 mm, 3.6 mm]",)
    fitted = fit_body(launch.but(overrides=thin), tmp_path / "g.yaml", ["tissue.use=deformation.ReducedFE"])
    assert "strain limit" in fitted.caution and "tissue: {layers: [" in fitted.caution
    assert fitted.caution in (tmp_path / "g.yaml").read_text(encoding="utf-8")
