"""Each picture of the docs has one command that makes it, is shown by a page, and shows the browser's page of today."""

import re
import runpy
import shlex
import sys
from collections import Counter
from pathlib import Path

import pytest
from test_docs import PAGES, parsed

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "pictures"
PICTURES = sorted(path.name for path in FOLDER.glob("*.png"))
REMAKE = FOLDER / "remake.py"


@pytest.fixture(scope="module")
def remake():
    return runpy.run_path(str(REMAKE))


def test_each_picture_has_one_command(remake):
    listed = [name for pictures in remake["table"]()["made"].values() for name in pictures]
    assert sorted(listed) == PICTURES
    assert max(Counter(listed).values()) == 1


def test_each_command_exists(remake):
    for command in remake["table"]()["made"]:
        words = shlex.split(command)
        if words[0] == "palpate":
            assert parsed(words) is not None
        else:
            assert words[0] == "python" and (ROOT / words[1]).is_file(), command


def test_each_picture_is_shown_by_a_page():
    shown = {Path(found).name for page in PAGES
             for found in re.findall(r"!\[[^]]*\]\(([^)]+\.png)\)", page.read_text(encoding="utf-8"))}  # fmt: skip
    assert shown == set(PICTURES)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_each_picture_of_a_page_exists(page):
    for found in re.findall(r"!\[[^]]*\]\(([^)]+\.(?:png|svg|gif))\)", page.read_text(encoding="utf-8")):
        assert "://" in found or (page.parent / found).is_file(), found


def test_pictures_of_the_browser_show_the_words_of_the_pages_of_today(remake):
    """A new control, label or hint of a page needs a new picture of it."""
    for picture, about in remake["table"]()["pages"].items():
        today = remake["Words"](about["page"]).found
        assert about["words"] == today, f"python docs/pictures/remake.py {picture}  # needs Chromium"


def test_the_words_of_a_page_are_its_visible_texts_without_numbers(remake, monkeypatch, tmp_path):
    (tmp_path / "x.html").write_text("<title>no</title><label>press <b>8</b><button>pause</button><!-- no --></label>")
    monkeypatch.setitem(remake["Words"].__init__.__globals__, "STATIC", tmp_path)
    assert remake["Words"]("x.html").found == ["press", "pause"]


def test_the_list_names_each_picture_and_another_name_is_refused(remake, capsys):
    remake["main"]([])
    printed = capsys.readouterr().out
    assert all(name in printed for name in PICTURES)
    with pytest.raises(SystemExit, match=r"found nothing\.png, expected some of"):
        remake["main"](["nothing.png"])


def test_a_picture_is_remade_by_its_command(remake, monkeypatch):
    called = []
    monkeypatch.setattr(remake["subprocess"], "run", lambda words, **how: called.append(words))
    monkeypatch.setitem(remake["main"].__globals__, "store_words", lambda pictures: called.append(pictures))
    remake["main"](["fit-models.png", "fit-subject.png", "stability.png"])
    assert called == [
        [sys.executable, "docs/pictures/fit.py"],
        [sys.executable, "-m", "palpate.cli", "bench", "stability"],
        set(),
    ]
