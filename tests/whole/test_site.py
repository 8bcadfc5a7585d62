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


def test_the_python_reference_has_inherited_methods():
    command = [sys.executable, "-c", "from python import public; print(public())"]
    text = subprocess.run(command, cwd=DOCS / "site", capture_output=True, text=True, check=True).stdout
    for name in ("Study.table", "Study.indices", "Run.frame"):
        assert f"### {name}\n" in text
    assert text.count("### Study.table\n") == 1


def test_formulas_are_latex_and_every_block_ends():
    for page in [DOCS.parent / "README.md", *DOCS.rglob("*.md")]:
        if "reference" in page.parts or "_build" in page.parts:
            continue
        text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
        assert page.parent.name != "equations" or not re.search(r"\n\n {4,}\S", text), page
        assert text.count("$$") % 2 == 0, page
        for block in re.findall(r"\$\$(.*?)\$\$", text, re.DOTALL):
            assert block.count("{") == block.count("}") and block.isascii(), (page, block)
