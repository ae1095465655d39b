"""Whatever the window says can be translated: it goes through ``tr``, and a translation reaches the screen."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gui
from gui import translation
from gui.widgets.error_bar import ErrorBar

SOURCES = sorted(Path(gui.__file__).parent.rglob("*.py"))
SAYING = {
    "QLabel", "QPushButton", "QAction", "QListWidgetItem", "QTableWidgetItem", "addAction", "addItem", "addItems",
    "addMenu", "addRow", "addTab", "button", "dim", "emit", "heading", "setAccessibleDescription", "setAccessibleName",
    "setHorizontalHeaderLabels", "setPlaceholderText", "setText", "setTitle", "setToolTip", "setWindowTitle",
    "say_empty", "show_idle", "tell", "tell_done", "title",
}  # fmt: skip
"""Calls whose texts a user reads."""
TOLD = re.compile(r"[A-Za-z]{3,}")
TEXTS = {"button": 3, "addItem": 1}
"""How many of the arguments are texts, where others are not."""
NOT_SEEN = {"tour.py", "saving.py"}
"""What these call by the same names is written into files."""
NAMES = {"PolFuse Lab", "PNG (*.png);;PDF (*.pdf)", "HDF5 (*.h5)", "HTML (*.html)"}
"""Proper names, the same in all languages."""
LUPDATE = shutil.which("pyside6-lupdate", path=str(Path(sys.executable).parent))
LRELEASE = shutil.which("pyside6-lrelease", path=str(Path(sys.executable).parent))


def called(node: ast.Call) -> str:
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def bare(tree: ast.Module) -> list[tuple[int, str]]:
    """Texts of calls that speak to the user which do not go through ``tr``, with their lines."""
    found: list[tuple[int, str]] = []

    def texts(node: ast.AST) -> None:
        if isinstance(node, ast.Call) and called(node) in ("tr", "translate"):
            return
        if isinstance(node, ast.Call) and called(node) not in ("format", "join"):
            return  # what another function makes of its texts is its own business
        if isinstance(node, ast.Compare):
            return
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str) and TOLD.search(node.value) and node.value not in NAMES:
                found.append((node.lineno, node.value))
            return
        for child in ast.iter_child_nodes(node):
            texts(child)

    class Walk(ast.NodeVisitor):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
            if not node.name.startswith(("_demo", "demo_")):  # demo data speak to nobody
                self.generic_visit(node)

        def visit_Call(self, node: ast.Call) -> None:
            if called(node) in SAYING:
                page = called(node) == "emit" and "wanted" in ast.unparse(node.func)
                for argument in [] if page else node.args[: TEXTS.get(called(node))]:
                    texts(argument)
            self.generic_visit(node)

    Walk().visit(tree)
    return found


def test_no_text_stands_in_a_widget_as_it_is() -> None:
    told = [
        f"{path.name}:{line}: {text!r}"
        for path in SOURCES
        if path.name not in NOT_SEEN
        for line, text in bare(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert told == []


def test_the_search_finds_them() -> None:
    source = 'self.words.setText(f"{count} lost frames")\nself.bar.setText(self.tr("whole"))\nheading("Devices")\n'
    assert bare(ast.parse(source)) == [(1, " lost frames"), (3, "Devices")]


@pytest.mark.skipif(LUPDATE is None or LRELEASE is None, reason="PySide6's tools for translators are not installed")
def test_a_translation_reaches_the_screen(qtbot, qapp, tmp_path: Path) -> None:
    texts = tmp_path / "polfuse_xx.ts"
    source = Path(gui.__file__).parent / "widgets" / "error_bar.py"
    subprocess.run([str(LUPDATE), str(source), "-ts", str(texts)], check=True, capture_output=True, timeout=60)
    text = texts.read_text(encoding="utf-8")
    assert "<source>Copy details</source>" in text
    turned = text.replace(
        '<source>Copy details</source>\n        <translation type="unfinished"></translation>',
        "<source>Copy details</source>\n        <translation>Kopiere alles</translation>",
    )
    assert turned != text
    texts.write_text(turned, encoding="utf-8")
    subprocess.run([str(LRELEASE), str(texts)], check=True, capture_output=True, timeout=60)
    translator = translation.install(qapp, "xx_YY", tmp_path)
    assert translator is not None
    try:
        bar = ErrorBar()
        qtbot.addWidget(bar)
        assert bar.copy_button.text() == "Kopiere alles"
        assert bar.close_button.text() == "Close"  # what is not translated stays English
    finally:
        qapp.removeTranslator(translator)
    assert translation.install(qapp, "xx_YY", tmp_path / "nowhere") is None
