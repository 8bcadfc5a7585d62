"""The known error of a tissue model, to be added to differences from it when it serves as the reference."""

from palpate.engine.graph import Graph
from palpate.messages import Surface
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.deformation.basis_store import shipped_bases
from palpate.physics.errors import ArgumentError

KNOWN = 0.01
"""[1] RMS force error of ReducedFE against two full solvers on meshes that follow the patch, on the test cases of
`palpate bench accuracy` except the tap and the nodule (docs/accuracy.md)."""


def body_of(graph: Graph) -> str:
    """Name of the node that sends `Surface`. ArgumentError: not exactly one node does."""
    names = [name for name, spec in graph.nodes.items() if Surface in spec.streams.values()]
    if len(names) != 1:
        raise ArgumentError(
            f"{graph.path}: {len(names)} nodes send Surface, expected one deformable body; kidney, nodule and "
            "fingertip have one"
        )
    return names[0]


def known_error(graph: Graph) -> float:
    """Known force error [1] of the body of a graph: `KNOWN` plus the error of its nonlinear table against the full
    model, from the stored basis; 0 if unknown."""
    spec = graph.nodes[body_of(graph)]
    if spec.cls is not ReducedFE:
        return 0.0
    try:
        node = ReducedFE(**spec.settings)
        key = node.key()
    except SettingError:
        return 0.0
    stored = [about["error"] for about in shipped_bases().values() if about["key"] == key]
    known = 0.0 if node.model == "sampled" else KNOWN
    return known + (float(stored[0].get("mean", 0.0)) if stored else 0.0)


def error_sentence(graph: Graph) -> str:
    """A sentence on the known error of the body; "" for a graph without a body."""
    try:
        name = graph.nodes[body_of(graph)].cls.__name__
        known = known_error(graph)
    except ArgumentError:
        return ""
    if known:
        return f"The known force error of {name} itself: {100 * known:.2g} % of peak (RMS; docs/accuracy.md)."
    return f"The error of {name} itself is not in these differences: `palpate bench accuracy` measures it."
