"""`palpate reduce --levels`: what it fits, where it stores it, and that the body that keeps to an error takes it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.launch.__main__ import app
from palpate.models.build import fidelity_levels as builder
from palpate.nodes.deformation import Adaptive
from palpate.physics.bodies.fidelity_bases import FidelityBases


@pytest.fixture
def elsewhere(monkeypatch, tmp_path):
    """The shipped levels stay as they are."""
    monkeypatch.setattr(builder, "TOUCHES", 6)
    monkeypatch.setattr(builder, "LEVELS", builder.LEVELS[3::4])
    for module in ("palpate.models.build.fidelity_levels", "palpate.nodes.deformation.adaptive"):
        monkeypatch.setattr(f"{module}.beside", lambda basis: tmp_path / "levels" / basis.name)
    return tmp_path / "levels"


@pytest.mark.long
def test_levels_are_fitted_stored_beside_the_basis_and_taken_by_the_node(elsewhere):
    ran = CliRunner().invoke(app, ["reduce", "--levels", "--json"])
    assert ran.exit_code == 0, ran.output
    told = json.loads(ran.stdout)
    assert told["path"] == str(next(elsewhere.iterdir())) and told["touches"] == 6 and 6 <= told["states"] <= 18
    made, about = FidelityBases.load(next(elsewhere.iterdir()))
    assert about["command"] == "palpate reduce --levels --set model=sampled --set surface=fingertip"
    taken = Adaptive().levels()
    assert taken.modes.tolist() == made.modes.tolist() == list(builder.SIZES)
    assert (made.kappa > 0.0).all()
    assert (np.diff(made.bends[:, 2]) < 0.0).all()  # more modes miss less


def test_levels_of_a_basis_that_is_not_stored_say_how_to_build_it(elsewhere):
    ran = CliRunner().invoke(app, ["reduce", "--levels", "--set", "modes=30"])
    assert ran.exit_code == 2 and "no reduced basis is stored" in " ".join(ran.output.split())
    assert not elsewhere.exists()


@pytest.mark.long
def test_levels_that_are_there_are_kept_unless_forced(elsewhere):
    first, again = (json.loads(CliRunner().invoke(app, ["reduce", "--levels", "--json"]).stdout) for _ in range(2))
    assert first["path"] == again["path"] and again["built"] is False
    forced = CliRunner().invoke(app, ["reduce", "--levels", "--force", "--json"])
    assert json.loads(forced.stdout)["touches"] == 6
