"""Long work in the background: each job is a command of ``polfuse`` in a process of its own, with progress and cancel.

::

    queue = JobQueue()
    job = queue.submit(focus("run.h5", "products.h5", tolerance_db=-60))
    job.progress.words, job.progress.fraction, job.progress.eta_s
    job.cancel()                       # over within a second, and nothing half is left
    job.state, job.result, job.paths, job.error
"""

from polfuse_lab.jobs.prediction import Prediction, predict_focus
from polfuse_lab.jobs.queue import Job, JobQueue, Progress
from polfuse_lab.jobs.specs import (
    JobSpec,
    calibrate,
    command,
    decompose,
    export,
    focus,
    fuse,
    optics,
    range_,
    replay,
    report,
)

__all__ = [
    "Job",
    "JobQueue",
    "JobSpec",
    "Prediction",
    "Progress",
    "calibrate",
    "command",
    "decompose",
    "export",
    "focus",
    "fuse",
    "optics",
    "predict_focus",
    "range_",
    "replay",
    "report",
]
