"""The scheduler: carries out plans, and is the only one that touches devices."""

from polfuse_lab.scheduler.control import Aborted, Control
from polfuse_lab.scheduler.machine import Scheduler
from polfuse_lab.scheduler.seams import Recorder, Viewer
from polfuse_lab.scheduler.status import Outcome, RunState, RunStatus

__all__ = ["Aborted", "Control", "Outcome", "Recorder", "RunState", "RunStatus", "Scheduler", "Viewer"]
