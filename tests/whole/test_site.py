"""The documentation site: `./check.sh docs`."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.long
def test_the_site_is_built_without_warnings_and_is_searchable(tmp_path):
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "-q", "-b", "html", str(DOCS), str(tmp_path)]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stdout + built.stderr
    index = (tmp_path / "searchindex.js").read_text()
    for page in ("tutorials/first_touch", "first_errors", "reference/nodes", "reference/commands", "equations/contact"):
        assert (tmp_path / f"{page}.html").exists() and f'"{page}"' in index
    for page in tmp_path.rglob("*.html"):  # formulas and scripts without a network
        text = page.read_text()
        assert "mathjax" not in text.lower() and not re.search(r'<(script|link)[^>]*(src|href)="https?:', text), page
    contact = (tmp_path / "equations" / "contact.html").read_text()
    assert contact.count("<math") > 20 and "\\frac" not in contact
    nodes = (tmp_path / "reference" / "nodes.html").read_text()
    assert "friction.LuGre" in nodes and "bristle_stiffness" in nodes


def test_the_gallery_shows_the_touches_that_are_built(tmp_path):
    """By the functions of the site's extension: the page itself is built in the long test."""
    script = (
        "import sys, types, touches; from docutils import nodes; from pathlib import Path\n"
        f"touches.HERE = Path({str(tmp_path / 'touches')!r})\n"
        "page = nodes.Element('', *(nodes.section('', nodes.title('', name)) for name in ('kidney', 'falcon')))\n"
        "app = types.SimpleNamespace(env=types.SimpleNamespace(docname='gallery'), outdir=sys.argv[1],\n"
        "                            builder=types.SimpleNamespace(format='html'))\n"
        "touches.add_touches(app, page); touches.copy_touches(app, None)\n"
        "print([len(section) for section in page], page[0][-1].astext())\n"
    )
    built = tmp_path / "touches" / "kidney" / "index.html"
    built.parent.mkdir(parents=True)
    built.write_text("a page")
    command = [sys.executable, "-c", script, str(tmp_path / "site")]
    told = subprocess.run(command, cwd=DOCS / "site", capture_output=True, text=True, check=True).stdout
    assert told.startswith("[2, 1]") and 'loading="lazy" src="touches/kidney/index.html"' in told
    assert (tmp_path / "site" / "touches" / "kidney" / "index.html").read_text() == "a page"


def test_every_picture_has_an_alternative_text():
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


# A formula in plain text: a Greek letter, an index or exponent of a symbol in Unicode, a sum or root, `x_y`, `x = `.
PLAIN_FORMULA = re.compile(
    r"[Α-Ωα-ω₀-₉ₐ-ₜᵀⁿ∫Σ√∂∇⟨⟩‖]|(?<![\w./])[A-Za-z](?:[²³]|_[A-Za-z0-9]|(?: ?[=<>≤≥≈·]|'? [+−/]) ?[\w(−\\])"
)
CODE_FORMULA = re.compile(r"(?<![\w.])[A-Za-zα-ω]\w{0,2} [-=+−*/·<>≤≥] [\w(]|[₀-₉²³√∫Σ]")


@pytest.mark.parametrize("text", ("K u = f", "x ≥ 0", "τ", "s₂", "c_ij", "R²", "f = 2"))
def test_a_formula_in_plain_text_is_recognized(text):
    assert PLAIN_FORMULA.search(text)


@pytest.mark.parametrize("page", sorted((DOCS / "equations").glob("*.md")), ids=lambda page: page.stem)
def test_inline_formulas_of_the_equations_are_latex(page):
    text = re.sub(r"^```.*?^```|\$\$.*?\$\$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert text.count("$") % 2 == 0
    text = re.sub(r"\$[^$]+\$", " ", text)
    assert not [code for code in re.findall(r"`([^`]+)`", text) if CODE_FORMULA.search(code)]
    assert not [line for line in re.sub(r"`[^`]+`", " ", text).split("\n") if PLAIN_FORMULA.search(line)]
