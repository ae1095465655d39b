"""Jobs in the background: their queue lives in threads, their news come in the window's."""

from __future__ import annotations

from PySide6.QtCore import QObject, Qt, QTimer, Signal

from polfuse_lab.jobs import Job, JobQueue, JobSpec

TICK_MS = 250
OVER = ("done", "failed", "cancelled")


class JobList(QObject):
    """The window's jobs, one after another."""

    changed = Signal(object)
    """A :class:`~polfuse_lab.jobs.Job` has got on, or is over."""
    over = Signal(object)
    """A job is over, whichever way."""
    _news = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._queue: JobQueue | None = None
        self._over: set[int] = set()
        self._news.connect(self._take, Qt.ConnectionType.QueuedConnection)
        self._timer = QTimer(self)
        self._timer.setInterval(TICK_MS)
        self._timer.timeout.connect(self._tick)

    @property
    def jobs(self) -> list[Job]:
        """All of this window, oldest first."""
        return [] if self._queue is None else list(self._queue.jobs)

    @property
    def busy(self) -> bool:
        """Whether one waits or runs."""
        return any(job.state not in OVER for job in self.jobs)

    def submit(self, spec: JobSpec) -> Job:
        """Begin a job, after those that wait."""
        if self._queue is None:
            self._queue = JobQueue(at_once=1)
            self._queue.on_change(self._news.emit)
        job = self._queue.submit(spec)
        self._timer.start()
        self.changed.emit(job)
        return job

    def close(self) -> None:
        """The window closes: what runs is cancelled and leaves nothing half done."""
        self._timer.stop()
        if self._queue is not None:
            self._queue.close()
            self._queue = None

    def _take(self, job: Job) -> None:
        self.changed.emit(job)
        if job.state in OVER and id(job) not in self._over:
            self._over.add(id(job))
            self.over.emit(job)

    def _tick(self) -> None:
        for job in self.jobs:
            if job.state == "running":
                self.changed.emit(job)
        if not self.busy:
            self._timer.stop()
