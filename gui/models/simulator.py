"""The simulated rig, in a process of its own that ends with the window."""

from __future__ import annotations

import contextlib
import sys
import tempfile
from pathlib import Path

from PySide6.QtCore import QObject, QProcess, Signal

END_MS = 5000


class Simulator(QObject):
    """Starts ``polfuse sim`` and says where its rig file is."""

    ready = Signal(object)
    """Path of the rig file that reaches it."""
    failed = Signal(str, str)

    def __init__(self, scene: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._scene = scene
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._process = QProcess(self)
        self._process.readyReadStandardOutput.connect(self._read)
        self._process.errorOccurred.connect(lambda _: self._ended())
        self._process.finished.connect(lambda *_: self._ended())
        self.rig: Path | None = None

    @property
    def running(self) -> bool:
        """Whether its process lives."""
        return self._process.state() != QProcess.ProcessState.NotRunning

    def start(self) -> None:
        """Start it, unless it runs."""
        if self.running:
            if self.rig is not None:
                self.ready.emit(self.rig)
            return
        self._folder = tempfile.TemporaryDirectory(prefix="polfuse-window-")
        rig = Path(self._folder.name) / "simulated-rig.toml"
        self._process.start(
            sys.executable, ["-m", "polfuse_lab.cli", "sim", str(self._scene), "--rig-out", str(rig), "--json"]
        )

    def stop(self) -> None:
        """End it and remove what it left."""
        self._process.blockSignals(True)
        if self.running:
            self._process.terminate()
            if not self._process.waitForFinished(END_MS):
                self._process.kill()
                self._process.waitForFinished(END_MS)
        self.rig = None
        folder, self._folder = self._folder, None
        if folder is not None:
            with contextlib.suppress(OSError):
                folder.cleanup()

    def _read(self) -> None:
        self._process.readAllStandardOutput()
        if self.rig is None and self._folder is not None:
            rig = Path(self._folder.name) / "simulated-rig.toml"
            if rig.is_file():
                self.rig = rig
                self.ready.emit(rig)

    def _ended(self) -> None:
        words = bytes(self._process.readAllStandardError().data()).decode(errors="replace").strip()
        last = words.splitlines()[-1] if words else self._process.errorString()
        self.rig = None
        self.failed.emit(self.tr("the simulated rig has ended: {0}").format(last), words)
