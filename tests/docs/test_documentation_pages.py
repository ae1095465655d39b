"""Pages of the documentation: their links lead somewhere, each is reached from the index, and Sphinx can make them."""

from __future__ import annotations

import ast
import fnmatch
import re
from pathlib import Path

import pytest
from code_blocks import ROOT, pages

LINK = re.compile(r"\]\(([^)\s]+)\)")
DOCS = ROOT / "docs"


def anchors(path: Path) -> set[str]:
    """Names of a page's headings, as GitHub and MyST make them."""
    heads = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", pages())
def test_links_lead_somewhere(page: str) -> None:
    path = ROOT / page
    for link in LINK.findall(path.read_text(encoding="utf-8")):
        if link.startswith(("http://", "https://", "mailto:")):
            continue
        name, _, anchor = link.partition("#")
        target = (path.parent / name).resolve() if name else path
        assert target.exists(), f"{page}: {link} leads nowhere"
        assert target.is_relative_to(ROOT), f"{page}: {link} leaves the repository"
        if anchor:
            assert anchor in anchors(target), f"{page}: {link}: there is no such heading"


def test_every_page_is_reached_from_the_index() -> None:
    reached, waiting = {"index"}, ["index"]
    every = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    while waiting:
        page = waiting.pop()
        folder = Path(page).parent
        text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
        for tree in re.findall(r"```\{toctree\}\n(.*?)```", text, re.DOTALL):
            for entry in (line.strip() for line in tree.splitlines()):
                if not entry or entry.startswith(":") or entry == "api/index":
                    continue
                pattern = (folder / entry).as_posix()
                found = {name for name in fnmatch.filter(every, pattern) if name.count("/") == pattern.count("/")}
                assert found, f"docs/{page}.md lists {entry}, which is not there"
                waiting += sorted(found - reached)
                reached |= found
    assert every - reached == set(), "pages that nobody finds: list them in docs/index.md"


def test_every_page_begins_with_its_title() -> None:
    for page in pages():
        lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
        assert lines[0].startswith("# "), page
        assert all(len(line) <= 400 for line in lines), page


def test_the_theory_names_each_equation_of_the_thesis_that_code_refers_to() -> None:
    """Docstrings point to equations of the thesis by number; chapters 2, 4, 5, 6 and 7 are in the theory pages."""
    theory = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "theory").glob("*.md"))
    told = set(re.findall(r"\b([24567]\.\d+)", theory))
    for chapter, first, last in re.findall(r"\b([24567])\.(\d+) to \1\.(\d+)", theory):
        told |= {f"{chapter}.{number}" for number in range(int(first), int(last) + 1)}
    asked: dict[str, str] = {}
    for path in (ROOT / "processing").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
                for number in re.findall(r"[Tt]hesis(?:'s)? \(?([24567]\.\d+)\b", text):
                    asked[number] = path.relative_to(ROOT).as_posix()
    assert len(asked) > 15
    assert {number: where for number, where in asked.items() if number not in told} == {}


def test_every_test_that_a_page_names_is_there() -> None:
    named = 0
    for page in pages():
        for path, name in re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", (ROOT / page).read_text(encoding="utf-8")):
            assert (ROOT / path).exists(), f"{page} names {path}"
            assert not name or f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), (
                f"{page} names {path}::{name}"
            )
            named += 1
    assert named > 35
