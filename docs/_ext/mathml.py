"""Formulas as MathML, which browsers draw themselves: no script, no fonts, no network."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

_BOLD = re.compile(r'<mi mathvariant="bold">([A-Za-z])</mi>')


def mathml(formula: str, display: str) -> str:
    """The formula; bold letters as letters of their own, for browsers ignore that they should be bold."""

    def bold(match: re.Match[str]) -> str:
        letter = match[1]
        first = ord("a") if letter.islower() else ord("A")
        return f"<mi>{chr((0x1D41A if letter.islower() else 0x1D400) + ord(letter) - first)}</mi>"

    return _BOLD.sub(bold, convert(formula, display=display))


def inline(self: Any, node: nodes.math) -> None:
    """A formula within a line."""
    self.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def block(self: Any, node: Any) -> None:
    """A formula on lines of its own."""
    self.body.append(mathml(node.astext(), "block"))
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
