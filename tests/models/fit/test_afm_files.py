"""Files of atomic force microscopes, read by `afmformats`."""

import sys

import numpy as np
import pytest
from pytest import approx
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.afm import read_afm
from palpate.models.fit.tissue.fit import fit_tissue
from palpate.models.fit.tissue.rigs import Rig

afmformats = pytest.importorskip("afmformats")

YOUNG, RADIUS, STIFFNESS = 10e3, 2.5e-6, 0.05


@pytest.fixture(scope="module")
def curve(tmp_path_factory):
    """A press by Hertz's law with a soft cantilever: the head moves down, the tip by the deflection less."""
    from afmformats.mod_force_distance import AFMForceDistance

    depth = np.concatenate([np.linspace(-1e-6, 0.22e-6, 500), np.linspace(0.22e-6, -1e-6, 500)])
    force = 16 / 9 * YOUNG * np.sqrt(RADIUS) * np.maximum(depth, 0.0) ** 1.5
    force += 2e-12 * np.random.default_rng(1).standard_normal(1000)
    made = AFMForceDistance(
        data={
            "force": force, "height (measured)": 8e-6 - depth - force / STIFFNESS, "time": 1e-3 * np.arange(1000),
            "segment": np.repeat([0, 1], 500).astype(np.uint8),
        },
        metadata={"spring constant": STIFFNESS, "imaging mode": "force-distance", "enum": 0, "path": "made",
                  "point count": 1000},
    )  # fmt: skip
    path = tmp_path_factory.mktemp("afm") / "curve.h5"
    made.export_data(path, fmt="hdf5", metadata=True)
    return path


def test_a_curve_gives_its_modulus(curve):
    (press,) = read_afm(curve)
    fit = fit_tissue([press], Rig("ball", RADIUS), "hertz")
    interval = fit.estimate.intervals["young"]
    assert interval.low <= YOUNG <= interval.high and interval.value == approx(YOUNG, rel=0.05)
    assert "0.05 N/m is subtracted" in press.remarks[0]


def test_the_command_takes_the_file_and_names_what_it_read(curve, tmp_path):
    given = ["fit", "tissue", str(curve), "--law", "hertz", "--rig", "ball", "--radius", "2.5 um", "-o", str(tmp_path)]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    assert "height (measured)" in (tmp_path / "report.md").read_text()


def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, capfd, monkeypatch, curve):
    for name in ("broken.h5", "broken.jpk-force", "broken.ibw", "broken.zip"):
        path = tmp_path / name
        path.write_bytes(b"no file of an instrument")
        with pytest.raises(SessionError, match=f"{name}: afmformats cannot read it"):
            read_afm(path)
    assert "Traceback" not in "".join(capfd.readouterr())
    monkeypatch.setitem(sys.modules, "afmformats", None)
    with pytest.raises(SessionError, match=r"palpate\[afm\]"):
        read_afm(curve)
