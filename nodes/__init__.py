"""One file or folder per job: settings, ports and state of the nodes; the formulas are in `physics`."""

from palpate.nodes.base import Node, Wants

__all__ = ["Node", "Wants"]
