"""YAML as data with places: accepted and rejected files."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.engine.faults import GraphError, nearest
from palpate.launch.load.graph import load
from palpate.launch.load.values.source import merge, parse, scalar


@pytest.mark.parametrize("text", ["", "3", "[1, 2]", "nodes: {}", "nodes:", "a: &a [*a]", "- - - x", "\x00", "%YAML 9"])
def test_a_file_that_is_not_a_graph_is_an_error(write, text):
    with pytest.raises(GraphError):
        load(write("g.yaml", text))


def test_a_deeply_nested_or_missing_file_is_an_error(write, tmp_path):
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
def test_any_text_is_a_graph_or_an_error(text):
    try:
        parse(text, "x.yaml")
    except GraphError as error:
        assert "x.yaml" in str(error)


@pytest.mark.parametrize(
    ("text", "value"),
    [("2e3", 2000.0), ("3e-3", 0.003), ("010", 10), (".5", 0.5), ("-1", -1), ("on", True), ("No", False), ("~", None),
     ("6 mm", "6 mm"), ("1.2.3", "1.2.3"), ("2001-01-01", "2001-01-01"), ("1:30", "1:30")],
)  # fmt: skip
def test_scalars_are_read_as_expected(text, value):
    assert scalar(text) == value and type(scalar(text)) is type(value)


def test_merging_keeps_order_and_places():
    base = parse("a: {x: 1, y: 2}\nb: 3\n", "base")
    top = parse("\n\na: {y: null, z: 4}\n", "top")
    merged = merge(base, top)
    assert merged.data == {"a": {"x": 1, "z": 4}, "b": 3}
    assert str(merged.place("a", "x")) == "base:1" and str(merged.place("a", "z")) == "top:3"
    assert base.data == {"a": {"x": 1, "y": 2}, "b": 3}


def test_the_nearest_names_are_suggested():
    assert nearest("Stifness", ["stiffness", "damping"]) == ["stiffness"]
    assert nearest("zzz", ["stiffness"]) == []
