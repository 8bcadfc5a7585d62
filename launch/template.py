"""Templates for a new node and its test."""

import keyword
import re
from typing import Any

import msgspec

from palpate.messages import Field, Load, Message, Surface, fields
from palpate.messages.record import layout
from palpate.registry import snake

_NODE = '''"""{title}: say here what it computes."""

from __future__ import annotations

from typing import Annotated

import msgspec
{numpy}
from palpate.messages import {messages}
{base}

class {title}({parent}):
    """First line: what it computes. It shows in `palpate list nodes {module}.{title}`."""

    scale: Annotated[float, "1", msgspec.Meta({limit})] = 1.0
{body}'''

_COMPILED = """\
from palpate.nodes import CompiledNode, Out, kernel
"""

_STEP = '''
    def start(self) -> None:
        """Make the state here; `start` is also the reset."""
        self.time = 0.0  # [s] elapsed time

    def step(self, {port}: {takes}, *, dt: float) -> {sends}:
        """The first input drives; add others as arguments, `name: Type | None` where it may be absent."""
        self.time += dt
        return {answer}
'''

_COMPUTE = '''
    State = {{"time": ()}}  # [s] elapsed time; (): a number, (3,): a vector

    @kernel
    def compute(own, {port}: {takes}, out: Out[{sends}], dt):
        """The first input drives; add others before `out`, `name: Type | None` where `name.there` may be False."""
        own.time += dt
{filled}'''

_BODY = '''    stiffness: Annotated[float, "N/m", msgspec.Meta(gt=0)] = 1e3

    def start(self) -> None:
        """Make the state here; `start` is also the reset."""
        self.indentation = 0.0  # [m] at the end of the last step

    def step(self, load: Load, *, dt: float) -> Surface:
        """A linear spring: the normal force F indents the surface by scale F/stiffness."""
        force = max(0.0, -float(np.sum(load.forces @ np.array(load.normal))))  # [N]
        self.indentation = self.scale * force / self.stiffness
        largest = np.linalg.norm(load.forces, axis=1).max(initial=1e-12)  # [N]
        return Surface(
            nodes=load.nodes,
            displacement=load.forces * (self.indentation / largest),  # [m] the vertex with most load moves furthest
            stiffness=self.stiffness / self.scale,  # [N/m] of the law that the contact solves until the next step
            exponent=1.0,
            damping=0.0,  # [s/m]
            rest_indentation=0.0,  # [m] indentation without force
            previous_indentation=self.indentation,  # [m]
        )
'''

_BODY_TEST = """

def test_a_force_deforms_the_surface():
    bus = FakeBus({title}(scale=1.0, stiffness=500.0))
    load = Load(nodes=np.array([7]), forces=np.array([[0.0, 0.0, -1.0]]), foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
    surface = bus.publish(load)[0]
    assert list(surface.nodes) == [7] and np.allclose(surface.displacement, [[0.0, 0.0, -2e-3]])  # 1 N / (500 N/m)
"""

_TEST = '''"""Unit test of {title}, without graph or network."""
{numpy}
from palpate.launch.testing import FakeBus
from palpate.messages import {messages}

from {module} import {title}


def test_each_message_gets_an_answer():
    bus = FakeBus({title}(scale=2.0))
    given = {given}
    first, second = bus.publish(given, given)
    assert isinstance(first, {sends})
    assert (first.tick, second.tick) == (0, 1)
'''


def class_name(name: str) -> str:
    """The class name for "my drag", "my_drag" or "MyDrag". ValueError: no valid name."""
    words = [word for word in re.split(r"[^0-9A-Za-z]+", name) if word]
    title = "".join(word[0].upper() + word[1:] for word in words)
    if not title.isidentifier() or keyword.iskeyword(title):
        raise ValueError(f"{name!r} cannot name a class; expected letters and digits, a letter first, such as MyDrag")
    return title


def module_name(title: str) -> str:
    """The module name of a class: MyDrag -> my_drag."""
    return f"{snake(title)}_node" if keyword.iskeyword(snake(title)) else snake(title)


def node_files(name: str, takes: type[Message], sends: type[Message], compiled: bool = False) -> dict[str, str]:
    """File names and texts of a new node and its test. ValueError: an invalid name, or a message that a compiled node
    does not support."""
    title = class_name(name)
    module = module_name(title)
    answer, given = _example(sends, 8), _example(takes, 4)
    names = {
        "title": title, "module": module, "port": module_name(takes.__name__), "answer": answer, "given": given,
        "takes": takes.__name__, "sends": sends.__name__,
        "messages": ", ".join(sorted({takes.__name__, sends.__name__})),
        "filled": _message_lines(takes, sends) if compiled else "", "parent": "CompiledNode" if compiled else "Node",
        "base": _COMPILED if compiled else "from palpate.nodes import Node\n",
    }  # fmt: skip
    is_body = (takes, sends) == (Load, Surface) and not compiled
    body = (_COMPUTE if compiled else _BODY if is_body else _STEP).format(**names)
    positive = "gt=0" if is_body else "ge=0"
    node = _NODE.format(**names, body=body, limit=positive, numpy="import numpy as np\n" if "np." in body else "")
    test = (_TEST + _BODY_TEST * is_body).format(**names, numpy="\nimport numpy as np\n" if "np." in given else "")
    return {f"{module}.py": node, f"test_{module}.py": test}


def _example(kind: type[Message], indent: int) -> str:
    """Python text of a message at rest, one required field per line with its unit."""
    at_rest = kind.example(loaded=False)
    lines = [
        f"{' ' * (indent + 4)}{f.name}={_text(f, getattr(at_rest, f.name))},  # [{f.unit}]\n"
        for f in _required_fields(kind)
    ]
    return f"{kind.__name__}(\n{''.join(lines)}{' ' * indent})" if lines else f"{kind.__name__}()"


def _message_lines(takes: type[Message], sends: type[Message]) -> str:
    """The same message as lines of a kernel. ValueError: a message that a record does not support."""
    try:
        layout(takes)
        layout(sends)
    except TypeError as error:
        raise ValueError(f"{error}. Or a node in Python: without --compiled") from None
    at_rest = sends.example(loaded=False)
    return "".join(f"        {_assignment_of(f, getattr(at_rest, f.name))}\n" for f in _required_fields(sends))


def _assignment_of(field: Field, value: Any) -> str:
    name, unit = f"out.{field.name}", f"  # [{field.unit}]"
    if field.dtype is not None:
        return f"{name}.shape[0] = 0{unit}"
    if field.words:
        return f"{name} = {field.words.index(value)}  # {value}"
    if not field.shape:
        return f"{name} = {value!r}{unit}"
    if not isinstance(field.shape[0], int):
        return f"{name}.count = 0{unit}"
    return f"{', '.join(f'{name}[{i}]' for i in range(len(value)))} = {', '.join(map(repr, value))}{unit}"


def _required_fields(kind: type[Message]) -> list[Field]:
    needed = {field.name for field in msgspec.structs.fields(kind) if field.required}
    return [field for field in fields(kind) if field.name in needed]


def _text(field: Field, value: Any) -> str:
    if field.dtype is None:
        return repr(value)
    return f"np.zeros({value.shape if len(value.shape) > 1 else len(value)})"
