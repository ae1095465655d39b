"""Saves what a part of the window shows, with where it comes from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from PySide6.QtCore import QMarginsF, QRectF
from PySide6.QtGui import QPageLayout, QPageSize, QPainter, QPdfWriter
from PySide6.QtWidgets import QWidget

NOTE_PT = 9


def save_view(view: QWidget, path: Path, provenance: Mapping[str, object]) -> None:
    """Write a picture of ``view`` as PNG or PDF (by its suffix), with the provenance in its metadata and below it.

    Raises:
        OSError: the file cannot be written, or is neither.
    """
    words = json.dumps(dict(provenance), ensure_ascii=False, default=str)
    picture = view.grab()
    if path.suffix.lower() == ".png":
        image = picture.toImage()
        image.setText("Provenance", words)
        image.setText("Software", "PolFuse Lab")
        if not image.save(str(path)):
            raise OSError(f"{path}: not written")
        return
    if path.suffix.lower() != ".pdf":
        raise OSError(f"{path.suffix or 'no suffix'}: pictures are .png or .pdf")
    writer = QPdfWriter(str(path))
    writer.setCreator("PolFuse Lab")
    writer.setTitle(words)
    writer.setPageSize(QPageSize(QPageSize.PageSizeId.A4))
    writer.setPageOrientation(QPageLayout.Orientation.Landscape)
    writer.setPageMargins(QMarginsF(10, 10, 10, 10))
    painter = QPainter()
    if not painter.begin(writer):
        raise OSError(f"{path}: not written")
    try:
        page = QRectF(painter.viewport())
        font = painter.font()
        font.setPointSizeF(NOTE_PT)
        painter.setFont(font)
        note = painter.fontMetrics().height() * 3
        scale = min(page.width() / picture.width(), (page.height() - note) / picture.height())
        painter.drawPixmap(
            QRectF(0, 0, picture.width() * scale, picture.height() * scale), picture, QRectF(picture.rect())
        )
        told = "   ".join(f"{key}: {value}" for key, value in provenance.items() if value)
        painter.drawText(QRectF(0, page.height() - note, page.width(), note), 0x1000, told)  # word wrap
    finally:
        painter.end()
