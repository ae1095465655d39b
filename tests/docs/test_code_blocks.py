"""Every block of code in README and documentation: run where it can be, otherwise parsed against the program."""

from __future__ import annotations

import ast
import contextlib
import functools
import importlib
import importlib.util
import io
import re
import sys
import tomllib
import types
from pathlib import Path
from typing import Any

import pytest
import typer.main
from code_blocks import ROOT, SHELL_WORDS, Block, blocks, commands, pages, parsed
from prepared_files import prepare, session
from typer.testing import CliRunner

from benchmarks.__main__ import names
from polfuse_lab.cli import build

LANGUAGES = {"python", "sh", "toml", "text", "cpp", "json"}


@functools.cache
def command_line() -> Any:
    return typer.main.get_command(build())


@pytest.fixture(scope="module")
def made_session(tmp_path_factory: pytest.TempPathFactory) -> Any:
    return functools.cache(lambda: session(tmp_path_factory.mktemp("docs") / "session.h5"))


@pytest.mark.parametrize("page", pages())
def test_the_code_of_a_page(page: str, tmp_path: Path, made_session: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    prepare(page, tmp_path, made_session)
    module = types.ModuleType("page")  # dataclasses look their module up
    monkeypatch.setitem(sys.modules, "page", module)
    printed = ""
    for block in blocks(page):
        if block.language == "sh":
            for words in commands(block):
                check_command(block, words)
                if block.mark == "run":
                    run_command(block, words)
        elif block.language == "python" and not block.mark:
            printed = run_python(block, vars(module))
        elif block.language == "python":
            check_imports(block)
        elif block.language == "toml":
            tomllib.loads(block.text)
        elif block.mark == "output":
            assert printed == block.text, f"{block}: the block above prints\n{printed}"
        else:
            assert block.language in LANGUAGES or block.language == "{toctree}", f"{block}: a block of no language"


def run_python(block: Block, namespace: dict[str, Any]) -> str:
    """What a Python block prints."""
    out = io.StringIO()
    code = compile("\n" * (block.line - 1) + block.text, str(ROOT / block.page), "exec")
    with contextlib.redirect_stdout(out):
        exec(code, namespace)
    return out.getvalue()


def check_imports(block: Block) -> None:
    """A Python block that is not run: it parses, and what it imports is there."""
    assert block.mark.startswith("not run: "), f"{block}: not run, and nothing says why"
    for node in ast.walk(ast.parse(block.text)):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = importlib.import_module(node.module)
            for alias in node.names:
                assert hasattr(module, alias.name), f"{block}: {node.module} has no {alias.name}"


def check_command(block: Block, words: list[str]) -> None:
    """A command that exists, with options and values that it takes."""
    head = words[0]
    assert head in SHELL_WORDS, f"{block}: what is {head!r}?"
    if head == "polfuse":
        check_polfuse(block, words[1:])
    elif head == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
        assert words[1] in targets, f"{block}: make has no {words[1]}"
    elif head == "python" and words[1] == "-m":
        module = words[2]
        assert importlib.util.find_spec(module) is not None, f"{block}: there is no module {module}"
        if module == "benchmarks":
            asked = [word for word in words[3:] if not word.startswith("-")]
            assert set(asked) <= {*names(), "NAME"}, f"{block}: no benchmark is called {asked}"
    elif head == "python":
        assert (ROOT / words[1]).exists(), f"{block}: there is no {words[1]}"


def check_polfuse(block: Block, arguments: list[str]) -> None:
    group = command_line()
    name, *rest = arguments
    if name in ("--help", "--version"):
        return
    assert name in group.commands, f"{block}: polfuse has no command {name}"
    if "--help" in rest or "-h" in rest:
        return
    try:
        group.commands[name].make_context(f"polfuse {name}", rest)
    except Exception as error:
        # Whatever click (typer brings its own) has against the words is what the page has wrong.
        pytest.fail(f"{block}: polfuse {' '.join(arguments)}: {getattr(error, 'message', '') or error}")


def run_command(block: Block, words: list[str]) -> None:
    if words[0] != "polfuse":
        pytest.fail(f"{block}: only polfuse's own commands are run")
    done = CliRunner().invoke(build(), words[1:])
    assert done.exit_code == 0, f"{block}: {' '.join(words)}: {done.output}"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("    polfuse focuss a.h5 -o b.h5\n", "no command focuss"),
        ("```sh\npolfuse focus a.h5 -o b.h5 --fast\n```\n", "--fast"),
        ("```sh\npolfuse focus a.h5\n```\n", "output"),
        ("```sh\npolfuse export p.h5 --to\n```\n", "--to"),
        ("    make coffee\n", "make has no coffee"),
        ("    python -m benchmarks speed.light\n", "no benchmark"),
    ],
)
def test_wrong_commands_are_found(text: str, words: str) -> None:
    (block,) = parsed("page.md", text)
    with pytest.raises((AssertionError, pytest.fail.Exception), match=re.escape(words)):
        check_command(block, *commands(block))


def test_blocks_and_marks_are_found() -> None:
    text = (
        "Text\n\n<!-- run -->\n```sh\na \\\n  b # c\n```\n\n    make test\n    x y\n\n"
        "<!-- not run: needs a camera -->\n```python\nimport os\n```\n"
    )
    shell, indented, python = parsed("page.md", text)
    assert (shell.language, shell.mark, commands(shell), shell.line) == ("sh", "run", [["a", "b"]], 5)
    assert (indented.language, indented.line) == ("", 9)  # x is no command
    assert (python.language, python.mark, python.text) == ("python", "not run: needs a camera", "import os\n")
    with pytest.raises(AssertionError, match="mark without a block"):
        parsed("page.md", "<!-- run -->\ntext\n")
    with pytest.raises(AssertionError, match="without an end"):
        parsed("page.md", "```sh\nmake\n")
