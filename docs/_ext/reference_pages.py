"""The reference: a page of every command and one of every package's modules, written anew when the pages are made."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer.main
from sphinx.application import Sphinx

import polfuse_lab

PACKAGES = ("processing", "drivers", "polfuse_lab", "hw_mocks")
LEFT_OUT = ("polfuse_lab.cli", "polfuse_lab.warm_up")
"""Told by the page of commands, or not for use by others."""


def write_pages(app: Sphinx) -> None:
    """All pages, into the folder ``api`` beside the others; pages that are as they were stay untouched."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    pages = {"commands": _commands_page(), **dict(_package_pages())}
    names = "\n".join(f"   {name}" for name in pages)
    pages["index"] = f"Reference\n=========\n\n.. toctree::\n   :maxdepth: 1\n\n{names}\n"
    for name, text in pages.items():
        path = folder / f"{name}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in folder.glob("*.rst"):
        if path.stem not in pages:
            path.unlink()


def packages() -> dict[str, list[str]]:
    """Names of all documented modules, by the package that they stand in."""
    found: dict[str, list[str]] = {}
    for top in PACKAGES:
        package = importlib.import_module(top)
        found[top] = [top]
        for module in pkgutil.walk_packages(package.__path__, top + "."):
            if module.name.startswith(LEFT_OUT) or module.name.rpartition(".")[2] == "__main__":
                continue
            home = module.name if module.ispkg else module.name.rpartition(".")[0]
            found.setdefault(home, []).append(module.name)
    return found


def _package_pages() -> Iterator[tuple[str, str]]:
    for package, modules in packages().items():
        parts = [f"{package}\n{'=' * len(package)}\n"]
        for name in modules:
            if name != package:
                parts.append(f"{name}\n{'-' * len(name)}\n")
            parts.append(f".. automodule:: {name}\n")
            if name == "polfuse_lab":
                parts.append(_public_names())
        yield package, "\n".join(parts)


def _public_names() -> str:
    """The package's own names and where each is told."""
    rows = []
    for name in polfuse_lab.__all__:
        found = getattr(polfuse_lab, name)
        kind = "class" if isinstance(found, type) else "func"
        rows.append(f"* ``pf.{name}``: :{kind}:`{found.__module__}.{found.__name__}`")
    return "\n".join(rows) + "\n"


def _commands_page() -> str:
    from polfuse_lab.cli import build

    group: Any = typer.main.get_command(build())
    parts = ["Commands\n========\n", "Every command takes ``--json``, ``--debug`` and ``--help``.\n"]
    for name, command in group.commands.items():
        title = f"polfuse {name}"
        parts.append(f"{title}\n{'-' * len(title)}\n")
        context = command.make_context(title, [], resilient_parsing=True, terminal_width=100)
        lines = command.get_help(context).splitlines()
        parts.append("::\n\n" + "\n".join(f"   {line}".rstrip() for line in lines) + "\n")
    return "\n".join(parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Have the pages written before any is read."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
