"""The window's end of set-up mode."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal

from gui.models import background
from polfuse_lab.bench import BenchClient, BenchStatus
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan

POLL_MS = 100


class BenchLink(QObject):
    """Set-up mode of one rig at a time."""

    status = Signal(object)
    """A :class:`~polfuse_lab.bench.BenchStatus`."""
    opened = Signal(object)
    left = Signal()
    failed = Signal(str, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.client: BenchClient | None = None
        self._starting = False
        self._timer = QTimer(self)
        self._timer.setInterval(POLL_MS)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether the devices are open, or being opened."""
        return self._starting or self.client is not None

    def start(self, rig: Path) -> None:
        """Open the devices of a rig."""
        if self.busy:
            return
        self._starting = True
        background.run(self, lambda: BenchClient.start(rig), self._started, self._not_started)

    def ask(self, what: str, *values: object, **named: object) -> None:
        """Ask for something by the name of the client's method: ``jog``, ``select``, ``turn`` …"""
        if self.client is None:
            return
        method: Callable[..., Any] = getattr(self.client, what)
        try:
            method(*values, **named)
        except PolfuseError as error:
            self._lost(str(error))

    def answer(self, ticket: int) -> None:
        """The operator has done what was asked."""
        self.ask("answer", ticket)

    def hand_over(
        self, plan: Plan, output: Path, done: Callable[[Any], None], failed: Callable[[str, str], None]
    ) -> None:
        """End set-up mode and begin a collect on the same devices; ``done`` gets the engine's client."""
        client, self.client = self.client, None
        self._timer.stop()
        self.left.emit()
        if client is not None:
            background.run(self, lambda: client.hand_over(plan, output), done, failed)

    def close(self) -> None:
        """Make the devices safe and let go of them."""
        self._timer.stop()
        client, self.client = self.client, None
        if client is not None:
            background.run(self, client.close, lambda _: None, self.failed.emit)
            self.left.emit()

    def _started(self, client: BenchClient) -> None:
        self._starting = False
        self.client = client
        self._timer.start()
        self.opened.emit(client)

    def _not_started(self, sentence: str, details: str) -> None:
        self._starting = False
        self.left.emit()
        self.failed.emit(sentence, details)

    def _poll(self) -> None:
        if self.client is None:
            return
        try:
            status = self.client.poll(0.0)
        except PolfuseError as error:
            self._lost(str(error))
            return
        if isinstance(status, BenchStatus):
            self.status.emit(status)

    def _lost(self, sentence: str) -> None:
        self._timer.stop()
        self.client = None
        self.left.emit()
        self.failed.emit(sentence, "")
