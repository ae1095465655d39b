"""Jobs one after another (or some at once), each in a process of its own. Thread-safe; no call waits for a job."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from polfuse_lab.errors import PolfuseError
from polfuse_lab.jobs.expected import expected_s, input_bytes, learn
from polfuse_lab.jobs.scratch import Scratch
from polfuse_lab.jobs.specs import JobSpec

State = Literal["waiting", "running", "done", "failed", "cancelled"]
LOG_LINES = 400
TOLD_S = 0.2
"""Progress is told so often, s."""
NEARLY = 0.9
"""Of an expected time; what takes longer than expected comes no nearer to its end than this and a little."""


@dataclass(frozen=True)
class Progress:
    """How far a job is."""

    fraction: float | None = None
    """0 to 1; None where nothing tells it."""
    words: str = ""
    """What it does now."""
    eta_s: float | None = None
    """Seconds that the rest will take; None where nothing tells it."""
    elapsed_s: float = 0.0
    estimated: bool = False
    """Whether the fraction is by the time that such jobs take, and not counted."""


@dataclass
class Job:
    """A job. Everything may be read from any thread at any time; only the queue changes it."""

    spec: JobSpec
    number: int
    """Counts the queue's jobs from 1."""
    state: State = "waiting"
    progress: Progress = field(default_factory=Progress)
    result: dict[str, Any] | None = None
    """The command's JSON, once it is done."""
    paths: tuple[Path, ...] = ()
    """Files that it made or changed."""
    error: str = ""
    """Why it failed, one sentence."""
    details: str = ""
    """Everything that it said, for whoever wants to know more."""
    _cancel: Callable[[Job], None] = field(default=lambda job: None, repr=False)

    def cancel(self) -> None:
        """End it; over within a second, with nothing left of it. Nothing happens to a job that is over."""
        self._cancel(self)

    @property
    def over(self) -> bool:
        """Whether it is done, failed or cancelled."""
        return self.state in ("done", "failed", "cancelled")


