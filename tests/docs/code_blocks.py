"""Code blocks of the documentation, with what stands in a comment before them.

``<!-- run -->`` before a shell block: its commands are run. ``<!-- not run: WHY -->`` before a Python block: it is only
parsed. ``<!-- output -->`` before a text block: that is what the Python block above prints.
"""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FENCE = re.compile(r"^```(\w*|\{\w+\})\s*$")
MARK = re.compile(r"^<!--\s*(run|output|not run: .{10,})\s*-->$")
SHELL_WORDS = {
    "polfuse", "make", "python", "python3", "py", "pip", "uv", "pytest", "sudo", ".", ".venv\\Scripts\\activate",
}  # fmt: skip


@dataclass(frozen=True)
class Block:
    """A block of code as it stands in a page."""

    page: str
    line: int
    """Of its first line of code."""
    language: str
    """As the fence says; ``"sh"`` for indented commands, ``""`` for what tells no language."""
    text: str
    mark: str
    """``"run"``, ``"output"``, ``"not run: …"`` or nothing."""

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def pages() -> list[str]:
    """README and every page of the documentation, relative to the repository."""
    found = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "api" not in path.parts]
    return ["README.md", *(path.relative_to(ROOT).as_posix() for path in found)]


def blocks(page: str) -> list[Block]:
    """All blocks of a page, in order."""
    return parsed(page, (ROOT / page).read_text(encoding="utf-8"))


def parsed(page: str, text: str) -> list[Block]:
    """All blocks of a text."""
    lines = text.splitlines()
    found: list[Block] = []
    mark, i = "", 0
    while i < len(lines):
        if fence := FENCE.match(lines[i]):
            end = next((j for j in range(i + 1, len(lines)) if lines[j].rstrip() == "```"), None)
            assert end is not None, f"{page}:{i + 1}: a block without an end"
            found.append(Block(page, i + 2, fence[1], "\n".join(lines[i + 1 : end]) + "\n", mark))
            mark, i = "", end
        elif lines[i].startswith("    ") and not (i and lines[i - 1].strip()):
            end = i
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            code = [line[4:] for line in lines[i:end]]
            shell = all(line.split()[0] in SHELL_WORDS for line in code if line.strip())
            found.append(Block(page, i + 1, "sh" if shell else "", "\n".join(code).rstrip() + "\n", mark))
            mark, i = "", end - 1
        elif told := MARK.match(lines[i]):
            mark = told[1].strip()
        elif lines[i].strip():
            assert not mark, f"{page}:{i}: a mark without a block"
        i += 1
    return found


def commands(block: Block) -> list[list[str]]:
    """The commands of a shell block as words, comments left out, continued lines joined."""
    text = block.text.replace("\\\n", " ")
    found = [shlex.split(line, comments=True, posix="\\" not in line) for line in text.splitlines()]
    return [words for words in found if words]
