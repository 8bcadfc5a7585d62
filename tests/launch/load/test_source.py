"""YAML as data with places: what is read, what is refused."""

import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.engine.faults import GraphError, nearest
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.launch.load.values import source
from palpate.launch.load.values.source import merge, parse, scalar


@pytest.mark.parametrize("text", ["", "3", "[1, 2]", "nodes: {}", "nodes:", "a: &a [*a]", "- - - x", "\x00", "%YAML 9"])
def test_what_is_no_graph_is_refused(write, text):
    with pytest.raises(GraphError):
        load(write("g.yaml", text))


@pytest.mark.parametrize("text", [
    "\n".join(f"k{i}: 1" for i in range(100_000)), "a:\n" + "- 1\n" * 100_000, "[" + "1," * 100_000 + "]",
    "\n".join(f"k{i}: {{a: 1, b: [2]}}" for i in range(30_000)),
])  # fmt: skip
def test_a_file_of_very_many_entries_is_refused_while_it_is_read(monkeypatch, text):
    """After as many nodes of it as are permitted, and not after all."""
    composed = []
    compose = source._Loader.compose_node
    monkeypatch.setattr(source._Loader, "compose_node", lambda *given: (composed.append(1), compose(*given))[1])
    with pytest.raises(GraphError, match=r"more than 20000 entries"):
        parse(text, "many.yaml")
    assert len(composed) <= 20_001


def test_a_deep_or_missing_file_is_refused(write, tmp_path):
    with pytest.raises(GraphError, match="nested too deeply"):
        load(write("g.yaml", "[" * 5000))
    with pytest.raises(GraphError, match="not found"):
        load(tmp_path / "none.yaml")
    laughs = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
        f"{c}: &{c} [{','.join(['*' + p] * 10)}]\n" for p, c in zip("abcdefgh", "bcdefghi", strict=True)
    )
    with pytest.raises(GraphError, match="more than"):
        load(write("g.yaml", laughs))


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet="nodes:use in{}[]&*!|>-#'\"\n \t$.0123", max_size=60))
def test_any_text_is_a_graph_or_refused(text):
    try:
        parse(text, "x.yaml")
    except GraphError as error:
        assert "x.yaml" in str(error)


def outcome(text):
    try:
        return parse(text, "x.yaml")
    except GraphError as error:
        return str(error)


@settings(max_examples=400, deadline=None)
@given(st.text(alphabet="nodes:use in{}[]&*!|>-#'\"\n \t$.0123", max_size=60))
def test_libyaml_reads_what_the_scanner_in_python_reads(text):
    """And a little more: a tab after a word, a comment close to the sign of a block."""
    quick = outcome(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(source, "_SHORT", 0)
        slow = outcome(text)
    assert quick == slow or isinstance(slow, str)


def test_all_that_ships_is_read_the_same_by_both(monkeypatch):
    texts = {file: file.read_text(encoding="utf-8") for file in GRAPHS.rglob("*.yaml")}
    quick = {file: parse(text, "x") for file, text in texts.items()}
    monkeypatch.setattr(source, "_SHORT", 0)
    assert len(texts) > 20 and {file: parse(text, "x") for file, text in texts.items()} == quick


def test_brackets_that_libyaml_could_not_bear_are_refused(write):
    """Its scanner calls itself for each level: in a thread of 256 kB some thousands end the process."""
    with pytest.raises(GraphError, match="nested too deeply"):
        load(write("g.yaml", "[" * 200_000))
    with pytest.raises(GraphError, match="nested too deeply: more than 100 levels"):
        load(write("g.yaml", "[" * 120 + "]" * 120))
    deep = "\n".join(" " * i + "a:" for i in range(180)) + " " + "[" * 390
    before = threading.stack_size(256 * 1024)
    try:
        for text in (deep, "[" * 9999, "- " * 5000 + "1", "? " * 5000):
            told = []
            thread = threading.Thread(target=lambda text=text, told=told: told.append(outcome(text)))
            thread.start()
            thread.join()
            assert len(told) == 1 and isinstance(told[0], str)
    finally:
        threading.stack_size(before)


@pytest.mark.parametrize(
    ("text", "value"),
    [("2e3", 2000.0), ("3e-3", 0.003), ("010", 10), (".5", 0.5), ("-1", -1), ("on", True), ("No", False), ("~", None),
     ("6 mm", "6 mm"), ("1.2.3", "1.2.3"), ("2001-01-01", "2001-01-01"), ("1:30", "1:30")],
)  # fmt: skip
def test_scalars_are_read_as_people_mean_them(text, value):
    assert scalar(text) == value and type(scalar(text)) is type(value)


def test_merging_keeps_order_and_places():
    base = parse("a: {x: 1, y: 2}\nb: 3\n", "base")
    top = parse("\n\na: {y: null, z: 4}\n", "top")
    merged = merge(base, top)
    assert merged.data == {"a": {"x": 1, "z": 4}, "b": 3}
    assert str(merged.place("a", "x")) == "base:1" and str(merged.place("a", "z")) == "top:3"
    assert base.data == {"a": {"x": 1, "y": 2}, "b": 3}


def test_nearest_names():
    assert nearest("Stifness", ["stiffness", "damping"]) == ["stiffness"]
    assert nearest("zzz", ["stiffness"]) == []
