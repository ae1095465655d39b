"""Other languages than English: ``translations/polfuse_<language>.qm`` beside this file, where somebody has made one.

``make translations LANGUAGE=xx`` collects the texts into ``polfuse_xx.ts`` for a translator, and releases what is done.
"""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QCoreApplication, QLocale, QTranslator

FOLDER = Path(__file__).with_name("translations")


def install(application: QCoreApplication, language: str = "", folder: Path = FOLDER) -> QTranslator | None:
    """Speak the user's language from now on; windows that are there already stay as they are.

    Args:
        application: what is to speak it.
        language: such as ``de_DE``; empty: the computer's.
        folder: where the translations are.

    Returns:
        The translator, which the application uses; None where there is no such translation: English it is.
    """
    translator = QTranslator(application)
    locale = QLocale(language) if language else QLocale.system()
    names = [language, language.partition("_")[0]] if language else locale.uiLanguages()
    for name in names:
        if translator.load(f"polfuse_{name.replace('-', '_')}", str(folder)):
            application.installTranslator(translator)
            return translator
    translator.deleteLater()
    return None
