"""One fault at a time in a valid graph: the error names the cause and a remedy."""

import copy

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from whole_touch import WHOLE

from palpate.engine.faults import GraphError
from palpate.engine.plan import Plan
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.load.placement import load_place
from palpate.launch.load.plan import plan

SPRING = "{use: graph_nodes.Spring, in: {load: spread}, with: $tissue}"
BAD = {
    "unknown key": ("nodes:", "nods: 1\nnodes:", ["whole.yaml:5", "'nods'", "Did you mean 'nodes'"]),
    "unknown key of a node": (
        "when: tissue.friction",
        "wehn: tissue.friction",
        ["node 'friction'", "'wehn'", "'when'"],
    ),
    "unknown setting": (
        "with: $finger",
        "raduis: 1",
        ["whole.yaml:7", "'finger'", "'raduis'", "Did you mean 'radius'"],
    ),
    "unknown setting of a scene": ("h0: 3e-3", "raduis: 3", ["whole.yaml:4", "finger.raduis", "Did you mean 'radius'"]),
    "wrong type of a setting": ("radius: 6 mm", "radius: [1]", ["'radius'", "[m]", "found [1]", "expected a number"]),
    "limit of a setting": ("radius: 6 mm", "radius: -6 mm", ["'radius'", "[m]", "> 0"]),
    "unit of a setting": (
        "radius: 6 mm",
        "radius: 6 s",
        ["setting 'radius' [m]: found '6 s' [s], a time; expected a length"],
    ),
    "not a number": ("radius: 6 mm", "radius: .nan", ["'radius'", "found nan; expected a finite number"]),
    "infinite": ("radius: 6 mm", "radius: -.inf", ["'radius' [m]", "found -inf; expected a finite number"]),
    "larger than a number can be": ("radius: 6 mm", "radius: 1.0e+999", ["'radius'", "found inf"]),
    "infinite with a unit": ("radius: 6 mm", "radius: inf mm", ["'radius'", "found 'inf mm'"]),
    "missing setting": (SPRING, "{use: graph_nodes.Needy, in: {pose: finger}}", ["setting 'mass' [kg]: missing"]),
    "settings that do not go together": (
        "motor:    {use",
        "moody: {use: graph_nodes.Moody, in: {pose: finger}, low: 2}\n  motor:    {use",
        ["node 'moody': low 2.0 m lies above high 1.0 m"],
    ),
    "a constructor that fails": (
        "motor:    {use",
        "moody: {use: graph_nodes.Moody, in: {pose: finger}, low: 1}\n  motor:    {use",
        ["node 'moody': Moody cannot be made: ZeroDivisionError"],
    ),
    "with is no mapping": ("with: $finger", "with: $finger.h0", ["with: found '$finger.h0'", "expected a mapping"]),
    "with is unknown": ("with: $finger", "with: $fingr", ["'$fingr'", "Did you mean 'finger'"]),
    "dollar is unknown": (
        "with: $finger",
        "h0: $finger.h1",
        ["setting 'h0'", "'finger.h1'", "Did you mean 'finger.h0'"],
    ),
    "dollar refers to itself": ("h0: 3e-3", "h0: $finger.h0", ["'$finger.h0'", "back to itself"]),
    "no use": ("use: graph_nodes.Rub, ", "", ["node 'friction'", "use: missing", "module.Class"]),
    "use without module": ("graph_nodes.Rub", "Rub", ["use: found 'Rub'", "module.Class"]),
    "unknown module": ("graph_nodes.Rub", "graph_noodles.Rub", ["module 'graph_noodles' not found", "Looked in"]),
    "unknown class": ("graph_nodes.Rub", "graph_nodes.Rob", ["no class 'Rob'", "Did you mean 'Rub'", "send Friction"]),
    "not a node": ("graph_nodes.Rub", "graph_nodes.Stray", ["'graph_nodes.Stray' is the class Stray", "subclass of"]),
    "no step": ("graph_nodes.Rub", "graph_nodes.NoStep", ["not well formed", "NoStep has no step"]),
    "setting without unit": ("graph_nodes.Rub", "graph_nodes.NoUnit", ["not well formed", "NoUnit.mass", "unit"]),
    "wanted field unknown": ("graph_nodes.Rub", "graph_nodes.BadWants", ["'stifness'", "Did you mean 'stiffness'"]),
    "wrong type of an input": (
        "body: tissue",
        "body: finger",
        [
            "whole.yaml:9",
            "node 'contact', input 'body'",
            "expects Surface, but 'finger' sends Pose",
            "Nodes that send Surface: tissue",
        ],
    ),
    "no sender of the type": (
        "tissue:   " + SPRING,
        "",
        ["input 'body'", "there is no node 'tissue'", "No node sends Surface"],
    ),
    "unknown sender": (
        "contact: contact, friction: friction}}\n  tis",
        "contact: contakt, friction: friction}}\n  tis",
        ["node 'spread', input 'contact'", "no node 'contakt'", "Did you mean 'contact'"],
    ),
    "sender sends nothing": ("body: tissue", "body: log", ["'log' sends nothing", "Nodes that send Surface: tissue"]),
    "unknown output": ("body: tissue", "body: tissue.Pose", ["'tissue' sends no 'Pose'", "Surface"]),
    "unknown input": ("body: tissue", "bodi: tissue", ["input 'bodi'", "unknown", "Did you mean 'body'"]),
    "missing input": (
        "in: {force: control}",
        "every: 1",
        [
            "node 'motor', input 'force'",
            "which drives the node",
            "no sender",
            "expects Force",
            "Nodes that send Force: control",
        ],
    ),
    "input is no name": ("body: tissue", "body: 3", ["input 'body'", "found 3", "name of a node"]),
    "inputs are no mapping": ("in: {pose: finger}", "in: all", ["in: found 'all'", "{pose: ...}", "observers"]),
    "unknown key of an input": ("body: tissue", "body: {from: tissue, lop: true}", ["'lop'", "Did you mean 'loop'"]),
    "an input without a sender": (
        "body: tissue",
        "body: {loop: true}",
        ["input 'body'", "from: missing", "the name of a node"],
    ),
    "an input from a name of no letters": (
        "body: tissue",
        "body: {from: ''}",
        ["no node ''", "Nodes that send Surface"],
    ),
    "a rate of null": ("nodes:", "rate: null\nnodes:", ["rate [Hz]: missing", "above 0"]),
    "loop is not a boolean": ("body: tissue", "body: {from: tissue, loop: 3}", ["loop: found 3", "true or false"]),
    "driving input named as loop": (
        "force: control",
        "force: {from: control, loop: true}",
        ["'motor', input 'force'", "drives the node"],
    ),
    "loop forbidden": (
        "body: tissue",
        "body: {from: tissue, loop: false}",
        ["loop without a held edge", "tissue -> contact -> spread -> tissue", "loop: false"],
    ),
    "loop edge not optional": (
        "graph_nodes.Press",
        "graph_nodes.StrictPress",
        ["loop without a held edge: tissue -> contact -> spread -> tissue", "contact.body (Surface | None)"],
    ),
    "driving loop": (
        "graph_nodes.Finger, in: {state: device}, with: $finger",
        "graph_nodes.Ring, in: {pose: finger}",
        ["loop without a held edge: finger -> finger", "drives its node"],
    ),
    "source with a required input": (
        "graph_nodes.Hand",
        "graph_nodes.RequiredHand",
        ["node 'device', input 'torque'", "not optional", "`torque: Torque | None`"],
    ),
    "no input and no source": (
        "graph_nodes.Near, in: {pose: finger}",
        "graph_nodes.Idle",
        ["'near'", "nothing runs it", "paced = True"],
    ),
    "every": ("when: tissue.friction", "every: 0", ["node 'friction'", "every: found 0", "from 1"]),
    "every is no number": ("when: tissue.friction", "every: 1.5", ["every: found 1.5", "whole number"]),
    "every is a boolean": ("when: tissue.friction", "every: true", ["every: found true"]),
    "restart": ("when: tissue.friction", "restart: often", ["restart: found 'often'", "true or false"]),
    "when is unknown": (
        "when: tissue.friction",
        "when: tissue.frictn",
        ["node 'friction'", "when: the scene has no 'tissue.frictn'", "Did you mean 'tissue.friction'"],
    ),
    "when is not read": ("when: tissue.friction", "when: a > > 3", ["when:"]),
    "when compares dimensions": ("when: tissue.friction", "when: tissue.stiffness > 3 mm", ["cannot be compared"]),
    "when is a number": (
        "when: tissue.friction",
        "when: tissue.stiffness",
        ["tissue.stiffness: found '0.4 kN/m', expected true or false", "when: tissue.stiffness > 0"],
    ),
    "when compares kinds": ("when: tissue.friction", "when: tissue.cells == many", ["cannot be compared"]),
    "when compares words": ("when: tissue.friction", "when: finger > 3", ["cannot be compared"]),
    "a second contact on one body": (
        "  motor:",
        "  second: {use: graph_nodes.Press, in: {proximity: near, body: tissue}}\n  motor:",
        [
            "whole.yaml:14: node 'second', input 'body'",
            "reads the body 'tissue', on which only 'contact' presses",
            "`tissue: {in: {load: [spread, spread-2]}}` with `spread-2: {in: {contact: second}}`, a contact.Joint",
        ],
    ),
    "a contact that reads a body which its load does not reach": (
        "body: tissue}}",
        "body: other}}\n  second: {use: graph_nodes.Press, in: {proximity: near}}\n"
        "  load:  {use: graph_nodes.Spread, in: {contact: second}}\n"
        "  other: {use: graph_nodes.Spring, in: {load: load}}",
        ["whole.yaml:9: node 'contact', input 'body'", "'other', on which only 'second' presses"],
    ),
    "a body whose contact does not read it": (
        ", body: tissue",
        "",
        ["node 'tissue': gets the load of 'contact', which does not read its Surface", "`in: {body: tissue}`"],
    ),
    "two senders for an input that takes one": (
        "{load: spread}",
        "{load: [spread, spread]}",
        ["node 'tissue', input 'load': takes one Load, found 2 senders", "take several: deformation.BeamBundle, "],
    ),
    "no sender in a list": ("{load: spread}", "{load: []}", ["node 'tissue', input 'load'", "no sender; expects Load"]),
    "an organ whose force reaches no controller": (
        "  motor:",
        "  second: {use: graph_nodes.Press, in: {proximity: near, body: organ}}\n"
        "  load:  {use: graph_nodes.Spread, in: {contact: second}}\n"
        "  organ: {use: graph_nodes.Spring, in: {load: load}}\n  motor:",
        [
            "whole.yaml:14: node 'second': its force reaches no controller: 'control' reads 'contact'",
            "`in: {contact: second}`, add it to the others by a contact.Sum if it is the same finger, or remove it",
        ],
    ),
    "unknown field of a recording": (
        "graph_nodes.Tape, in: all}",
        "logger.Mcap, in: all, fields: [stifness]}",
        ["setting 'fields'", "Did you mean 'stiffness'"],
    ),
    "rate beyond all numbers": ("nodes:", "rate: 1e308\nnodes:", ["rate [Hz]", "from 0.001 to 1e+06"]),
    "rate of months": ("nodes:", "rate: 1e-7\nnodes:", ["rate [Hz]", "found 1e-07", "from 0.001"]),
    "every of hours": ("when: tissue.friction", "every: 100000000", ["every: found 100000000", "from 1 to 1000000"]),
    "rate": ("nodes:", "rate: -1\nnodes:", ["rate [Hz]", "found -1", "above 0"]),
    "rate of another dimension": ("nodes:", "rate: 3 mm\nnodes:", ["rate [Hz]", "a length", "frequency"]),
    "wanted is unknown": ("nodes:", "wanted: [contrl]\nnodes:", ["'contrl'", "Did you mean 'control'"]),
    "wanted is no list": ("nodes:", "wanted: 3\nnodes:", ["wanted: found 3", "list of streams"]),
    "an observer of an unknown stream": (
        "in: all",
        "in: [contrl]",
        ["node 'log'", "'contrl'", "Did you mean 'control'"],
    ),
    "an observer with inputs": ("in: all", "in: {a: control}", ["node 'log'", "`all` or a list"]),
    "name of a node": ("  near: ", "  rate: ", ["'rate' cannot name a node"]),
    "a node is no mapping": ("in: all", "in: all}\n  other: {", ["node 'other'"]),
    "scene is no file": ("scene:\n  tissue", "scene: 3\nold:\n  tissue", ["scene: found 3"]),
    "scene is not found": (
        "scene:\n  tissue",
        "scene: kidny\nold:\n  tissue",
        ["'kidny' not found", "Did you mean 'kidney'"],
    ),
    "twice the same node": ("  near: ", "  log: {}\n  near: ", ["duplicate key 'log'", "line 8"]),
    "twice the same input": ("body: tissue", "proximity: near", ["duplicate key 'proximity'"]),
    "not yaml": ("nodes:", "nodes: [", ["not YAML", "column"]),
    "a tab": ("  near:", "\tnear:", ["whole.yaml:8", "column 1", "not YAML"]),
    "a tag": ("h0: 3e-3", "h0: !secret 3", ["tag '!secret'"]),
    "a merge key": ("h0: 3e-3", "<<: {h0: 1}", ["extends"]),
    "extends the unknown": ("nodes:", "extends: kidny\nnodes:", ["'kidny' not found", "Did you mean 'kidney'"]),
    "extends itself": ("nodes:", "extends: whole.yaml\nnodes:", ["leads back to itself"]),
    "extends a number": ("nodes:", "extends: 3\nnodes:", ["extends: found 3"]),
}


