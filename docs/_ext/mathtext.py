"""Equations as vector pictures, drawn by matplotlib when the pages are made: they show without any network."""

from __future__ import annotations

import base64
import html
import io
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.writers.html import HTMLTranslator

SIZE_PT = {"inline": 11.0, "display": 13.0}
POINTS_PER_EM = 12.0


def drawn(tex: str, kind: str) -> str:
    """An ``img`` element with the equation, its baseline on the line's."""
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties
    from matplotlib.mathtext import MathTextParser

    tex_shown = tex.replace("\\frac", "\\dfrac") if kind == "display" else tex
    text = "$" + " ".join(tex_shown.split()) + "$"
    font = FontProperties(size=SIZE_PT[kind], math_fontfamily="stix")
    width, height, depth, _, _ = MathTextParser("path").parse(text, dpi=72, prop=font)
    pad = 1.0
    wide, high = width + 2 * pad, height + depth + 2 * pad
    figure = Figure(figsize=(wide / 72, high / 72))
    figure.text(pad / wide, (depth + pad) / high, text, fontproperties=font)
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    style = f"height:{high / POINTS_PER_EM:.3f}em;vertical-align:{-(depth + pad) / POINTS_PER_EM:.3f}em"
    return f'<img class="math" alt="{html.escape(tex)}" style="{style}" src="data:image/svg+xml;base64,{data}"/>'


def _inline(self: HTMLTranslator, node: nodes.Element) -> None:
    self.body.append(drawn(node.astext(), "inline"))
    raise nodes.SkipNode


def _display(self: HTMLTranslator, node: nodes.Element) -> None:
    self.body.append(f'<p class="math" style="margin-left:2em">{drawn(node.astext(), "display")}</p>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer the renderer to Sphinx."""
    app.add_html_math_renderer("mathtext", (_inline, None), (_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
