"""What the labels of a segmentation are made of: the table `graphs/tissues/labels.yaml`."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, NamedTuple

from palpate.launch.load.tissues import GRADES, TISSUES
from palpate.launch.load.values.source import read

TABLE = "labels.yaml"


class Ratio(NamedTuple):
    """The modulus of a label inside of an organ over that of the organ, and where it is from."""

    value: float
    source: str


@lru_cache
def _table() -> dict[str, Any]:
    found = read(TISSUES / TABLE).data
    return {"labels": dict(found["labels"]), "inside": list(found["inside"])}


def _words(name: str) -> list[str]:
    """The words of a label's name: `kidney_left`, `Kidney (left)` and `2 (kidney)` have the word kidney."""
    return re.findall(r"[^\W\d_]+", name.casefold())


def tissue_of(name: str) -> str | None:
    """The published tissue of an organ with this label; None: it is not in the table, or it is a part of an organ."""
    words = _words(name)
    if any(set(words) & set(line["words"]) for line in _table()["inside"]):
        return None
    return next((str(tissue) for word, tissue in _table()["labels"].items() if word in words), None)


def is_bone(name: str) -> bool:
    """Whether a label is one of bone."""
    return any(line.get("bone", False) and set(_words(name)) & set(line["words"]) for line in _table()["inside"])


def ratio_of(name: str, organ: str) -> Ratio | None:
    """The ratio of a label inside of an organ; None: it is not in the table."""
    for line in _table()["inside"]:
        if set(_words(name)) & set(line["words"]) and ("of" not in line or line["of"] in _words(organ)):
            return Ratio(float(line["ratio"]), f"{GRADES[line['grade']]}: {line['source']}")
    return None