@pytest.mark.parametrize(("old", "new", "words"), BAD.values(), ids=BAD)
def test_a_bad_graph_is_an_error_with_cause_and_remedy(whole, old, new, words):
    text = whole.read_text()
    assert old in text
    whole.write_text(text.replace(old, new, 1))
    with pytest.raises(GraphError) as error:
        load(whole)
    printed = str(error.value)
    for word in words:
        assert word in printed, printed
    assert all(str(fault.place) for fault in error.value.faults), printed


def test_a_graph_in_another_encoding_is_an_error_with_place_and_remedy(whole):
    whole.write_bytes(b"# f\xc3\xbcr die Niere\n# f\xfcr die Niere\n" + whole.read_bytes())
    with pytest.raises(GraphError, match=r"whole.yaml:2: not UTF-8: byte 0xfc in column 4\n *Save the file as UTF-8"):
        load(whole)


SETS = {
    "scene.fingr.h0=1": ["--set scene.fingr.h0=1", "no 'fingr.h0'", "Did you mean 'scene.finger'"],
    "scene.finger.h1=1": ["'finger.h1'", "Did you mean 'scene.finger.h0'"],
    "tisue.stiffness=1": ["found 'tisue'", "Did you mean 'tissue'"],
    "tissue.stifness=1": ["--set tissue.stifness=1: node 'tissue', setting 'stifness'", "Did you mean 'stiffness'"],
    "tissue.stiffness=1 mm": ["[N/m]", "a length", "a stiffness"],
    "tissue=3": ["tissue", "expected tissue.setting"],
    "tissue.in.load.x=3": ["expected tissue.setting"],
    "tissue.in.load=finger": ["'tissue', input 'load'", "'finger' sends Pose"],
    "rat=3": ["found 'rat'", "Did you mean 'rate'"],
    "rate=fast": ["rate [Hz]", "'fast'"],
    "tissue.stiffness": ["expected target=value"],
    "=3": ["expected target=value"],
    "tissue.stiffness=[1": ["not YAML"],
    "scene.tissue.cells=9": ["'tissue.cells' of the scene reaches no node", "Settings of 'tissue' (Spring): stiffness"],
    "scene.tissue={friction: on, cells: 9}": ["'tissue.cells' of the scene reaches no node"],
    "tissue.use=graph_nodes.Spirng": ["no class 'Spirng'", "Did you mean 'Spring'", "Classes that send Surface"],
}


