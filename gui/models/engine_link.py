"""The window's end of a collect: listens to the engine, which goes on whatever becomes of the window."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from gui.models import background
from polfuse_lab.engine import EngineClient, ReplayClient
from polfuse_lab.engine.protocol import Finished, StatusEvent
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan

POLL_MS = 50


class EngineLink(QObject):
    """One collect at a time."""

    status = Signal(object)
    """A :class:`~polfuse_lab.engine.protocol.StatusEvent`."""
    finished = Signal(object)
    """A :class:`~polfuse_lab.engine.protocol.Finished`."""
    failed = Signal(str, str)
    """It did not start, or its process has ended; one sentence, and the details."""
    attached = Signal(object)
    """The client, when a collect has begun or been found."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.client: EngineClient | None = None
        self.starting = False
        self.replaying = False
        """Whether what runs, or ran last, is a recorded session that is played."""
        self._timer = QTimer(self)
        self._timer.setInterval(POLL_MS)
        self._timer.timeout.connect(self._poll)

    @property
    def busy(self) -> bool:
        """Whether a collect runs or is being started."""
        return self.starting or self.client is not None

    def start(self, rig: Path, plan: Path | Plan, output: Path, *, continues: Path | None = None) -> None:
        """Begin a collect; :attr:`attached` or :attr:`failed` tells how that went."""
        self._begin(lambda: EngineClient.start(rig, plan, output, continues=continues))

    def attach(self, directory: Path) -> None:
        """Listen to a collect that runs already."""
        self._begin(lambda: EngineClient.attach(directory))

    def adopt(self, client: EngineClient) -> None:
        """Listen to an engine that has been started elsewhere."""
        self.starting = False
        self.client = client
        self.replaying = isinstance(client, ReplayClient)
        self._timer.start()
        self.attached.emit(client)

    def pause(self) -> None:
        """Pause after the present step."""
        if self.client is not None:
            self.client.pause()

    def resume(self) -> None:
        """Go on from the last checkpoint."""
        if self.client is not None:
            self.client.resume()

    def abort(self) -> None:
        """Stop the collect now; what has been recorded is kept."""
        if self.client is not None:
            self.client.abort()

    def note(self, text: str) -> None:
        """Store a remark in the session."""
        if self.client is not None:
            self.client.note(text)

    def answer(self, ticket: int) -> None:
        """The operator has done what was asked."""
        if self.client is not None:
            self.client.answer(ticket)

    def set_speed(self, speed: float) -> None:
        """Play so many times as fast as recorded, where a recorded session is played."""
        if isinstance(self.client, ReplayClient):
            self.client.set_speed(speed)

    def seek(self, step: int) -> None:
        """Play fast until a step that is still to come, where a recorded session is played."""
        if isinstance(self.client, ReplayClient):
            self.client.seek(step)

    def leave(self) -> None:
        """Stop listening; the collect goes on."""
        self._timer.stop()
        client, self.client = self.client, None
        if client is not None:
            client.close()

    def _begin(self, make: Callable[[], EngineClient]) -> None:
        if self.busy:
            self.failed.emit(self.tr("a collect runs already: wait for its end, or abort it"), "")
            return
        self.starting = True
        background.run(self, make, self.adopt, self.not_started)

    def not_started(self, sentence: str, details: str) -> None:
        """It could not be started."""
        self.starting = False
        self.failed.emit(sentence, details)

    def _poll(self) -> None:
        if self.client is None:
            return
        try:
            event = self.client.poll(0.0)
        except PolfuseError as error:
            with contextlib.suppress(PolfuseError):
                self.leave()
            self.failed.emit(str(error), "")
            return
        if isinstance(event, Finished):
            self.leave()
            self.finished.emit(event)
        elif isinstance(event, StatusEvent):
            self.status.emit(event)
