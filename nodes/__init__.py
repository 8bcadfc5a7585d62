"""One file or folder per job: settings, ports and state of the nodes; the formulas are in `physics`."""

from palpate.nodes.base import CompiledNode, Node, Out, Part, Wants

__all__ = ["CompiledNode", "Node", "Out", "Part", "Wants"]
