"""Formulas of the site as MathML, which browsers draw without a script or a network."""

from html import escape
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)


def mathml(text: str, display: str, where: Any = None) -> str:
    """LaTeX as MathML; a warning for a formula that cannot be converted."""
    try:
        return convert(text, display=display)
    except Exception as error:  # the converter raises various types
        LOGGER.warning("formula %r: %s: %s", text, type(error).__name__, error, location=where)
        return f"<code>{escape(text)}</code>"


def _inline(translator: Any, node: Any) -> None:
    translator.body.append(mathml(node.astext(), "inline", node))
    raise nodes.SkipNode


def _block(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="math">{mathml(node.astext(), "block", node)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
