"""Notes that tests provoke on purpose, as patterns: `@pytest.mark.notes(COARSE, UNTAKEN, body="Rigid")`.

Every note of a test is found by a pattern of its marks, and every pattern finds one. With `name=value` the mark applies
to the cases whose parameter has this value, or one of a tuple. Where the notes are those of random touches, a file has
pytest's mark `filterwarnings("ignore::palpate.PalpateWarning")` instead.
"""

import contextlib
import re
import warnings
from collections.abc import Iterator

import pytest

from palpate.physics.errors import PalpateWarning

COARSE = "the vertices are .* apart, the patch is"
CURVED = "its radius of curvature is"
BEYOND = "the indentation exceeds the range of its law"
ENERGY = "lets the law generate energy"
FAST = "the finger slides faster than"
FLAT = "the fingertip is compressed by"
LEAPT = "the nearest point of the surface leapt ahead of the finger"
MIDDLE = "the finger was deeper than the middle of a thin part"
PLACED = "its top lies at"
REFINED = "triangles coarser than .* are divided"
RIGID = "as a rigid tip does"
STIFF = "the contact is stiffer than .*, the limit of this device"
UNTAKEN = r"does not take from scene\."


@contextlib.contextmanager
def only_expected(item: pytest.Item) -> Iterator[None]:
    """Fail a test with a note that its marks do not expect, or without one that they do."""
    if any("PalpateWarning" in text for mark in item.iter_markers("filterwarnings") for text in mark.args):
        yield
        return
    if item.get_closest_marker("long"):  # the shorter test of the same case expects its notes
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PalpateWarning)
            yield
        return
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always", PalpateWarning)
        yield
    found = [str(each.message) for each in given if issubclass(each.category, PalpateWarning)]
    expected = patterns(item)
    other = [text for text in found if not any(re.search(pattern, text) for pattern in expected)]
    missing = [pattern for pattern in expected if not any(re.search(pattern, text) for text in found)]
    assert not other, f"notes that no mark of the test expects: {other}"
    assert not missing, f"notes that did not come: {missing}; found {found}"
    for each in given:
        if not issubclass(each.category, PalpateWarning):
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)


def patterns(item: pytest.Item) -> list[str]:
    """The patterns of the marks that apply to a case."""
    case = getattr(getattr(item, "callspec", None), "params", {})

    def applies(given: dict) -> bool:
        return all(case[name] in (value if isinstance(value, tuple) else (value,)) for name, value in given.items())

    return [pattern for mark in item.iter_markers("notes") if applies(mark.kwargs) for pattern in mark.args]
