"""Regions drawn by hand, with undo; their statistics are asked for a moment after each change."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal
from PySide6.QtGui import QUndoStack

from gui.models import background
from gui.models.change import Change
from polfuse_lab.products.region_statistics import Region, RegionReport, read_regions, region_report, write_regions

SETTLE_MS = 250
Corners = tuple[tuple[float, float], ...]


class RegionList(QObject):
    """Named polygons on the ground. Every change goes through :attr:`undo`."""

    changed = Signal()
    reported = Signal(object)
    """A :class:`~polfuse_lab.products.region_statistics.RegionReport` of the newest state."""
    failed = Signal(str)
    """Why there is no report, in one sentence."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.undo = QUndoStack(self)
        self._regions: dict[str, Corners] = {}
        self._products: Path | None = None
        self._asked = 0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(SETTLE_MS)
        self._timer.timeout.connect(self._ask)

    @property
    def regions(self) -> dict[str, Corners]:
        """Corners by name, in the order of drawing."""
        return dict(self._regions)

    def look_at(self, products: Path) -> None:
        """The file that statistics are read from."""
        self._products = products
        self._later()

    def add(self, corners: Corners) -> str:
        """Add a region; returns the name that it is given."""
        name = next(name for number in range(1, 1000) if (name := f"region {number}") not in self._regions)
        self._do(self.tr("draw {0}").format(name), {**self._regions, name: corners})
        return name

    def move(self, name: str, corners: Corners) -> None:
        """Give a region other corners."""
        if self._regions.get(name) != corners:
            self._do(self.tr("change {0}").format(name), {**self._regions, name: corners})

    def rename(self, name: str, new: str) -> bool:
        """Give a region another name; False where that is taken or empty."""
        new = new.strip()
        if not new or (new != name and new in self._regions):
            return False
        if new != name:
            renamed = {new if key == name else key: corners for key, corners in self._regions.items()}
            self._do(self.tr("rename {0}").format(name), renamed)
        return True

    def remove(self, name: str) -> None:
        """Take a region away."""
        left = {key: corners for key, corners in self._regions.items() if key != name}
        self._do(self.tr("remove {0}").format(name), left)

    def load(self, path: Path) -> None:
        """Read a regions file. Raises :class:`PolfuseError`."""
        self._do(self.tr("open {0}").format(path.name), {r.name: r.polygon_m for r in read_regions(path)})

    def save(self, path: Path) -> None:
        """Write a regions file, for ``polfuse fuse --regions``. Raises :class:`PolfuseError`."""
        write_regions(path, self._as_regions())

    def _as_regions(self) -> tuple[Region, ...]:
        return tuple(Region(name=name, polygon_m=corners) for name, corners in self._regions.items())

    def _do(self, words: str, after: dict[str, Corners]) -> None:
        self.undo.push(Change(words, self.set_state, self.regions, after))

    def set_state(self, regions: dict[str, Corners]) -> None:
        """What an undo or redo does; not for others."""
        self._regions = dict(regions)
        self.changed.emit()
        self._later()

    def _later(self) -> None:
        self._asked += 1
        self._timer.start()

    def _ask(self) -> None:
        products, regions, number = self._products, self._as_regions(), self._asked
        if products is None or not regions:
            return

        def done(report: RegionReport) -> None:
            if number == self._asked:
                self.reported.emit(report)

        def failed(sentence: str, _: str) -> None:
            if number == self._asked:
                self.failed.emit(sentence)

        background.run(self, lambda: region_report(products, regions), done, failed)
