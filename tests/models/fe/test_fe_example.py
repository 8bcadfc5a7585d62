"""The example of docs/finite_elements.md, and the code on that page."""

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import Material, neo_hooke
from palpate.physics.materials.hyperelastic import moduli

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("press", DOCS / "examples" / "press.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["press"] = module  # numba looks for the law's module when it reads its cache
    spec.loader.exec_module(module)
    return module


def test_the_stiffening_skin_is_neo_hookean_at_small_strain_and_stiffer_at_large(example):
    own = Material(example.stiffening, (*moduli(30e3, 0.48), 10.0), mixed=True)
    depths = np.array([0.1e-3, 1.5e-3])
    _, plain, _ = example.press(neo_hooke(30e3, 0.48), depths, 4)
    _, stiff, _ = example.press(own, depths, 4)
    assert stiff[0] == approx(plain[0], rel=0.02)
    assert stiff[1] > 1.03 * plain[1]


def test_the_code_of_the_page_runs_unchanged(capsys):
    code = re.search(r"```python\n(.*?)```", (DOCS / "finite_elements.md").read_text(), re.DOTALL).group(1)
    exec(compile(code, "finite_elements.md", "exec"), {})
    assert "nan" not in capsys.readouterr().out
