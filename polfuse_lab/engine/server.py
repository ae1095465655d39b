"""What a collect's (or a replay's) clients are told, and how they steer it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

from polfuse_lab.engine import protocol
from polfuse_lab.engine.serving import LINGER_S, ClientServer
from polfuse_lab.live import Preview
from polfuse_lab.scheduler import Control, Outcome, RunStatus
from polfuse_lab.scheduler.prompts import Prompts

__all__ = ["LINGER_S", "Run", "Server"]


class Run(Protocol):
    """What is steered: a :class:`polfuse_lab.scheduler.Scheduler`, or a session that is played."""

    control: Control
    prompts: Prompts

    def status(self) -> RunStatus:
        """The present status."""

    def note(self, text: str) -> bool:
        """Add a remark; False when it comes too late."""


class Previewing(Protocol):
    """Who makes the previews that go with the status."""

    @property
    def preview(self) -> Preview | None:
        """The newest one."""


class Server(ClientServer):
    """Serves the clients of a run.

    Args:
        directory: the engine's private directory.
        request: what the engine was started for.
        run: what is steered.
        live: makes the preview in the status.
        on_watch: called when a client reads the live streams.
        on_speed: called when a client wants a replay faster or slower; a collect cannot.
        on_seek: called when a client wants to see a later step of a replay.
    """

    def __init__(
        self,
        directory: Path,
        request: protocol.Request,
        run: Run,
        live: Previewing,
        *,
        on_watch: Callable[[], None] = lambda: None,
        on_speed: Callable[[float], None] | None = None,
        on_seek: Callable[[int], None] | None = None,
    ) -> None:
        super().__init__(directory, request)
        self._run, self._live, self._on_watch = run, live, on_watch
        self._on_speed, self._on_seek = on_speed, on_seek

    def finish(self, outcome: Outcome) -> None:
        """Tell the outcome, wait until every client has left (a few seconds at most), and end."""
        fields = asdict(outcome)
        session = None if outcome.session is None else str(outcome.session)
        self.end(protocol.Finished(**{**fields, "session": session, "warnings": list(outcome.warnings)}))

    def _decode(self, content: bytes) -> protocol.ClientMessage:
        return protocol.decode_client(content)

    def _obey(self, message: protocol.ClientMessage) -> str | None:
        match message:
            case protocol.Abort(reason):
                self._run.control.abort(reason)
            case protocol.Pause():
                self._run.control.pause()
            case protocol.Resume():
                self._run.control.resume()
            case protocol.AddNote(text):
                if not self._run.note(text):
                    return "the collect has ended: the note was not kept"
            case protocol.Answer(ticket):
                if not self._run.prompts.answer(ticket):
                    return f"prompt {ticket} is not open"
            case protocol.Watch():
                self._on_watch()
            case protocol.SetSpeed(speed):
                if self._on_speed is None:
                    return "a collect runs at its own speed"
                if not speed > 0:
                    return f"a speed of {speed:g} is not above 0"
                self._on_speed(speed)
            case protocol.Seek(step):
                if self._on_seek is None:
                    return "a collect has no later steps yet"
                self._on_seek(step)
        return None

    def _states(self) -> dict[bytes, Any]:
        status = asdict(self._run.status())
        prompts = [protocol.Prompt(ticket, text) for ticket, text in self._run.prompts.open()]
        fields = {**status, "state": str(status["state"]), "warnings": list(status["warnings"]), "prompts": prompts}
        preview = self._live.preview
        messages = {}
        for identity, client in list(self._clients.items()):
            fresh = None
            if preview is not None and preview.number > client.preview:
                client.preview = preview.number
                fresh = protocol.PreviewData(
                    preview.number,
                    preview.position,
                    preview.x_m,
                    preview.channel,
                    preview.step_m,
                    preview.level_db.astype("<f4").tobytes(),
                )
            messages[identity] = protocol.StatusEvent(**fields, preview=fresh)
        return messages
