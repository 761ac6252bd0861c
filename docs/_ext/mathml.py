"""Formulae as MathML, converted when the site is built: browsers show it without a script, or a network."""

from __future__ import annotations

import html
import re

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.util import logging

logger = logging.getLogger(__name__)

#: LaTeX that the converter does not know -> what it does.
ALIKE = (
    (r"\\dots\b", r"\\ldots"),
    (r"\\[tdl]?frac ?(\w)(\w)", r"\\frac{\1}{\2}"),
    (r"\\[tdl]?frac ?(\w)\{", r"\\frac{\1}{"),
)


def convert(text: str, block: bool) -> str:
    """The MathML of a formula in LaTeX."""
    for pattern, other in ALIKE:
        text = re.sub(pattern, other, text)
    if block and r"\\" in text and r"\begin" not in text:
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    return latex2mathml.tex2mathml(text, as_block=block)


def shown(node: nodes.Element, block: bool) -> str:
    """The MathML of a node; where its formula cannot be said, a warning and its LaTeX."""
    try:
        return convert(node.astext(), block)
    except Exception as error:
        logger.warning("no MathML of %r: %s", node.astext(), error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"


def inline(self, node: nodes.math) -> None:
    """Write a formula in a line."""
    self.body.append(shown(node, False))
    raise nodes.SkipNode


def block(self, node: nodes.math_block) -> None:
    """Write a formula on a line of its own."""
    self.body.append(f'<div class="formula">{shown(node, True)}</div>')
    raise nodes.SkipNode


def setup(app) -> dict[str, bool]:
    """Register the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
