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
    """MathML of a formula in LaTeX; ``block`` is True for a formula on a line of its own."""
    for pattern, other in ALIKE:
        text = re.sub(pattern, other, text)
    if block and r"\\" in text and r"\begin" not in text:
        text = rf"\begin{{aligned}}{text}\end{{aligned}}"
    return latex2mathml.tex2mathml(text, as_block=block)


def shown(node: nodes.Element, block: bool) -> str:
    """MathML of the formula of a document node; if it cannot be converted, its LaTeX as code, after a warning."""
    try:
        return convert(node.astext(), block)
    except Exception as error:
        logger.warning("no MathML of %r: %s", node.astext(), error, location=node)
        return f"<code>{html.escape(node.astext())}</code>"


def inline(self, node: nodes.math) -> None:
    """Visit a formula within a line: append its MathML to the page (``self`` is Sphinx's HTML translator)."""
    self.body.append(shown(node, False))
    raise nodes.SkipNode


def block(self, node: nodes.math_block) -> None:
    """Visit a formula on a line of its own: append its MathML to the page (``self`` is Sphinx's HTML translator)."""
    self.body.append(f'<div class="formula">{shown(node, True)}</div>')
    raise nodes.SkipNode


def setup(app) -> dict[str, bool]:
    """Register the renderer of formulae with Sphinx; return the dict by which Sphinx may build pages in parallel."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
