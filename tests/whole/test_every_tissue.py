"""Every body has the force of ReducedFE for every published tissue, on the kidney and on the slab, within its range."""

from dataclasses import replace

import numpy as np
import pytest
from expected_notes import BEYOND, RIGID, STIFF, UNTAKEN
from pytest import approx

import palpate
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.load.tissues import tissues
from palpate.launch.run.execute import execute
from palpate.physics.errors import PalpateWarning

SHALLOW, DEEP = 8.0e-3, 12e-3
"""[m] 1 and 1.5 radii of the patch, the range of the springs."""
BOUNDS = {"kidney": (0.02, 0.02), "texture": (0.04, 0.09)}
"""Largest errors [1] up to these indentations: at the top of the kidney, where the springs were fitted; on a slab."""
PRESS = "[{to: [0, 0, 0.0935], time: 0.25}, {hold: 0.15}]"
SETS = ("scene.surface.vertices=2500", "scene.hand.begin=[0, 0, 0.111]", f"scene.hand.path={PRESS}")


@pytest.fixture(scope="module", params=list(BOUNDS))
def held(request):
    """Contact force [N] and indentation [m] of each tissue at the end of a press, by body."""
    found = {}
    for body in ("ReducedFE", "MassSpring", "BeamBundle"):
        ensemble = palpate.Ensemble(
            request.param, len(tissues()[0]), {"scene.tissue": list(tissues()[0])},
            ["contact.force", "contact.indentation"], every=399, duration=0.4,
            sets=[*SETS, f"tissue.use=deformation.{body}", "scene.tissue.friction=false"],
        )  # fmt: skip
        with pytest.warns(PalpateWarning, match=UNTAKEN), pytest.warns(PalpateWarning, match=BEYOND):
            run = ensemble.run(quiet=True)
        found[body] = [np.asarray(run[f"contact.{name}"])[:, -1] for name in ("force", "indentation")]
    return found, BOUNDS[request.param]


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle"])
def test_every_tissue_has_the_force_of_the_reference_within_its_range(held, body):
    found, within = held
    force, depth = found["ReducedFE"]
    assert force.min() < 0.35 and force.max() > 3.0, "tissues from brain to silicone"
    error = found[body][0] / force - 1.0
    for limit, most in zip((SHALLOW, DEEP), within, strict=True):
        assert np.abs(error[depth < limit]).max() < most


@pytest.mark.notes(UNTAKEN, RIGID, BEYOND, STIFF)
def test_modulus_and_force_of_the_beams_are_proportional():
    """For one motion of the surface: a rigid finger, whose depth does not depend on the tissue."""
    rigid = [
        "contact.finger_law=power", "contact.finger_power_stiffness=1e9", "contact.finger_power_exponent=1",
        "contact.finger_damping=0", "scene.hand.hand_stiffness=1e5", "scene.hand.hand_damping=1000",
        "device.resolution=0", "finger.resolution=0", "controller.resolution=0", "controller.limit=0.001",
    ]  # fmt: skip
    names = ["kidney-assumed", "brain-human-compound", "silicone-EF50-0"]
    ensemble = palpate.Ensemble(
        "kidney", 3, {"scene.tissue": names}, ["contact.force"], every=20, duration=0.4,
        sets=[*SETS, *rigid, "tissue.use=deformation.BeamBundle", "scene.tissue.friction=false"],
    )  # fmt: skip
    force = np.asarray(ensemble.run(quiet=True)["contact.force"])
    moduli = [load("kidney", overrides=["tissue.use=deformation.BeamBundle", f"scene.tissue={name}"]).nodes["tissue"]
              .settings["moduli"] for name in names]  # fmt: skip
    assert moduli[1][0] / moduli[1][1] == approx(4.0, rel=1e-4)
    for one, (soft, _) in zip(force[1:], moduli[1:], strict=True):
        assert one == approx(force[0] * soft / moduli[0][0], rel=2e-3, abs=1e-3 * one.max())


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle"])
@pytest.mark.parametrize(("tissue", "deep"), [("kidney-human-76Hz", False), ("brain-human-compound", True)])
def test_an_indentation_beyond_the_range_is_noted(body, tissue, deep):
    sets = [*SETS, f"tissue.use=deformation.{body}", f"scene.tissue={tissue}"]
    result = execute(replace(find("kidney").but(overrides=sets, duration=0.4, place="fused"), record=None)).result
    assert any("1.5 radii of the patch" in note for note in result.notes) == deep
