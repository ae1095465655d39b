"""Start an engine, or attach to one that runs; watch it and steer it."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import msgspec
import zmq

from polfuse_lab.engine import directory as directories
from polfuse_lab.engine import protocol
from polfuse_lab.engine.protocol import Finished, Prompt, StatusEvent
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan, parse_plan, plan_to_toml
from polfuse_lab.plans.step_json import steps_to_json
from polfuse_lab.rig import Rig, load_rig
from polfuse_lab.rig.toml_model import read_text

START_S = 30.0
DEAF_S = 10.0
"""An engine that has said nothing for so long is taken for dead once its process is gone, s."""


class EngineClient:
    """One client of one engine. Leaving it does not end the run. Not thread-safe."""

    def __init__(self, directory: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        self.directory = directory
        self._process = process
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._pinged = self._heard = time.monotonic()
        self.status: StatusEvent | None = None
        """The newest status."""
        self.finished: Finished | None = None
        """The outcome, once the run has ended."""
        self.pid = 0
        """Process id of the engine."""

    @classmethod
    def start(
        cls,
        rig_path: Path | str,
        plan: Path | str | Plan,
        output: Path | str,
        *,
        continues: Path | str | None = None,
    ) -> EngineClient:
        """Start an engine for one collect, detached from this process and its terminal, and attach to it.

        Args:
            rig_path: the rig file.
            plan: the plan file, or a plan made in Python.
            output: the session file to be written; must not exist.
            continues: a session of the same plan that did not come to its end: only what is missing in it is collected.

        Raises:
            PolfuseError: a file is wrong, or the engine does not start.
        """
        rig_path = Path(rig_path).resolve()
        rig = load_rig(rig_path)
        plan_path, plan_toml = _plan_text(plan)
        rest = None if continues is None else _rest(continues, rig, parse_plan(plan_toml, plan_path))
        private = directories.make()
        token = secrets.token_urlsafe(32)
        request = protocol.Request(
            rig_path=str(rig_path),
            rig_toml=rig_path.read_text(encoding="utf-8"),
            plan_path=plan_path,
            plan_toml=plan_toml,
            output=str(Path(output).resolve()),
            token=token,
            transport=directories.transport(private),
            rest=rest,
        )
        (private / directories.REQUEST).write_bytes(msgspec.msgpack.encode(request))
        (private / directories.TOKEN).write_text(token, encoding="utf-8")
        with open(private / directories.LOG, "wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "polfuse_lab.engine", str(private)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        client = cls(private, process)
        try:
            client._attach(START_S)
        except BaseException:
            client.close()
            process.kill()
            process.wait(5)
            directories.remove(private)
            raise
        return client

    @classmethod
    def attach(cls, directory: Path) -> EngineClient:
        """Attach to a running engine (see :func:`running_engines`). Raises :class:`PolfuseError`."""
        client = cls(directory)
        try:
            client._attach(5.0)
        except BaseException:
            client.close()
            raise
        return client

    def poll(self, timeout_s: float = 0.2) -> StatusEvent | Finished | None:
        """Wait for the next word of the engine; the newest of several. None when there was none in time.

        Raises:
            PolfuseError: the engine refused what was asked, or its process has ended without a word.
        """
        now = time.monotonic()
        if now - self._pinged > protocol.SILENCE_S / 5:
            self._send(protocol.Ping())
            self._pinged = now
        newest: StatusEvent | Finished | None = None
        wait = int(timeout_s * 1000)
        while newest is None or not isinstance(newest, Finished):
            if not self._socket.poll(0 if newest is not None else wait):
                break
            message = protocol.decode_engine(self._socket.recv())
            self._heard = time.monotonic()
            wait = 0
            if isinstance(message, protocol.Refused):
                raise PolfuseError(message.reason, where="engine", advice="try again")
            newest = message
            if isinstance(message, StatusEvent):
                # A preview is sent once; one that is skipped over stays the newest.
                if message.preview is None and self.status is not None:
                    message = msgspec.structs.replace(message, preview=self.status.preview)
                self.status = newest = message
        if isinstance(newest, Finished):
            self.finished = newest
            with contextlib.suppress(zmq.ZMQError):
                self._send(protocol.Detach())
        if newest is None and self._lost() and not self._socket.poll(300):
            # Its last word would have arrived by now.
            words = self._last_words()
            directories.remove(self.directory)
            raise PolfuseError(
                f"the engine's process ended unexpectedly ({words})",
                where="engine",
                advice="the writer closes the session by itself: look at it with 'polfuse info'",
            )
        return newest

    def wait(
        self,
        on_status: Callable[[StatusEvent], None] | None = None,
        on_prompt: Callable[[Prompt], None] | None = None,
    ) -> Finished:
        """Watch until the run has ended. Raises as :meth:`poll`.

        Args:
            on_status: called with each status.
            on_prompt: called once for each prompt to the operator; answer it with :meth:`answer`, now or later.
        """
        seen: set[int] = set()
        while self.finished is None:
            event = self.poll()
            if isinstance(event, StatusEvent):
                if on_status is not None:
                    on_status(event)
                for prompt in event.prompts:
                    if prompt.ticket not in seen and on_prompt is not None:
                        seen.add(prompt.ticket)
                        on_prompt(prompt)
        return self.finished

    def abort(self, reason: str = "aborted by the user") -> None:
        """Stop the run now."""
        self._send(protocol.Abort(reason))

    def pause(self) -> None:
        """Pause after the present step."""
        self._send(protocol.Pause())

    def resume(self) -> None:
        """Go on from the last checkpoint."""
        self._send(protocol.Resume())

    def note(self, text: str) -> None:
        """Store a remark in the session."""
        self._send(protocol.AddNote(text))

    def answer(self, ticket: int) -> None:
        """Confirm a prompt."""
        self._send(protocol.Answer(ticket))

    def close(self) -> None:
        """Leave; the run goes on. Idempotent."""
        if self._socket.closed:
            return
        with contextlib.suppress(zmq.ZMQError):
            self._send(protocol.Detach())
        self._socket.close()
        self._context.term()
        if self._process is not None and self.finished is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(10)
        if self._process is not None and self._process.poll() is None:
            # It goes on without us; whenever it ends, somebody must take note, or it stays a zombie.
            threading.Thread(target=self._process.wait, name="engine reaper", daemon=True).start()

    def __enter__(self) -> EngineClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _attach(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while (known := directories.address(self.directory)) is None:
            if self._process is not None and self._process.poll() is not None:
                raise PolfuseError(
                    f"the engine did not start ({self._last_words()})", where="engine", advice="run 'polfuse doctor'"
                )
            if time.monotonic() > deadline:
                raise PolfuseError("no engine answers", where=str(self.directory), advice="start the collect again")
            time.sleep(0.02)
        self.pid = known.pid
        token = (self.directory / directories.TOKEN).read_text(encoding="utf-8")
        self._socket.connect(known.endpoint)
        self._send(protocol.Attach(protocol.PROTOCOL_VERSION, token))
        while self.poll(0.1) is None:
            if time.monotonic() > deadline:
                raise PolfuseError("the engine does not answer", where=str(self.directory), advice="end its process")

    def _send(self, message: protocol.ClientMessage) -> None:
        with contextlib.suppress(zmq.Again):
            self._socket.send(protocol.encode(message), zmq.NOBLOCK)

    def _lost(self) -> bool:
        if self._process is not None:
            return self._process.poll() is not None
        if time.monotonic() - self._heard < 1.0:
            return False
        if os.name == "posix":
            try:
                os.kill(self.pid, 0)
            except ProcessLookupError:
                return True
            except PermissionError:
                return False
        return time.monotonic() - self._heard > DEAF_S

    def _last_words(self) -> str:
        try:
            text = (self.directory / directories.LOG).read_text(errors="replace")
        except OSError:
            return "it left no message"
        # What the guard has done since is no reason; of a crash in native code the first line tells what it was.
        lines = [line for line in text.splitlines() if line.strip() and not line.startswith("guard: ")]
        fatal = [line for line in lines if line.startswith("Fatal Python error")]
        return (fatal or lines or ["it left no message"])[-1]


def _plan_text(plan: Path | str | Plan) -> tuple[str, str]:
    """Name and text of a plan's file. Raises :class:`PolfuseError` where the plan is wrong."""
    if isinstance(plan, Plan):
        name, text = f"plan '{plan.name}'", plan_to_toml(plan)
    else:
        name = str(Path(plan).resolve())
        text = read_text(name)
    parse_plan(text, name)
    return name, text


