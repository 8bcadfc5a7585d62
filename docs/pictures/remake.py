"""Remake pictures of the documentation: python docs/pictures/remake.py [PICTURE...]

Without a picture it lists all pictures with the commands that make them, from made.yaml. Otherwise it runs the commands
of these pictures, each once. After pictures of the browser's pages, it stores the words of the pages in made.yaml.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import yaml

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
TABLE = FOLDER / "made.yaml"
STATIC = ROOT / "src" / "palpate" / "views" / "page" / "static"
WRITTEN = {"label", "button", "b", "small", "option", "span", "i"}


class Words(HTMLParser):
    """The visible words of a page, in order; numbers are left out, since they are those of a run."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.found: list[str] = []
        self.feed((STATIC / page).read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        text = " ".join(data.split())
        if text and self.open and self.open[-1] in WRITTEN and re.search(r"[A-Za-z]", text):
            self.found.append(text)


def table() -> dict[str, dict[str, object]]:
    """Pictures by command, and words by page."""
    return yaml.safe_load(TABLE.read_text(encoding="utf-8"))


def commands() -> dict[str, str]:
    """The command of each picture."""
    return {picture: command for command, pictures in table()["made"].items() for picture in pictures}


def store_words(pictures: set[str]) -> None:
    """Replace the words of the pages of these pictures."""
    head, _, _ = TABLE.read_text(encoding="utf-8").partition("\npages:\n")
    lines = []
    for picture, about in table()["pages"].items():
        words = Words(about["page"]).found if picture in pictures else about["words"]
        line = yaml.safe_dump(words, default_flow_style=True, allow_unicode=True, width=10_000).strip()
        lines.append(f"  {picture}: {{page: {about['page']}, words: {line}}}")
    TABLE.write_text(f"{head}\npages:\n" + "\n".join(lines) + "\n", encoding="utf-8")


def main(pictures: list[str]) -> None:
    made = commands()
    if unknown := [name for name in pictures if name not in made]:
        raise SystemExit(f"found {', '.join(unknown)}, expected some of {', '.join(sorted(made))}")
    if not pictures:
        for name in sorted(made):
            print(f"{name:36} {made[name]}")
        return
    for command in dict.fromkeys(made[name] for name in pictures):
        words = shlex.split(command)
        start = [sys.executable] if words[0] == "python" else [sys.executable, "-m", "palpate.cli"]
        subprocess.run([*start, *words[1:]], check=True, cwd=ROOT)
    store_words({name for name in pictures if name in table()["pages"]})


if __name__ == "__main__":
    from target import parser

    given = parser(__doc__)
    given.add_argument("pictures", nargs="*", help="names of pictures, such as touch.png")
    main(given.parse_args().pictures)
