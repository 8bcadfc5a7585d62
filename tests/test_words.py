"""The text of the project is plain English: it contains none of the listed words.

Each entry is a regular expression with its replacement. Code, formulas and links are skipped. Add a legitimate use to
`ALLOWED`.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest
from sources import tree_of

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md", "docs")
"""Files and folders whose Markdown is checked."""
SETTINGS = ("graphs", "docs", "tests/golden")
"""Folders whose YAML is checked: comments, questions and labels."""
PYTHON = ("benchmarks", "docs", "launch", "messages", "nodes", "src", "tests")
"""Rooms whose Python is checked: docstrings, comments, messages and the names of tests."""

DIALECT = {
    # verbs
    r"told|tells?|telling": "report, print, log, warn",
    r"mend(s|ed|ing)?": "fix, correct",
    r"goes on|go on|going on|went on": "continue",
    r"com(e|es|ing) in|came in": "ramp up, arrive",
    r"com(e|es|ing) back|came back": "recover, return",
    r"gives? way|gave way": "yield",
    r"dies? down": "decay",
    r"swings?|swinging": "oscillate",
    r"hears?|heard": "receive",
    r"heeds?|heeded": "read, obey",
    r"look(s|ed)? (at|after|on)|looking (at|after|on)": "inspect, check, handle",
    r"glances?|glanced": "poll",
    r"bur(y|ies|ied)": "handle the death of",
    r"sp(eak|eaks|oken|oke) of": "describe, name",
    r"stands?|stood": "is, contains, is listed",
    r"(is|are|was|were) meant": "drop, or say who does what",
    r"makes? (out )?of (it|them)": "say what it computes",
    r"keeps? (its|their) word": "conservative, valid",
    r"kept from": "prevented from",
    r"knows? of": "know, account for",
    r"feeds? the hand": "injects energy",
    r"pays? (it )?back": "dissipate, return",
    r"is held against|are held against": "is compared with",
    r"was once|once was": "former",
    # subjects and connectives
    r"whoever|whomever|whosoever": "name the subject",
    r"whatever (it|they|the|its|their)": "for any, independent of",
    r"thus|hence|whence|thence": "so, therefore",
    r"whereby|whereof|wherein|whereupon|thereof|therein|thereby|thereupon": "split the sentence",
    r"for ever": "forever, for the whole run",
    r"alike": "both, equally",
    r"at present": "now, current",
    r"it is so that|be it that": "drop",
    r"such(?! as\b)": "drop, or name the thing",
    r"the (more|less|longer|larger|deeper|faster|slower) (\w+ ){1,9}the (more|less|longer|larger|deeper|faster|slower)":
        "grows with, is O(n)",
    r"so many|so much": "a number",
    r"is(n't| not)? there|are(n't| not)? there": "exists, is available, is missing",
    r"there (is|was|are|were) none|there is no such": "missing, does not exist",
    r"a place that|of one's own|one's": "name it",
    r"own": "drop, or custom, separate, its",
    r"besides?": "next to, in parallel with, in addition to",
    r"but for": "except",
    r"nothing of": "say what is left out",
    r"as ever|as it were": "drop",
    r"anew": "again",
    r"for good": "permanently",
    r"seldom": "lowest rate, rarely",
    # nouns
    r"bills?": "cost",
    r"books": "energy balance",
    r"findings?": "diagnostics, results",
    r"laborator(y|ies)": "reference solvers",
    r"rungs?|ladders?": "levels",
    r"bad days?|busy days?": "a loaded machine",
    r"doors?": "entry, API",
    r"reels?": "film",
    r"blows?": "spike",
    r"dents?": "indentation",
    r"beds?": "elastic foundation",
    r"truths?": "true value, reference solution",
    r"outside solvers?": "reference solvers",
    r"house": "code base",
    r"errand|chores?|toils?": "task",
    # numbers
    r"thrice|some \d": "a number",
    r"a (tenth|hundredth|thousandth|fifth|sixth|eighth)": "10 %, 0.2 ...",
    r"(half|twice) as (much|many|long|far|fast|large|soft|stiff) again": "a number",
    r"off by": "error",
    r"promised": "predicted",
    # what things do
    r"(rule|law|claim|statement|condition)s? holds?": "is true, is valid",
    r"(file|folder|record|module|class|message|table|array)s? holds?": "contains",
    r"(file|message|line|command|run|table|field|flag|header|record)s? says?": "print, report, contain",
    r"nobody|somebody": "no node, another user",
    r"in the mean(?! (of|square|tangent))": "on average",
    r"(is|are) gone": "was removed",
}  # fmt: skip
ALLOWED = {
    # texts of the system, and names
    r"no[ -]such\b": (),
    r"\bnobody\b": ("tests/support/strangers.py",),
    r"house\.py": (),
    r"its own material": ("studies/accuracy/reference_solvers.py", "studies/accuracy/sites.py"),  # a name in results
    r"palpate\.reels": ("tests/views/test_view_browser.py",),
    r"fills such an index": ("records/format/mcap_file.py",),
    r"stop tell": ("tests/launch/run/test_bad_runs.py",),
    r"\bbed\b": ("cli/commands/fitting/build/basis.py", "models/build/basis.py", "nodes/deformation/reduced_fe.py",
                  "tests/nodes/bodies/test_basis_store.py"),
    # the record of a node in its kernel
    r"\bown[.,]": ("nodes/base/compiled.py", "launch/template.py", "tests/launch/test_ensemble.py",
                  "tests/nodes/test_compiled.py"),
    # messages to users
    r"a level stands twice": ("tests/cli/test_experiment.py", "studies/psychophysics/stimuli.py"),
    r"stands twice": ("studies/sweeps/axes.py", "studies/sweeps/checks.py", "tests/studies/test_sweep_axes.py"),
    r"checked but for a gap": ("cli/terminal/replayed.py", "tests/records/test_replay.py"),
    r"look at (a recording|any instant|its recording)": (),
    r"a list of such texts": ("launch/load/values/overrides.py", "views/run.py"),
    r"forwards only its own messages": ("launch/load/graph.py", "tests/nodes/test_delay.py"),
    r"at tick 0 there is none": ("launch/load/wiring.py",),
    r"nobody( else can)?": ("launch/run/wire/addresses.py", "tests/launch/run/test_strangers.py"),
    r"nothing was heard of it": ("launch/run/work/worker.py",),
    r"clock: (found ')?reel": ("tests/launch/load/test_plan.py",),
    r"shows what is there": ("drivers/transport/ftdi.py",),
    r"\bis gone": ("drivers/emulate/faults.py", "drivers/transport/ftdi.py", "drivers/transport/hid.py",
                   "drivers/transport/udp.py", "drivers/transport/websocket.py", "tests/drivers/test_exchange.py",
                   "tests/drivers/test_haply.py", "tests/drivers/test_in_the_loop.py", "tests/drivers/test_usb.py",
                   "tests/views/test_experiment_page.py"),
    r"tissue\.friction holds": ("docs/effects.md",),
}  # fmt: skip
"""Phrases that contain a listed word and are right, with the files that may use them; no file: all of them."""
WORD = re.compile(rf"\b(?:{'|'.join(DIALECT)})\b")
"""All entries; the text is lower case."""


def files(places: tuple[str, ...], ending: str) -> list[Path]:
    """The files with this ending at and below the places; generated ones are left out."""
    found = [path for place in places for path in (ROOT / place, *(ROOT / place).rglob(f"*{ending}"))]
    return sorted(path for path in found if path.suffix == ending and not {"_build", "reference"} & set(path.parts))


def markdown(text: str) -> Iterator[tuple[int, str]]:
    """Line and text of each line, without code, formulas and addresses."""
    for pattern in (r"^```.*?^```", r"\$\$.*?\$\$", r"`[^`]*`", r"\]\([^)]*\)", r"https?://\S+"):
        text = re.sub(pattern, lambda found: "\n" * found[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL)
    return enumerate(text.splitlines(), 1)


def python(path: Path) -> Iterator[tuple[int, str]]:
    """Line and text of each comment, of each string with a space (docstrings, messages), and of each test name. Reading
    the tokens takes long: none of a file without a listed word, and comments only where one follows a `#`."""
    text = path.read_text(encoding="utf-8")
    if not WORD.search(text.lower().replace("_", " ")):
        return
    lines = text.splitlines()
    if any(WORD.search(line.partition("#")[2].lower()) for line in lines if "#" in line):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string
    plain = (line.lower().replace("_", " ").replace("\\n", " ") for line in lines)
    listed = {number for number, line in enumerate(plain, 1) if WORD.search(line)}
    for node in with_listed(tree_of(path), listed):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            for number, line in enumerate(re.sub(r"`[^`\n]*`", " ", node.value).splitlines()):
                yield node.lineno + number, line
        elif isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield node.lineno, node.name.replace("_", " ")


def with_listed(node: ast.AST, listed: set[int]) -> Iterator[ast.AST]:
    """A node and those in it, without nodes on one line that contains no listed word. A string on several lines may be
    one line of text."""
    begin = getattr(node, "lineno", 0)
    if begin and begin == node.end_lineno and begin not in listed:
        return
    yield node
    for each in ast.iter_child_nodes(node):
        yield from with_listed(each, listed)


def faults(path: Path, lines: Iterator[tuple[int, str]]) -> list[str]:
    """Each listed word in the lines, with its place and what to write instead."""
    wrong, here = [], str(path.relative_to(ROOT))
    for number, line in lines:
        if not WORD.search(line.lower()):
            continue
        for found in WORD.finditer(_without_allowed(line.lower(), here)):
            instead = next(text for pattern, text in DIALECT.items() if re.match(rf"(?:{pattern})\b", found[0]))
            wrong.append(f"{here}:{number}: {found[0]!r}: {instead}")
    return wrong


def _without_allowed(line: str, here: str) -> str:
    """The line without the phrases that this file may use."""
    for phrase, where in ALLOWED.items():
        if not where or here.removeprefix("src/palpate/") in where:
            line = re.sub(phrase, "", line)
    return line


def test_listed_words_are_found_outside_code_only():
    text = "Whoever looks after `own.fault` was told so many times: $$own$$ a node of one's own.\n"
    text += "```\nbeside\n```\nit goes on\n"
    found = [fault.split(": ")[0:2] for fault in faults(ROOT / "README.md", markdown(text))]
    words = ("whoever", "looks after", "told", "so many", "of one's own")
    assert found == [*(["README.md:1", repr(word)] for word in words), ["README.md:5", "'goes on'"]]


@pytest.mark.parametrize("path", files(PAGES, ".md"), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_page_is_plain_english(path):
    assert not faults(path, markdown(path.read_text(encoding="utf-8")))


def test_yaml_is_plain_english():
    wrong = [fault for path in files(SETTINGS, ".yaml")
             for fault in faults(path, enumerate(path.read_text(encoding="utf-8").splitlines(), 1))]  # fmt: skip
    assert not wrong, "\n".join(wrong)


def test_docstrings_comments_messages_and_test_names_are_plain_english():
    wrong = [fault for path in files(PYTHON, ".py") if path != Path(__file__)
             for fault in faults(path, python(path))]  # fmt: skip
    assert not wrong, "\n".join(wrong)
