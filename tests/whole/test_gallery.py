"""docs/gallery.md is the output of its script, with every shipped graph, its command and its picture."""

import re
import runpy
from pathlib import Path

from palpate.launch.load.files import GRAPHS
from palpate.launch.load.launchfile import find

DOCS = Path(__file__).parents[2] / "docs"


def test_the_gallery_is_the_output_of_its_script():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert page == runpy.run_path(str(DOCS / "gallery.py"))["gallery"](), "run `python docs/gallery.py`"


def test_every_shipped_graph_is_listed_with_its_command():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    commands = re.findall(r"^palpate run (\S+)", page, re.MULTILINE)
    assert {find(name).graph.stem for name in commands} == {file.stem for file in GRAPHS.glob("*.yaml")}


def test_every_entry_has_its_picture():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    entries = re.split(r"^## ", page, flags=re.MULTILINE)[1:]
    for entry in entries:
        name = entry.partition("\n")[0]
        (picture,) = re.findall(r"!\[[^]]+\]\(([^)]+)\)", entry)
        assert picture == f"pictures/gallery-{name}.png", "run `python docs/pictures/gallery.py`"
        assert (DOCS / picture).read_bytes()[:4] == b"\x89PNG"
    assert len(entries) == len(list(GRAPHS.glob("*.yaml")))
