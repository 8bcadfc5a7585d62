"""The library of tissues: every record has a source and the modulus of its law; a scene uses one by its name."""

import json

import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.engine.faults import GraphError
from palpate.launch.load import tissues as library
from palpate.launch.load.graph import load
from palpate.launch.load.tissues import bodies, material, settings, tissues
from palpate.physics.materials.hyperelastic import rest_moduli

GOOD = """
liver-x:
  {tissue: liver, species: pig, state: fresh, test: none, strain: 1 %, rate: 1 Hz, law: linear,
   parameters: {shear: 2 kPa}, shear: 2 kPa, grade: P, read: abstract, source: a paper}
"""


def test_every_record_has_a_source_and_its_modulus():
    found, left_out = tissues()
    assert len(found) > 30
    assert {r["species"] for r in found.values()} >= {"human", "pig", "silicone"}
    assert "liver-bovine-fresh" in left_out
    for name, record in found.items():
        assert record["source"], name
        assert 50.0 < rest_moduli(material(record))[0] < 1e5, name
        assert set(bodies(record)) == {"MassSpring", "BeamBundle", "ReducedFE", "full finite elements"}
    assert [name for name, r in found.items() if r["grade"] == "assumed"] == ["kidney-assumed"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("source: a paper", "source: ''", r"missing \['source'\]"),
        ("2 kPa}", "2 mm}", "expected a pressure or modulus"),
        ("2 kPa}", "3 kPa}", "shear 2000 Pa, its law has 3000 Pa at rest"),
        ("grade: P", "grade: A", "grade 'A' of P, S, R, assumed"),
        ("law: linear", "law: putty", "no material law 'putty'"),
        ("rate: 1 Hz", "speed: 1 Hz", r"missing \['rate'\], unknown \['speed'\]"),
    ],
)
def test_an_invalid_record_is_an_error(tmp_path, monkeypatch, old, new, expected):
    (tmp_path / "liver.yaml").write_text(GOOD.replace(old, new))
    monkeypatch.setattr(library, "TISSUES", tmp_path)
    with pytest.raises(GraphError, match=f"liver-x.*{expected}"):
        tissues.__wrapped__()


def test_a_misspelt_name_is_an_error_before_any_law_is_compiled(monkeypatch):
    monkeypatch.setattr(library, "tissues", lambda: pytest.fail("it checks all records first"))
    refused = CliRunner().invoke(app, ["list", "tissues", "liver-humn"])
    assert refused.exit_code == 2 and "Did you mean 'liver-human'" in refused.output + str(refused.exception)


def stiffness(graph):
    return graph.nodes["tissue"].settings["stiffness"], graph.nodes["tissue"].settings["retardation"]


def test_a_scene_takes_a_tissue_by_its_name_and_keeps_the_rest(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("extends: kidney\ntissue: liver-human\n")
    kidney = load("kidney").nodes["tissue"].settings["stiffness"] / (19e3 / (1 - 0.45**2))
    expected = kidney * 4 * 2090.0  # E/(1 - nu²) = 4 G for nu = 0.5
    for graph in (
        load("kidney", scene=file),
        load("kidney", overrides=["scene.tissue=liver-human"]),
    ):
        assert stiffness(graph) == (approx(expected, rel=5e-3), 0.02)
    graph = tmp_path / "graph.yaml"
    graph.write_text("extends: kidney\nscene: {tissue: liver-human}\n")
    assert stiffness(load(graph)) == (approx(expected, rel=5e-3), 0.02)
    reduced = load("kidney", scene=file, overrides=["tissue.use=deformation.ReducedFE"])
    assert reduced.nodes["tissue"].settings["young"] == approx(4 * 2090.0 * (1 - 0.45**2), rel=5e-3)


def test_the_assumed_kidney_equals_the_scene_kidney():
    assert stiffness(load("kidney", overrides=["scene.tissue=kidney-assumed"])) == stiffness(load("kidney"))


def test_an_unknown_tissue_is_an_error_with_the_nearest_name_or_the_reason():
    with pytest.raises(GraphError, match=r"no tissue 'liver-humann'") as caught:
        load("kidney", overrides=["scene.tissue=liver-humann"])
    assert "liver-human" in str(caught.value)
    assert str(caught.value).rstrip(".").endswith(" more") and "..." not in str(caught.value)  # the list is truncated
    with pytest.raises(GraphError, match="left out: Capilnasiu"):
        load("kidney", overrides=["scene.tissue=liver-bovine-fresh"])


def test_the_command_lists_the_tissues_and_those_left_out():
    listed = CliRunner().invoke(app, ["list", "tissues"])
    one = CliRunner().invoke(app, ["list", "tissues", "liver-human"]).output
    assert "shear: 2.09 kPa" in one and "grade       published" in one and "{" not in one
    assert listed.exit_code == 0
    assert "brain-human-cortex" in listed.output
    assert "liver-bovine-fresh" in listed.output
    printed = json.loads(CliRunner().invoke(app, ["list", "tissues", "fat-pig", "--json"]).output)["tissues"]["fat-pig"]
    assert printed["source"].startswith("Sims")
    assert printed["bodies"]["full finite elements"] == "neo_hooke, relaxation left out"
    assert settings("fat-pig", library.Location())["stiffness"] == printed["scene"]["stiffness"]
