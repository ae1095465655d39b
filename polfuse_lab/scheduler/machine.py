"""The scheduler: a small state machine that carries out a plan's steps. Only it touches devices."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.errors import DeviceError
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan
from polfuse_lab.plans.costs import largest_record_frames
from polfuse_lab.plans.dry_run import DryRun, dry_run, step_seconds
from polfuse_lab.plans.step_json import steps_to_plain
from polfuse_lab.plans.steps import Checkpoint, Step
from polfuse_lab.plans.storage import storage_choice
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.actions import Actions
from polfuse_lab.scheduler.clock_watch import ClockWatch
from polfuse_lab.scheduler.control import Aborted, Control
from polfuse_lab.scheduler.describe import describe
from polfuse_lab.scheduler.devices import DeviceSet, in_order, make_devices
from polfuse_lab.scheduler.keeping import Keeper
from polfuse_lab.scheduler.passes import PassPaused
from polfuse_lab.scheduler.prompts import Prompts
from polfuse_lab.scheduler.recovery import Recovery
from polfuse_lab.scheduler.seams import DeviceMaker, Recorder, Viewer
from polfuse_lab.scheduler.status import Outcome, RunState, RunStatus
from polfuse_lab.session.layout import STEPS, SessionConfig
from polfuse_lab.session.naming import check_free_name, partial_path
from processing.errors import DataError


class Scheduler:
    """One run of one plan on one rig.

    :meth:`run` blocks until the run has ended; :attr:`control`, :attr:`prompts`, :meth:`status` and :meth:`note` may be
    used from other threads meanwhile.
    """

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        output: Path,
        recorder: Recorder,
        *,
        rig_path: Path = Path("rig"),
        rig_toml: str | None = None,
        plan_toml: str | None = None,
        viewer: Viewer | None = None,
        on_change: Callable[[], None] = lambda: None,
        control: Control | None = None,
        devices: DeviceMaker = make_devices,
    ) -> None:
        self.control = control or Control()
        self.prompts = Prompts()
        self._rig = rig
        self._plan = plan
        self._output = output
        self._recorder = recorder
        self._rig_path = rig_path
        self._texts = (rig_toml, plan_toml)
        # Whoever looks at the records looks for ranges, which there are none of in CW.
        self._viewer = None if plan.continuous_wave else viewer
        self._keeper = Keeper(recorder, self._viewer, self.control.slice, output)
        self._on_change = on_change
        self._make_devices = devices
        self._lock = threading.Lock()
        self._status = RunStatus()
        self._began = time.monotonic()
        self._recording = False
        self._unsafe: tuple[str, ...] = ()
        self._devices: DeviceSet | None = None
        self._actions: Actions | None = None
        self._clocks: ClockWatch | None = None
        self._recovery: Recovery | None = None

    def status(self) -> RunStatus:
        """The present status."""
        with self._lock:
            return self._status

    @property
    def unsafe(self) -> tuple[str, ...]:
        """Devices that did not confirm their safe state at the end, one sentence each."""
        return self._unsafe

    def note(self, text: str) -> bool:
        """Add a remark to the session; False when it comes too late, after the last record."""
        return self._keeper.note(text)

    def run(self) -> Outcome:
        """Carry out the plan. Never raises: how it ended is in the outcome."""
        self._began = time.monotonic()
        state, reason = "failed", ""
        try:
            self._enter(RunState.PREPARING, "checking the plan")
            planned = self._prepare()
            self._execute(planned.steps)
            state, reason = "finished", "all steps carried out"
        except Aborted as stop:
            state, reason = "aborted", str(stop)
        except (DeviceError, PolfuseError, DataError) as error:
            reason = str(error)
        except Exception as error:
            reason = f"{type(error).__name__}: {error}; this is a defect of the program: report it"
        return self._end(state, reason)

    def _prepare(self) -> DryRun:
        planned = dry_run(self._rig, self._plan)
        if planned.problems:
            raise PolfuseError(planned.problems[0], where="plan", advice="see 'polfuse plan'")
        check_free_name(self._output)
        self._set(steps=len(planned.steps), positions=planned.planned.positions)
        self.control.tick = self._tick
        self._enter(RunState.PREPARING, "opening the devices")
        kinds = in_order(planned.planned.devices)
        self._devices = self._make_devices(self._rig, self._rig_path, self.prompts, self.control, kinds)
        self._devices.open_all()
        self._actions = Actions(self._rig, self._plan, self._devices, self.control, self.prompts, self._keeper.keep)
        self._clocks = ClockWatch(self._devices, self._keeper.keep)
        self._recovery = Recovery(
            self._devices, self._plan, self.control, self.prompts, lambda text: self._enter(RunState.PAUSED, text)
        )
        heard: NDArray[Any] | None = None
        audio: dict[str, Any] = {"sample_rate_hz": self._rig.radar.sample_rate_hz}
        if "radar" in self._devices:
            self._enter(RunState.PREPARING, "listening to the radar")
            block = self._actions.probe()
            heard = block.samples
            audio = {
                "sample_rate_hz": block.sample_rate_hz,
                "sample_dtype": block.samples.dtype.name,
                "audio_channels": block.samples.shape[1],
                "audio_block_frames": largest_record_frames(self._rig, planned.steps, block.sample_rate_hz),
            }
        self._enter(RunState.PREPARING, "beginning the session file")
        rig_toml, plan_toml = self._texts
        config = SessionConfig(
            source="collect",
            waveform=self._rig.waveform,
            **audio,
            frame_shape=self._devices.camera.shape if "camera" in self._devices else None,
            frame_dtype=self._rig.camera.counts_dtype if self._rig.camera is not None else "uint16",
            rig_toml=rig_toml,
            plan_toml=plan_toml,
            identities=self._devices.identities,
            extra={STEPS: steps_to_plain(planned.steps)},
            storage=self._storage(planned, heard),
        )
        self.control.check()
        self._recorder.open(config, expected_bytes=planned.bytes)
        self._recording = True
        return planned

    def _storage(self, planned: DryRun, heard: NDArray[Any] | None) -> dict[str, Any]:
        """The filter that the rig file names, or the one that is chosen by measuring."""
        named = self._rig.storage.filter
        if named != "auto":
            return {"filter": named}
        return storage_choice(self._rig, planned.steps, self._output, audio=heard).told()

    def _execute(self, planned: tuple[Step, ...]) -> None:
        assert self._devices is not None
        assert self._actions is not None
        assert self._clocks is not None
        times = list(step_seconds(self._rig, planned))
        started, paused_s, expected_done = time.monotonic(), 0.0, 0.0
        index = checkpoint = 0
        try:
            self._clocks.now()
        except DeviceError as error:
            self._recover(error, 0)
        while index < len(planned):
            if self.control.pausing:
                before = time.monotonic()
                self._pause(f"before step {index + 1}", index)
                paused_s += time.monotonic() - before
                index = self._go_back(index, checkpoint)
            step = planned[index]
            spent = time.monotonic() - started - paused_s
            self._set(step=index, eta_s=sum(times[index:]) * _pace(spent, expected_done))
            self._enter(RunState.RUNNING, describe(step))
            before = time.monotonic()
            try:
                self._devices.failed = None
                self._actions.do(step)
                if isinstance(step, Checkpoint):
                    self._keeper.begin_flush()
            except PassPaused:
                self._pause(f"in step {index + 1}", index)
                # Also where the pass was all that has been done since the checkpoint: it is not done.
                index = self._go_back(index, checkpoint, begun=True)
                paused_s += time.monotonic() - before
                continue
            except DeviceError as error:
                before = time.monotonic()
                self._recover(error, index)
                paused_s += time.monotonic() - before
                self._actions.repeat()
                self._keeper.event("resumed", f"repeating from step {checkpoint + 1}")
                index = checkpoint
                continue
            expected_done += times[index]
            index += 1
            self._set(step=index)
            if isinstance(step, Checkpoint):
                checkpoint = index
        try:
            self._clocks.now()
        except DeviceError as error:
            # All has been recorded: a device that is lost now costs its last clock fix, not the collect.
            self._actions.warn(f"the last clock fix is missing: {error}")
        # Nor does one whose answer is still awaited.
        self._clocks.end()
        self._keeper.flush()
        self._set(eta_s=0.0)

    def _recover(self, error: DeviceError, index: int) -> None:
        """Wait for a lost device to come back; raise ``error``, or a worse one, when that is no use."""
        assert self._recovery is not None
        assert self._actions is not None
        kind = self._recovery.kind(error)
        if kind is None:
            raise error
        clocks, self._clocks = self._clocks, None  # no questions to a device that is away
        try:
            self._enter(RunState.PAUSED, f"{kind} lost: {error}")
            self._keeper.event("lost", f"{kind} in step {index + 1}: {error}")
            self._keeper.flush()
            self._keeper.event("back", self._recovery.bring_back(kind, error, self._actions.last_fix))
        finally:
            self._clocks = clocks
        if clocks is not None:
            clocks.forget()

    def _pause(self, where: str, index: int) -> None:
        # First: where a run goes on from is on the disk before anybody is told that it is safe to walk away.
        self._whatever_is_lost(self._keeper.confirm, index)
        self._keeper.event("paused", f"paused by the user {where}")
        self._whatever_is_lost(self._wait_for_resume, index)

    def _wait_for_resume(self) -> None:
        self._enter(RunState.PAUSED, "paused by the user")
        while self.control.pausing:
            self.control.slice()

    def _whatever_is_lost(self, wait: Callable[[], None], index: int) -> None:
        """Wait outside of any step; a device that is lost meanwhile is waited for as in one."""
        assert self._actions is not None
        while True:
            try:
                return wait()
            except DeviceError as error:
                self._recover(error, index)
                self._actions.repeat()

    def _go_back(self, index: int, checkpoint: int, *, begun: bool = False) -> int:
        """After a pause: where the run goes on, the last (confirmed) checkpoint; what is repeated is marked."""
        assert self._actions is not None
        if begun or index != checkpoint:
            self._actions.repeat()
            self._keeper.event("resumed", f"repeating from step {checkpoint + 1} since the collect was paused")
        return checkpoint

    def _tick(self) -> None:
        """What goes on during every wait: the writer's and the viewer's word, clock fixes, the elapsed time."""
        if self._recording:
            if self._recorder.failure is not None:
                raise self._recorder.failure
            self._keeper.drain_notes()
            if self._clocks is not None:
                self._clocks.tick()
        if self._viewer is not None and self._viewer.fatal is not None:
            raise PolfuseError(self._viewer.fatal, where="radar", advice="see 'polfuse doctor'")
        self._count()

    def _count(self) -> None:
        counts = self._actions.counts() if self._actions is not None else {}
        warnings = (self._actions.warnings if self._actions is not None else ()) + (
            self._viewer.warnings if self._viewer is not None else ()
        )
        self._set(
            elapsed_s=time.monotonic() - self._began,
            disk_free_bytes=self._recorder.free_bytes,
            warnings=warnings,
            **counts,
        )

    def _end(self, state: str, reason: str) -> Outcome:
        self.control.tick = lambda: None
        self._enter(RunState.STOPPING, reason)
        troubles = self._devices.make_safe() if self._devices is not None else []
        self._unsafe = tuple(troubles)
        session: Path | None = None
        if self._recording:
            self._recording = False
            try:
                self._keeper.finish(state, reason, troubles)
                session = self._recorder.close(state, reason)
            except PolfuseError as error:
                # What the writer says of its own end (disk full, killed) is the reason, not a consequence of it.
                state, reason = "failed", reason if error.what in reason else str(error)
                session = _left_behind(self._output)
            self._recorder.kill()
        if self._devices is not None:
            self._devices.close_all()
        self._count()
        status = self.status()
        outcome = Outcome(
            state=state,
            reason=reason,
            session=session,
            positions=self._actions.positions_done if self._actions else 0,
            sweeps=status.sweeps,
            frames=status.frames,
            samples_lost=status.samples_lost,
            frames_lost=status.frames_lost,
            sync_rms_s=self._clocks.sync_rms_s() if self._clocks else None,
            seconds=time.monotonic() - self._began,
            warnings=(*status.warnings, *troubles),
        )
        self._set(warnings=outcome.warnings)
        self._enter(RunState.FINISHED, reason)
        return outcome

    def _enter(self, state: RunState, reason: str) -> None:
        self._count()
        self._set(state=state, reason=reason)
        self._on_change()

    def _set(self, **changes: object) -> None:
        with self._lock:
            self._status = dataclasses.replace(self._status, **changes)  # type: ignore[arg-type]


def _pace(spent: float, expected: float) -> float:
    """How much slower than expected the run has been, once there is something to go by."""
    return min(max(spent / expected, 0.2), 10.0) if expected > 2.0 else 1.0


def _left_behind(output: Path) -> Path | None:
    """The session's file after its writer failed: closed under its final name, or still partial."""
    for path in (output, partial_path(output)):
        if path.is_file():
            return path
    return None
