"""The documentation site: `./check.sh docs`."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.long
def test_it_is_built_without_a_warning_and_every_page_can_be_searched(tmp_path):
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "-q", "-b", "html", str(DOCS), str(tmp_path)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    index = (tmp_path / "searchindex.js").read_text()
    for page in ("tutorials/first_touch", "first_errors", "reference/nodes", "reference/commands", "equations/contact"):
        assert (tmp_path / f"{page}.html").exists() and f'"{page}"' in index
    nodes = (tmp_path / "reference" / "nodes.html").read_text()
    assert "friction.LuGre" in nodes and "bristle_stiffness" in nodes


def test_every_picture_has_a_text_in_its_place():
    pages = [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
    bare = [str(page) for page in pages for text in re.findall(r"!\[([^\]]*)\]\(", page.read_text()) if len(text) < 10]
    assert not bare
