"""A recorded session played through the scheduler: into a copy, to a viewer, or both."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans.custom import recorded_plan
from polfuse_lab.plans.steps import Checkpoint, Step
from polfuse_lab.records import Event, Record
from polfuse_lab.replay.clock import FASTEST, ReplayClock
from polfuse_lab.replay.compare import Difference, compare_sessions
from polfuse_lab.replay.control import ReplayControl
from polfuse_lab.replay.devices import playback_devices
from polfuse_lab.replay.incidents import Loss, Pause, rewound_to
from polfuse_lab.replay.recorder import NoCopy, ReplayRecorder
from polfuse_lab.replay.tape import Tape, require_replayable
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler import Control, Outcome, Recorder, RunState, RunStatus, Scheduler, Viewer
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.prompts import Prompts
from polfuse_lab.session import open_session
from polfuse_lab.session.naming import check_free_name

POLL_S = 0.1


@dataclass(frozen=True)
class ReplayResult:
    """How a replay went."""

    session: Path
    """The copy."""
    differences: tuple[Difference, ...]
    seconds: float
    """Duration of the replay, s."""
    state: str
    """How the run ended: ``"finished"``, ``"aborted"`` or ``"failed"``; the copy's state is the recording's."""
    reason: str

    @property
    def identical(self) -> bool:
        """Whether the copy holds the same records to the last bit (see :func:`compare_sessions`)."""
        return not self.differences


class Player:
    """One replay of one session. :meth:`run` blocks; everything else may be used from other threads meanwhile.

    The scheduler, its steps, retries, repeats and the writer are those of a collect; only the devices are played back
    and time is the recording's. Idle time of the recording (pauses, a person at work) is shortened to two seconds.

    Args:
        session: the session to replay.
        output: the copy; None to watch only.
        speed: how many times as fast as recorded, or :data:`FASTEST`.
        viewer: looks at the records as they come, such as :class:`polfuse_lab.live.LivePipeline`; its verdict that a
            collect is pointless is not asked for.

    Raises:
        PolfuseError: the session cannot be read or replayed, or the copy's name is taken.
    """

    def __init__(
        self,
        session: Path | str,
        output: Path | str | None = None,
        *,
        speed: float = FASTEST,
        viewer: Viewer | None = None,
    ) -> None:
        if not speed > 0:
            raise PolfuseError(f"speed {speed:g} is not above 0", where="replay", advice="give 1 for real time")
        self._session = open_session(session)
        try:
            require_replayable(self._session)
            rig, plan = self._session.rig, self._session.plan
            assert rig is not None
            assert plan is not None
            # The steps as they were planned then, whatever this version would make of the plan file.
            plan = recorded_plan(plan, self._session.steps)
            target = _watched_name(self._session.path) if output is None else Path(output)
            check_free_name(target)
            self._tape = Tape(self._session)
            self.clock = ReplayClock(self._tape.start_ns, speed)
            """Its ``pause``, ``resume`` and ``speed`` are a player's knobs."""
            self._steps: tuple[Step, ...] = self._session.steps
            self._sought = 0
            self._control = ReplayControl(self._tape, self.clock, self._answer_prompts)
            inner: Recorder = NoCopy(target) if output is None else WriterProcess(target)
            self._scheduler = Scheduler(
                rig,
                plan,
                target,
                ReplayRecorder(self._tape, inner, on_event=self._on_event, before_flush=self._before_flush),
                rig_path=Path(f"{self._session.path}:rig.toml"),
                rig_toml=self._session.rig_toml,
                plan_toml=self._session.plan_toml,
                viewer=None if viewer is None else _Watching(viewer),
                on_change=self._on_change,
                control=self._control,
                devices=self._make_devices,
            )
        except BaseException:
            self._session.close()
            raise

    def __enter__(self) -> Player:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the session. Idempotent."""
        self._session.close()

    def run(self) -> Outcome:
        """Play to the end, or until aborted. Never raises."""
        return self._scheduler.run()

    def abort(self, reason: str = "replay stopped by the user") -> None:
        """Stop; what has been played is kept in the copy."""
        self._control.abort(reason)

    def seek(self, step: int) -> None:
        """Go on fast to a step of the plan (counted as in :attr:`RunStatus.step`), then at the chosen speed, or pause.

        Everything on the way is played, since what is shown at a step is made of all that came before; a step that has
        been played already is reached by a new player only.
        """
        self._sought = step
        if self.status().step < step:
            self.clock.hurry()

    def status(self) -> RunStatus:
        """The present status, as in a collect."""
        return self._scheduler.status()

    def _make_devices(
        self, rig: Rig, path: Path, operator: Prompts, control: Control, kinds: Sequence[str]
    ) -> DeviceSet:
        made = playback_devices(self._tape, self.clock, rig, control, kinds)
        self._control.devices = made
        return made

    def _answer_prompts(self) -> None:
        for ticket, _ in self._scheduler.prompts.open():
            self._scheduler.prompts.answer(ticket)

    def _on_change(self) -> None:
        """Pause where the recording was paused, and go on at once."""
        status, incident = self._scheduler.status(), self._tape.incident
        if status.step >= self._sought:
            self.clock.calm()
        if status.state is RunState.PAUSED and self._control.pausing:
            if self._tape.played_out and not self._tape.finished:
                self._control.abort(self._session.reason)  # it ended in this pause
            else:
                self._control.resume()
        elif isinstance(incident, Pause) and not incident.inside:
            begins = status.state is RunState.PREPARING and incident.step == 0
            if begins or (status.state is RunState.RUNNING and status.step == incident.step - 1):
                self._pause()

    def _on_event(self, event: Event) -> None:
        """A lost device is back; a pause asked for meanwhile comes right after the return to the checkpoint."""
        if event.kind == "back":
            self._tape.recovering = False
        incident = self._tape.incident
        if not isinstance(incident, Pause) or incident.inside:
            return
        if event.kind == "resumed" and incident.step == rewound_to(event.text):
            self._pause()

    def _pause(self) -> None:
        self._tape.take_incident()
        self._control.pause()

    def _before_flush(self) -> None:
        """A device that was lost while a checkpoint was saved is lost there again."""
        incident, status = self._tape.incident, self._scheduler.status()
        if (
            isinstance(incident, Loss)
            and status.state is RunState.RUNNING
            and status.step == incident.step
            and isinstance(self._steps[incident.step], Checkpoint)
        ):
            with contextlib.suppress(Exception):
                self._tape.ask(incident.kind)
            self._control.lose()


class _Watching:
    """A viewer whose verdict does not end the replay: the recording says how it went on."""

    fatal: str | None = None

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer

    def offer(self, record: Record) -> None:
        """Take a record."""
        self._viewer.offer(record)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""
        return self._viewer.warnings


def replay(
    session: Path | str,
    output: Path | str,
    *,
    speed: float = FASTEST,
    viewer: Viewer | None = None,
    on_status: Callable[[RunStatus], None] = lambda status: None,
) -> ReplayResult:
    """Replay a session into a copy and compare the two. Ctrl-C ends it cleanly.

    Args:
        session: the session to replay.
        output: the copy; must not exist.
        speed: how many times as fast as recorded; as fast as possible by default.
        viewer: as in :class:`Player`.
        on_status: called some times a second.

    Raises:
        PolfuseError: the session cannot be replayed, or the copy cannot be begun.
    """
    with Player(session, output, speed=speed, viewer=viewer) as player:
        outcome = _in_a_thread(player, on_status)
    if outcome.session is None:
        raise PolfuseError(f"the replay could not begin ({outcome.reason})", where=str(output), advice="see above")
    differences = compare_sessions(session, outcome.session)
    return ReplayResult(outcome.session, tuple(differences), outcome.seconds, outcome.state, outcome.reason)


def _in_a_thread(player: Player, on_status: Callable[[RunStatus], None]) -> Outcome:
    outcomes: list[Outcome] = []
    thread = threading.Thread(target=lambda: outcomes.append(player.run()), name="replay", daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(POLL_S)
            on_status(player.status())
    except BaseException:
        player.abort()
        thread.join()
        raise
    return outcomes[0]


def _watched_name(path: Path) -> Path:
    """A name beside the session that is free; nothing is written there."""
    number = 1
    while (name := path.with_name(f"{path.stem}-watched-{number}{path.suffix}")).exists():
        number += 1
    return name