class JobQueue:
    """Carries jobs out in the order in which they are submitted.

    Args:
        at_once: how many run at the same time.
    """

    def __init__(self, at_once: int = 1) -> None:
        self._numbers = itertools.count(1)
        self._jobs: list[Job] = []
        self._waiting: deque[Job] = deque()
        self._listeners: list[Callable[[Job], None]] = []
        self._processes: dict[int, subprocess.Popen[bytes]] = {}
        self._condition = threading.Condition()
        self._closed = False
        self._threads = [
            threading.Thread(target=self._work, name=f"jobs {number}", daemon=True) for number in range(at_once)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def jobs(self) -> tuple[Job, ...]:
        """All jobs, the oldest first."""
        with self._condition:
            return tuple(self._jobs)

    def on_change(self, listener: Callable[[Job], None]) -> None:
        """Have a function called with each job that has changed, from a thread of the queue."""
        self._listeners.append(listener)

    def submit(self, spec: JobSpec) -> Job:
        """Queue a job; returns at once. Raises :class:`PolfuseError` when the queue is closed."""
        job = Job(spec, next(self._numbers), _cancel=self._cancel)
        with self._condition:
            if self._closed:
                raise PolfuseError("takes no jobs any more", where="job queue", advice="start the program again")
            self._jobs.append(job)
            self._waiting.append(job)
            self._condition.notify()
        self._tell(job)
        return job

    def forget(self, job: Job) -> None:
        """Take a job that is over off the list."""
        with self._condition:
            if job.over and job in self._jobs:
                self._jobs.remove(job)

    def close(self) -> None:
        """Cancel all jobs and end. Takes a second at most; idempotent."""
        with self._condition:
            self._closed = True
            jobs = list(self._jobs)
            self._condition.notify_all()
        for job in jobs:
            self._cancel(job)
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(5)

    def _cancel(self, job: Job) -> None:
        with self._condition:
            process = self._processes.get(job.number)
            if job.over or (job.state == "running" and process is None):
                return  # what it has made is being put into its place
            if job in self._waiting:
                self._waiting.remove(job)
            job.state = "cancelled"
        if process is not None:
            _kill(process)
        self._tell(job)

    def _work(self) -> None:
        while True:
            with self._condition:
                while not self._waiting and not self._closed:
                    self._condition.wait()
                if not self._waiting:
                    return
                job = self._waiting.popleft()
            try:
                self._run(job)
            except PolfuseError as error:
                self._over(job, "failed", error=str(error))
            except Exception as error:
                text = f"{type(error).__name__}: {error}; this is a defect of the program: report it"
                self._over(job, "failed", error=text)

    def _run(self, job: Job) -> None:
        scratch = Scratch(job.spec)
        try:
            begun = time.monotonic()
            with self._condition:
                if _cancelled(job):
                    return
                process = subprocess.Popen(
                    [sys.executable, "-m", "polfuse_lab.jobs.runner", *scratch.words],
                    # Held open: it ends with this process.
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    start_new_session=True,
                )
                self._processes[job.number] = process
                job.state = "running"
            size = input_bytes(job.spec.inputs)
            watch = _Watch(job, begun, expected_s(job.spec.kind, size), lambda: self._tell(job))
            log = watch.follow(process)
            with self._condition:
                self._processes.pop(job.number, None)
                if _cancelled(job):
                    return
            details = "\n".join(scratch.told(line) for line in log)
            if process.returncode != 0 or watch.result is None:
                error = scratch.told(_sentence(log, process.returncode))
                self._over(job, "failed", error=error, details=details)
                return
            result = scratch.told(watch.result)
            paths = scratch.adopt()
            learn(job.spec.kind, size, time.monotonic() - begun)
            job.result, job.paths = result, tuple(paths)
            self._over(job, "done", details=details)
        finally:
            scratch.discard()

    def _over(self, job: Job, state: State, *, error: str = "", details: str = "") -> None:
        with self._condition:
            if _cancelled(job):
                return
            job.error, job.details = error, details or error
            elapsed_s = job.progress.elapsed_s
            words = "done" if state == "done" else error
            job.progress = Progress(1.0 if state == "done" else None, words, 0.0, elapsed_s)
            job.state = state
        self._tell(job)

    def _tell(self, job: Job) -> None:
        for listener in list(self._listeners):
            with contextlib.suppress(Exception):
                listener(job)


class _Watch:
    """Follows the process of one job."""

    def __init__(self, job: Job, begun: float, expected: float | None, tell: Callable[[], None]) -> None:
        self._job, self._begun, self._expected, self._tell = job, begun, expected, tell
        self._words = "starting"
        self._counted: tuple[float, float | None, float] | None = None
        self.result: dict[str, Any] | None = None

    def follow(self, process: subprocess.Popen[bytes]) -> list[str]:
        """Until it ends; what it said on standard error."""
        log: deque[str] = deque(maxlen=LOG_LINES)
        assert process.stderr is not None
        assert process.stdout is not None
        errors, out = process.stderr, process.stdout

        def keep() -> None:
            for line in errors:
                log.append(line.decode(errors="replace").rstrip())

        def hear() -> None:
            for line in out:
                self._hear(line)

        readers = [threading.Thread(target=work, name="job reader", daemon=True) for work in (keep, hear)]
        for reader in readers:
            reader.start()
        while process.poll() is None:
            self._update()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(TOLD_S)
        for reader in readers:
            # A child of the job that lives on may hold the pipe: what it says is not waited for.
            reader.join(0.5)
        for stream, reader in ((errors, readers[0]), (out, readers[1])):
            if not reader.is_alive():
                stream.close()
        if process.stdin is not None:
            process.stdin.close()
        return list(log)

    def _hear(self, line: bytes) -> None:
        try:
            told = json.loads(line)
        except ValueError:
            return
        if not isinstance(told, dict):
            return
        if isinstance(told.get("result"), dict):
            self.result = told["result"]
        elif "told" in told:
            self._words = str(told["told"])
            if isinstance(told.get("fraction"), int | float):
                left = told.get("left_s")
                self._counted = float(told["fraction"]), left, time.monotonic()

    def _update(self) -> None:
        now = time.monotonic()
        elapsed = now - self._begun
        fraction, eta, estimated = None, None, False
        if self._counted is not None:
            fraction, left, at = self._counted
            eta = None if left is None else max(left - (now - at), 0.0)
        elif self._expected is not None:
            share = elapsed / max(self._expected, 0.1)
            fraction = share if share < NEARLY else NEARLY + (0.99 - NEARLY) * (1 - math.exp(NEARLY - share))
            eta, estimated = max(self._expected - elapsed, 0.0) or None, True
        self._job.progress = Progress(fraction, self._words, eta, elapsed, estimated)
        self._tell()


def _cancelled(job: Job) -> bool:
    # Another thread may have cancelled it since it was looked at last.
    return job.state == "cancelled"


def _sentence(log: list[str], status: int) -> str:
    """Why a command failed, in its own words."""
    for line in reversed(log):
        for begin in ("error: ", "Error: "):
            if line.startswith(begin):
                return line.removeprefix(begin)
    how = f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"
    return f"the job {how} without saying why; see the details"


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and all that it has started."""
    with contextlib.suppress(OSError):
        if os.name == "posix":
            # It leads a group of its own.
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
