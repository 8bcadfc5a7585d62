"""docs/gallery.md is what its script writes, and its commands name graphs that load."""

import runpy
from pathlib import Path

from palpate.launch.loading.launchfile import LAUNCHES

DOCS = Path(__file__).parents[2] / "docs"


def test_the_gallery_is_as_its_script_writes_it():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert page == runpy.run_path(str(DOCS / "gallery.py"))["gallery"](), "run `python docs/gallery.py`"


def test_every_shipped_run_has_its_command():
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for file in LAUNCHES.glob("*.yaml"):
        assert f"\npalpate run {file.stem}" in page
