"""Docstrings are plain text with literals and roles: their bars, stars and underscores are no markup of Sphinx."""

from __future__ import annotations

import re
from typing import Any

from sphinx.application import Sphinx

MARKUP = re.compile(r"(``.+?``|:[\w:]+:`[^`]+`|`[^`]+`)")
SIGNS = re.compile(r"\||\*(?! )|(?<=\S )\*|_(?!\w)")
"""A star that begins a line and has a space after it begins an item of a list."""
AFTER = re.compile(r"$|[\s'\")\]}>\-/\\:.,;!?]")
"""What may follow the end of a literal."""


def escaped(line: str) -> str:
    """One line with the signs escaped that stand outside of literals and roles."""
    pieces = MARKUP.split(line)
    for i in range(0, len(pieces), 2):
        pieces[i] = SIGNS.sub(lambda found: "\\" + found.group(), pieces[i])
        if i and not AFTER.match(pieces[i]):
            pieces[i] = "\\ " + pieces[i]
    return "".join(pieces)


def _process(app: Sphinx, what: str, name: str, obj: object, options: Any, lines: list[str]) -> None:
    block: int | None = None
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if block is not None and line.strip() and indent <= block:
            block = None
        if block is None:
            lines[i] = escaped(line)
            if line.rstrip().endswith("::"):
                block = indent


def setup(app: Sphinx) -> dict[str, Any]:
    """Come before the sections (Args, Raises) are read."""
    app.connect("autodoc-process-docstring", _process, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
