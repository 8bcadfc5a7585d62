"""The scripts that draw and time the beam bundle, and that draw softness, run and print plausible figures."""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.long
def test_the_pictures_are_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    runpy.run_path(str(ROOT / "docs/pictures/beam_bundle.py"))["main"](tmp_path)
    sizes = {p.name: p.stat().st_size for p in tmp_path.glob("*.png")}
    assert set(sizes) == {f"beam-bundle-{name}.png" for name in ("run", "pad", "normal", "press", "slide", "local")}
    assert min(sizes.values()) > 20_000


@pytest.mark.long
def test_the_pictures_of_softness_are_drawn(tmp_path):
    pytest.importorskip("matplotlib")
    made = runpy.run_path(str(ROOT / "docs/pictures/softness.py"))["main"](tmp_path)
    names = {"softness.png", "softness-nodule.png", "softness-band.png", "energy.png", "afferents.png"}
    assert {path.name for path in made} == names and min(path.stat().st_size for path in made) > 20_000


@pytest.mark.long
def test_the_benchmark_prints_the_cost_of_each_pitch():
    command = [sys.executable, str(ROOT / "benchmarks/beam_bundle.py"), "--json", "--fast"]
    rows = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert [row["pitch_mm"] for row in rows] == [2.4, 1.2, 0.6]
    assert rows[0]["beams"] < rows[1]["beams"] < rows[2]["beams"]
    assert all(row["residual_max"] < 1e-5 and row["rounds_max"] < 30 for row in rows)