def _rest(predecessor: Path | str, rig: Rig, plan: Plan) -> protocol.Rest:
    from polfuse_lab.session.continuation import continuation

    left = continuation(predecessor, rig, plan)
    return protocol.Rest(steps_to_json(left.steps), left.origin)


def running_engines() -> list[Path]:
    """Directories of this user's running engines, for :meth:`EngineClient.attach`."""
    return directories.running()


def collect(
    rig_path: Path | str,
    plan: Path | str | Plan,
    output: Path | str,
    *,
    continues: Path | str | None = None,
    on_status: Callable[[StatusEvent], None] | None = None,
    on_prompt: Callable[[EngineClient, Prompt], None] | None = None,
) -> Finished:
    """Run one collect to its end and return its outcome; Ctrl-C (KeyboardInterrupt) and SIGTERM abort it cleanly.

    ``state`` of the outcome is ``"finished"``, ``"aborted"`` or ``"failed"``; ``reason`` says why.

    Args:
        rig_path: the rig file.
        plan: the plan file, or a plan made in Python (see :mod:`polfuse_lab.plans.custom`).
        output: the session file to be written; must not exist.
        continues: a session of the same plan that did not come to its end: only what is missing in it is collected, and
            :func:`polfuse_lab.session.join` makes one session of both.
        on_status: called with each status, about five times a second.
        on_prompt: called with the client and each prompt for the operator of a hand-operated device; without it, the
            first prompt aborts the run.

    Raises:
        PolfuseError: a file is wrong, or the engine does not start or dies.
    """
    with EngineClient.start(rig_path, plan, output, continues=continues) as client:

        def ask(prompt: Prompt) -> None:
            if on_prompt is None:
                client.abort(f"nobody was there to do what was asked: {prompt.text}")
            else:
                on_prompt(client, prompt)

        while True:
            try:
                return client.wait(on_status, ask)
            except KeyboardInterrupt:
                client.abort()
