"""What works in the background: how far it is, how long it takes, and a way to stop it."""

from __future__ import annotations

import sys

from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QProgressBar, QWidget

from gui.models.job_list import OVER, JobList
from gui.models.words import duration
from gui.widgets.layout import button
from polfuse_lab.jobs import Job


class JobBar(QFrame):
    """The job that runs; hidden while there is none."""

    def __init__(self, jobs: JobList, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("role", "card")
        self._jobs = jobs
        self._job: Job | None = None
        self.words = QLabel()
        self.bar = QProgressBar()
        self.cancel_button = button(self.tr("Cancel"), self._cancel, self.tr("Stop it; nothing half done is left"))
        row = QHBoxLayout(self)
        row.addWidget(self.words, 2)
        row.addWidget(self.bar, 3)
        row.addWidget(self.cancel_button)
        jobs.changed.connect(self._show)
        self.hide()

    def _show(self, job: Job) -> None:
        if job.state in OVER:
            if job is self._job:
                self._job = None
                following = next((other for other in self._jobs.jobs if other.state not in OVER), None)
                self.setVisible(following is not None)
            return
        if job.state == "waiting" and self._job is not None:
            return
        self._job = job
        progress = job.progress
        waiting = sum(other.state == "waiting" for other in self._jobs.jobs)
        more = self.tr("  (+{0} waiting)").format(waiting) if waiting else ""
        eta = self.tr(", {0} to go").format(duration(progress.eta_s)) if progress.eta_s is not None else ""
        self.words.setText(f"{progress.words}{eta}{more}")
        if progress.fraction is None:
            self.bar.setRange(0, 0)
        else:
            self.bar.setRange(0, 1000)
            self.bar.setValue(round(1000 * progress.fraction))
        self.show()

    def _cancel(self) -> None:
        if self._job is not None:
            self._job.cancel()


def _demo() -> QWidget:
    from polfuse_lab.jobs import JobSpec, Progress

    jobs = JobList()
    bar = JobBar(jobs)
    jobs.setParent(bar)
    told = Progress(0.4, "back-projection of HV", 37.0, 24.0)
    jobs.changed.emit(Job(JobSpec("focus", "Focus field.h5", ()), 1, "running", told))
    return bar


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 760, 80))