@pytest.mark.parametrize(("given", "words"), SETS.items(), ids=SETS)
def test_a_bad_override_is_an_error_with_cause_and_remedy(whole, given, words):
    with pytest.raises(GraphError) as error:
        load(whole, overrides=[given])
    for word in words:
        assert word in str(error.value), str(error.value)


def test_unused_scene_values_are_errors_in_overrides_and_notes_in_files():
    coulomb, fe = "friction.use=friction.Coulomb", "tissue.use=deformation.ReducedFE"
    for sets, path, cure in (
        ([coulomb, "scene.sliding.mu_slide=0.9"], "sliding.mu_slide", "'friction' (Coulomb) has 'mu'"),
        ([fe, "scene.tissue.stiffness=9e4"], "tissue.stiffness", "Settings of 'tissue' (ReducedFE): surface"),
        (["tissue.stiffness=3", "scene.tissue.stiffness=9e4"], "tissue.stiffness", "set tissue.stiffness"),
    ):
        with pytest.raises(GraphError) as error:
            load("kidney", overrides=sets)
        assert f"--set {sets[-1]}: {path!r} of the scene reaches no node" in str(error.value)
        assert cure in str(error.value)
    (note,) = load("kidney", overrides=[coulomb]).notes
    assert note.startswith("friction (Coulomb) does not take from scene.sliding: mu_slide (it has mu), mu_static")
    for graph in GRAPHS.glob("*.yaml"):
        assert load(graph).notes == ()


