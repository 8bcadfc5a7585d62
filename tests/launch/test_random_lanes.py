"""Distributions of the settings of an ensemble: their laws, seeds, joint sampling, published spreads, and errors."""

import json
import re

import numpy as np
import pytest
import scipy.stats

import palpate
from palpate.launch.load.tissues import spread_of, tissues
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.axes import Space, axis

SHORT = {"duration": 0.02, "every": 10, "sets": ("scene.hand.begin=[0, 0, 0.1085]",)}


def drawn(over, lanes=256, **given):
    asked = palpate.Ensemble("kidney", lanes, over, **SHORT | given)
    return {path: np.asarray(values) for path, values in asked.over.items()}


def test_the_values_follow_the_law_and_the_seed():
    over = {"tissue.retardation": {"uniform": ["10 ms", 0.03]}, "friction.mu_slide": {"norm": [0.5, 0.05]}}
    laws = {"tissue.retardation": scipy.stats.uniform(0.01, 0.02), "friction.mu_slide": scipy.stats.norm(0.5, 0.05)}
    found = drawn(over)
    for path, law in laws.items():
        assert scipy.stats.kstest(found[path], law.cdf).pvalue > 0.5 and len(set(found[path])) == 256
    assert abs(np.corrcoef(*found.values())[0, 1]) < 0.05  # sampled together
    again, other, frozen = drawn(over), drawn(over, seed=1), drawn(laws)
    for path in over:
        assert np.array_equal(found[path], again[path]) and np.array_equal(found[path], frozen[path])
        assert not np.array_equal(found[path], other[path])


def test_a_study_draws_the_same_values():
    over = {
        "tissue.stiffness": {"loguniform": [130, 390]},
        "friction.mu_slide": {"triang": {"c": 0.5, "loc": 0.3, "scale": 0.4}},
    }
    space = Space(tuple(axis(name, given) for name, given in over.items()), 32, "sobol", 5)
    lanes = drawn(over, 32, seed=5)
    assert all(space.columns()[path] == lanes[path].tolist() for path in over)


@pytest.mark.parametrize("tissue", ["liver-human", "prostate-human", "breast-human", "hypodermis-human"])
def test_a_published_spread_is_that_of_the_record(tissue):
    """Means and deviations as the sources print them: of G, of E, of E, and of C10."""
    record = tissues()[0][tissue]
    mean, deviation = {"liver-human": (2.09, 0.22), "prostate-human": (17.0, 9.0), "breast-human": (3.04, 1.17),
                       "hypodermis-human": (0.42, 0.05)}[tissue]  # fmt: skip
    assert spread_of(record) == pytest.approx(deviation / mean)
    found = drawn({"tissue.young": {"published": tissue}}, 512, tissue="deformation.ReducedFE")["tissue.young"]
    assert found.min() > 0.0
    low, middle, high = np.quantile(found, [0.159, 0.5, 0.841])
    assert (high - low) / 2.0 / middle == pytest.approx(deviation / mean, rel=0.12)
    stiff = drawn({"tissue.stiffness": {"published": tissue}}, 512)["tissue.stiffness"]
    np.testing.assert_allclose(stiff / np.median(stiff), found / np.median(found), rtol=1e-6)


@pytest.mark.parametrize(("given", "words"), [
    ({"published": "liver"}, "expected a tissue with a published spread"),
    ({"published": "brain-human-cortex"}, "expected a tissue with a published spread"),
    ({"published": "prostate-human-in-vivo"}, "standard deviation"),  # its record has the quartiles
    ({"norm": [1, -1]}, "which scipy.stats.norm cannot be"), ({"norm": ["2 parsecs", 1]}, "expected some numbers"),
])  # fmt: skip
def test_a_wrong_law_is_one_line(given, words):
    with pytest.raises(ArgumentError, match=re.escape(words)) as error:
        palpate.Ensemble("kidney", 4, {"tissue.stiffness": given}, **SHORT)
    assert "tissue.stiffness" in str(error.value)


def test_a_published_modulus_of_another_setting_and_a_wrong_seed_are_errors():
    with pytest.raises(ArgumentError, match="expected a path to `young` of ReducedFE or `stiffness` of MassSpring"):
        palpate.Ensemble("kidney", 4, {"tissue.damping": {"published": "liver-human"}}, **SHORT)
    with pytest.raises(ArgumentError, match="seed: found -1, expected a whole number from 0"):
        palpate.Ensemble("kidney", 4, {}, **SHORT, seed=-1)


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_the_drawn_values_and_their_laws_are_in_the_data_set(tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    over = {"tissue.stiffness": {"published": "liver-human"}}
    asked = palpate.Ensemble("kidney", 8, over, **SHORT | {"duration": 0.1, "every": 1}, seed=3)
    folder = asked.run(out=tmp_path / "set", form="lerobot", quiet=True)
    (file,) = folder.glob("meta/episodes/*/*.parquet")
    assert pq.read_table(file)["settings/tissue.stiffness"].to_pylist() == list(asked.over["tissue.stiffness"])
    about = json.loads((folder / "meta" / "palpate.json").read_text())
    assert about["distributions"] == {"tissue.stiffness": "{'published': 'liver-human'}"} and about["seed"] == 3
