"""Start an engine, or attach to one that runs; watch it and steer it."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable
from pathlib import Path

import msgspec
import zmq

from polfuse_lab.engine import directory as directories
from polfuse_lab.engine import protocol
from polfuse_lab.engine.claims import refuse_held
from polfuse_lab.engine.directory import EngineInfo
from polfuse_lab.engine.link import Link
from polfuse_lab.engine.protocol import Finished, Prompt, StatusEvent
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan, parse_plan, plan_to_toml
from polfuse_lab.plans.step_json import steps_to_json
from polfuse_lab.rig import Rig, load_rig
from polfuse_lab.rig.toml_model import read_text


class EngineClient(Link):
    """One client of one engine. Leaving it does not end the run. Not thread-safe."""

    def __init__(self, directory: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        super().__init__(directory, process)
        self.status: StatusEvent | None = None
        """The newest status."""
        self.finished: Finished | None = None
        """The outcome, once the run has ended."""

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
            PolfuseError: a file is wrong, set-up mode holds a device, or the engine does not start.
        """
        rig_path = Path(rig_path).resolve()
        rig = load_rig(rig_path)
        plan_path, plan_toml = _plan_text(plan)
        rest = None if continues is None else _rest(continues, rig, parse_plan(plan_toml, plan_path))
        # What another collect holds is refused by the devices themselves, as another program's would be.
        refuse_held(rig, mode="bench")
        return cls._launch(
            protocol.Request(
                rig_path=str(rig_path),
                rig_toml=rig_path.read_text(encoding="utf-8"),
                plan_path=plan_path,
                plan_toml=plan_toml,
                output=str(Path(output).resolve()),
                token="",
                transport="",
                rest=rest,
            )
        )

    def poll(self, timeout_s: float = 0.2) -> StatusEvent | Finished | None:
        """Wait for the next word of the engine; the newest of several. None when there was none in time.

        Raises:
            PolfuseError: the engine refused what was asked, or its process has ended without a word.
        """
        self._ping()
        newest: StatusEvent | Finished | None = None
        wait = int(timeout_s * 1000)
        while newest is None or not isinstance(newest, Finished):
            content = self._next(0 if newest is not None else wait)
            if content is None:
                break
            message = protocol.decode_engine(content)
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
            self._ended = True
            with contextlib.suppress(zmq.ZMQError):
                self._send(protocol.Detach())
        if newest is None:
            self._require_engine()
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
        super().close()


class ReplayClient(EngineClient):
    """One client of an engine that plays a session as if it were collected; leaving it does not end the replay."""

    @classmethod
    def play(cls, session: Path | str, *, speed: float = 1.0) -> ReplayClient:
        """Begin to play a session, to look at; nothing is written.

        Args:
            session: the session file.
            speed: how many times as fast as recorded.

        Raises:
            PolfuseError: the session cannot be replayed, or the engine does not start.
        """
        from polfuse_lab.replay.tape import require_replayable
        from polfuse_lab.session import open_session

        if not speed > 0:
            raise PolfuseError(f"speed {speed:g} is not above 0", where="replay", advice="give 1 for real time")
        path = Path(session).resolve()
        with open_session(path) as opened:
            require_replayable(opened)
            rig_toml, plan_toml = opened.rig_toml, opened.plan_toml
        return cls._launch(
            protocol.Request(
                rig_path=f"{path}:rig.toml",
                rig_toml=rig_toml or "",
                plan_path=f"{path}:plan.toml",
                plan_toml=plan_toml or "",
                output=str(path),
                token="",
                transport="",
                mode="replay",
                speed=speed,
            )
        )

    def set_speed(self, speed: float) -> None:
        """Play so many times as fast as recorded from now on."""
        self._send(protocol.SetSpeed(speed))

    def seek(self, step: int) -> None:
        """Play fast until a step of the plan, as the status counts them; earlier ones need a new replay."""
        self._send(protocol.Seek(step))


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


def engines() -> list[EngineInfo]:
    """This user's running engines with what they do, the oldest first."""
    return directories.engines()


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
