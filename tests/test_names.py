"""Names of functions say what they do: few are a bare participle, such as `joined` for a function that joins radii."""

import ast
import re
from pathlib import Path

from sources import nodes

ROOT = Path(__file__).parents[1]
IRREGULAR = re.compile(
    "begun|broken|built|chosen|come|drawn|felt|found|gone|given|grown|heard|held|hidden|kept|known|left|lost|made|meant"
    "|paid|said|seen|sent|shown|sold|spent|struck|sunk|swept|taken|taught|thrown|told|understood|won|worn|written"
)
VERBS = {"bed", "feed", "need", "embed", "seed", "shed", "speed"}
MOST = 0.03  # of all functions
VAGUE = {"draw", "press", "energy", "tell", "heard", "saw", "reel"}  # formerly the names of up to 18 functions each


def functions():
    """Name of each function that is no property."""
    for folder in ("messages", "nodes", "launch", "src/palpate"):
        for file in (ROOT / folder).rglob("*.py"):
            for node in nodes(file):
                if isinstance(node, ast.FunctionDef) and not is_property(node) and not node.name.startswith("__"):
                    yield node.name


def is_property(node: ast.FunctionDef) -> bool:
    return any("property" in ast.unparse(mark) for mark in node.decorator_list)


def is_participle(name: str) -> bool:
    word = name.strip("_")
    regular = re.fullmatch("[a-z]+ed", word) is not None and word not in VERBS
    return regular or IRREGULAR.fullmatch(word) is not None


def test_few_functions_have_a_participle_as_their_name():
    found = list(functions())
    bare = [name for name in found if is_participle(name)]
    assert len(found) > 3000
    share = len(bare) / len(found)
    assert share <= MOST, sorted(set(bare))


def test_no_function_has_a_name_that_meant_several_things():
    assert VAGUE.isdisjoint(name.strip("_") for name in functions())


def test_a_verb_and_two_words_are_no_participle():
    assert is_participle("joined") and is_participle("_kept")
    assert not is_participle("join_radii") and not is_participle("feed") and not is_participle("needed_ticks")