@pytest.mark.parametrize(
    "given",
    [
        "scene.tissue.friction=off",
        "scene.hand.begin=[0, 0, 0.117]",
        "scene.energy.bound=1 mJ",
        "scene.tissue={friction: on}",
    ],
)
def test_a_scene_value_is_accepted_if_a_setting_condition_or_skipped_node_reads_it(given):
    load("kidney", overrides=[given])


DATA = yaml.safe_load(WHOLE)
INNER = ["use", "in", "with", "when", "from", "loop", "body", "nodes", "h0", "x"]
KEYS = ["use", "in", "every", "xyz"]
LAUNCH = ["graph", "scene", "place", "clock", "duration", "record", "set", "wanted", "pace"]
ODD = st.recursive(
    st.one_of(
        st.none(), st.booleans(), st.integers(-3, 10**30), st.floats(), st.text(max_size=4),
        st.sampled_from(["$finger", "$finger.h0", "tissue", "tissue.Surface", "all", "6 mm", "graph_nodes.Foam", "."]),
    ),
    lambda inner: st.lists(inner, max_size=3)
    | st.dictionaries(st.sampled_from(INNER), inner),
    max_leaves=4,
)  # fmt: skip


def _ways(data, head=()):
    yield head
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in items:
        yield from _ways(value, (*head, key))


