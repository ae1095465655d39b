"""A long run on a terminal: one line that tells how far it is, and questions to the person in front of it."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from polfuse_lab.cli.output import progress

if TYPE_CHECKING:
    from polfuse_lab.engine import EngineClient, Prompt, StatusEvent
    from polfuse_lab.scheduler import RunStatus

LOG_EVERY_S = 5.0
"""Where stderr is a file, a line of progress comes only so often."""


class StatusLine:
    """Progress on stderr: one line rewritten in place on a terminal, a line now and then elsewhere."""

    def __init__(self) -> None:
        self._terminal = sys.stderr.isatty()
        self._shown = ""
        self._last = 0.0

    def show(self, status: StatusEvent | RunStatus) -> None:
        """Show a status."""
        text = describe(status)
        now = time.monotonic()
        if self._terminal:
            print(f"\r{text:<{len(self._shown)}}", end="", file=sys.stderr, flush=True)
            self._shown = text
        elif now - self._last >= LOG_EVERY_S and status.steps:
            self._last = now
            progress(text, status.step / status.steps, status.eta_s)

    def end(self) -> None:
        """Leave the line."""
        if self._terminal and self._shown:
            print(file=sys.stderr)
            self._shown = ""


def describe(status: StatusEvent | RunStatus) -> str:
    """A status in one line."""
    parts = [f"{status.state} {status.step}/{status.steps}"]
    if status.positions and status.position >= 0:
        parts.append(f"position {status.position + 1}/{status.positions}")
    if status.channel:
        parts.append(status.channel)
    if status.eta_s is not None:
        minutes, seconds = divmod(round(status.eta_s), 60)
        parts.append(f"{minutes}:{seconds:02d} left")
    parts.append(status.reason)
    if status.samples_lost or status.frames_lost:
        parts.append(f"lost {status.samples_lost} audio, {status.frames_lost} camera frames")
    return ", ".join(parts)


class AskOnTerminal:
    """Shows the operator's prompts on stderr and confirms each when a line comes in on stdin."""

    def __init__(self, line: StatusLine) -> None:
        self._line = line

    def ask(self, client: EngineClient, prompt: Prompt) -> None:
        """Show a prompt; where nobody can answer it, abort the run."""
        self._line.end()
        if sys.stdin is None or sys.stdin.closed or not sys.stdin.readable():
            client.abort("nobody can answer the operator's prompts: stdin is closed")
            return
        print(f"{prompt.text}  [Enter when done] ", end="", file=sys.stderr, flush=True)
        answer = _read_line(client, prompt.ticket)
        if answer is None and client.finished is None:
            client.abort(f"nobody answered {prompt.text!r}: stdin has ended")
        elif answer is not None:
            client.answer(prompt.ticket)


def _read_line(client: EngineClient, ticket: int) -> str | None:
    """One line of stdin (None at its end), while the engine is kept from forgetting its client.

    An empty text comes back once the prompt has been answered elsewhere.
    """
    lines: list[str] = []
    # A thread, since nothing else waits for a line and for Ctrl-C and for the engine at once on every system.
    reader = threading.Thread(target=lambda: lines.append(sys.stdin.readline()), name="stdin", daemon=True)
    reader.start()
    while reader.is_alive() and client.finished is None:
        reader.join(0.1)
        client.poll(0.0)
        if client.status is not None and ticket not in [prompt.ticket for prompt in client.status.prompts]:
            return ""
    return lines[0] if lines and lines[0] else None


@contextmanager
def interrupt_on_sigterm() -> Iterator[None]:
    """Let SIGTERM end the work as Ctrl-C does."""

    def interrupt(number: int, frame: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
