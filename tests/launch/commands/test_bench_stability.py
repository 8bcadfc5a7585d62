"""`palpate bench stability`: table, picture, and options that describe no device."""

import csv
import json

import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.launch.__main__ import app

SHORT = ["bench", "stability", "--rate", "1000", "--delay", "1", "--damping", "0", "--json"]


def call(*options):
    return CliRunner().invoke(app, [*SHORT, *options])


def test_the_table_holds_theory_and_the_loop_of_the_users_own_device(tmp_path):
    told = json.loads(call("-o", str(tmp_path), "--drag", "0.4", "--coulomb", "0.003").stdout)
    (row,) = told["rows"]
    assert row["passive"] == approx(2 * 0.4 / 1e-3 / 3, rel=1e-5)
    assert row["quantised"] == approx(100.0)
    assert 0.7 * row["stable"] < row["bare"] < 1.5 * row["stable"] < row["controlled"]
    assert row["given_out"] < 5e-3
    with open(told["table"], encoding="utf-8") as file:
        (line,) = csv.DictReader(file)
    assert float(line["stable [N/m]"]) == approx(row["stable"], rel=1e-5)


@pytest.mark.parametrize("wrong", [("--drag", "0"), ("--mass", "nan"), ("--lost", "2"), ("--filter", "0")])
def test_a_device_that_is_none_is_refused_by_name(tmp_path, wrong):
    result = call("-o", str(tmp_path), *wrong)
    assert result.exit_code == 2 and wrong[0] in result.stdout and "expected" in result.stdout
    assert not (tmp_path / "stability.csv").exists()


def test_bodies_and_regions_come_with_tables_and_pictures(tmp_path):
    options = ("--body", "deformation.MassSpring", "--regions", "--coulomb", "0.05")
    told = json.loads(call("-o", str(tmp_path), *options).stdout)
    (row,) = told["bodies"]
    assert row["body"] == "deformation.MassSpring" and row["stable"] == approx(460, rel=0.05)
    assert {kind for line in told["regions"]["kinds"] for kind in line} >= {"rests", "rests from near by", "grows"}
    for name in ("bodies.csv", "bodies.png", "regions.png"):
        assert (tmp_path / name).stat().st_size > 100
    with (tmp_path / "bodies.csv").open(encoding="utf-8") as file:
        (line,) = csv.DictReader(file)
    assert float(line["stable [N/m]"]) == approx(row["stable"], rel=1e-5)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (("--body", "collision.Mesh"), "expected a node that takes Load"),
        (("--body", "deformation.Nope"), "no class 'Nope'"),
        (("--regions", "--resolution", "0"), "expected an encoder"),
    ],
)
def test_what_is_no_body_or_has_no_encoder_is_refused(tmp_path, wrong, told):
    result = call("-o", str(tmp_path), *wrong)
    assert result.exit_code == 2 and told in " ".join(result.stdout.split())