@settings(max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    way=st.sampled_from([w for w in _ways(DATA) if w]),
    value=ODD,
    key=st.sampled_from([*KEYS, None]),
)
def test_any_change_of_a_graph_gives_a_plan_or_faults(write, way, value, key):
    """After a random change of a value or a key the graph can be planned, or GraphError gives the reason."""
    data = copy.deepcopy(DATA)
    spot = data
    for step in way[:-1]:
        spot = spot[step]
    if key is not None and isinstance(spot[way[-1]], dict):
        spot[way[-1]][key] = value
    else:
        spot[way[-1]] = value
    file = write("odd.yaml", yaml.safe_dump(data, sort_keys=False))
    try:
        planned = plan(load(file))
    except GraphError as error:
        assert error.faults and "odd.yaml" in str(error)
        return
    assert Plan.from_spec(planned.to_spec()).order == planned.order


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    key=st.sampled_from(["graph", "scene", "place", "clock", "duration", "record", "set", "wanted", "pace"]), value=ODD
)
def test_any_launch_file_gives_a_run_or_faults(write, whole, key, value):
    file = write("run.yaml", yaml.safe_dump({"graph": "whole.yaml"} | {key: value}))
    try:
        run = find(str(file))
        run.placement(run.plan())
    except GraphError as error:
        assert error.faults


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(group=st.dictionaries(st.sampled_from(["nodes", "core", "priority", "host", "x"]), ODD, max_size=3) | ODD)
def test_any_placement_gives_groups_or_faults(write, whole, group):
    planned = plan(load(whole))
    try:
        groups = load_place(write("place.yaml", yaml.safe_dump({"g": group})), planned).groups
    except GraphError as error:
        assert "place.yaml" in str(error)
        return
    assert sorted(n for g in groups for n in g.nodes) == sorted([*planned.order, *planned.observers])


def test_one_mistake_is_one_fault(whole):
    for old, new in (("with: $finger", "h0: $finger.h1"), ("radius: 6 mm", "radius: 6 s"), ("graph_nodes.Rub", "a.B")):
        text = whole.read_text()
        whole.write_text(text.replace(old, new, 1))
        with pytest.raises(GraphError) as error:
            load(whole)
        whole.write_text(text)
        assert len(error.value.faults) == 1, str(error.value)


def test_a_value_of_the_scene_that_was_taken_for_a_setting_is_named():
    with pytest.raises(GraphError) as raised:
        find("kidney").but(overrides=("tissue.friction=false",)).load()
    assert "setting 'friction': unknown" in str(raised.value) and "set scene.tissue.friction." in str(raised.value)
