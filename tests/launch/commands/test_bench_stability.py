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
