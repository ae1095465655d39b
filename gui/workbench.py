"""What all pages share: the collect, the set-up, jobs, settings, what is open, and where errors are told."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from PySide6.QtCore import QObject, Signal

import polfuse_lab
from gui.models import background
from gui.models.bench_link import BenchLink
from gui.models.engine_link import EngineLink
from gui.models.job_list import JobList
from gui.models.live_link import LiveLink
from polfuse_lab.engine import ReplayClient
from polfuse_lab.plans import Plan


class Workbench(QObject):
    """One for each window; pages get it and speak to each other through it only."""

    error = Signal(str, str)
    """One sentence for the user, and the details."""
    told = Signal(str, object)
    """Something has been done, in one sentence; and the path of what has been made, None: nothing to open."""
    rig_changed = Signal(object)
    """Path of the rig that is worked with, None: none."""
    session_opened = Signal(object)
    """Path of a session to look at."""
    products_opened = Signal(object)
    """Path of a products file to look at."""
    products_changed = Signal()
    """The products that are looked at hold more than before."""
    page_wanted = Signal(str)
    """Name of the page that should be shown."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.engine = EngineLink(self)
        self.live = LiveLink(self)
        self.jobs = JobList(self)
        self.before_collect: Callable[[], BenchLink | None] = lambda: None
        """Set-up mode, when it holds the devices."""
        self.replay_speed = 1.0
        """How fast the last replay goes."""
        self._played: Path | None = None
        self.rig: Path | None = None
        self.simulated: Path | None = None
        """The simulated rig, which goes with the window and is not to be remembered."""
        self.session: Path | None = None
        self.products: Path | None = None
        self.engine.failed.connect(self.error)
        self.engine.attached.connect(lambda client: self.live.open(client.live()))

    def use_rig(self, path: Path | None) -> None:
        """Work with this rig from now on."""
        self.rig = path
        self.rig_changed.emit(path)

    def open_session(self, path: Path) -> None:
        """Look at a session."""
        self.session = path
        self.session_opened.emit(path)

    def open_products(self, path: Path) -> None:
        """Look at products."""
        self.products = path
        self.products_opened.emit(path)

    def begin_collect(self, plan: Plan, output: Path) -> None:
        """Begin a collect on the rig that is worked with."""
        if self.rig is None:
            return
        setup = self.before_collect()
        if setup is None:
            self.engine.start(self.rig, plan, output)
        else:
            self.engine.starting = True
            setup.hand_over(plan, output, self.engine.adopt, self.engine.not_started)

    def play(self, session: Path, speed: float, step: int = 0) -> None:
        """Play a session in the live view, fast until a step."""
        if self.engine.busy:
            self.error.emit(self.tr("a run is being watched already: wait for its end, or stop it"), "")
            return
        self.engine.starting = True
        self.replay_speed = speed
        self._played = session

        def play() -> ReplayClient:
            client = ReplayClient.play(session, speed=speed)
            if step > 0:
                client.seek(step)
            return client

        background.run(self, play, self.engine.adopt, self.engine.not_started)
        self.page_wanted.emit("live")

    def set_replay_speed(self, speed: float) -> None:
        """Play so many times as fast as recorded from now on."""
        self.replay_speed = speed
        self.engine.set_speed(speed)

    def seek(self, step: int, shown: int) -> None:
        """Show another step of the session that is played, of which ``shown`` is shown now.

        What is shown at a step is made of all that came before it: going back begins anew.
        """
        if step >= shown:
            self.engine.seek(step)
        elif self._played is not None and self.engine.client is not None and self.engine.replaying:
            self.engine.abort()
            self.engine.leave()
            self.play(self._played, self.replay_speed, step)

    def provenance(self) -> dict[str, object]:
        """What a saved view says about where it comes from."""
        client = self.engine.client
        return {
            "program": f"PolFuse Lab {polfuse_lab.__version__}",
            "saved": datetime.now().astimezone().isoformat(timespec="seconds"),
            "rig": str(self.rig or ""),
            "engine": str(client.directory) if client is not None else "",
            "session": str(self.session or ""),
            "products": str(self.products or ""),
        }

    def close(self) -> None:
        """The window closes: nothing that runs elsewhere is ended."""
        self.live.close()
        self.jobs.close()
        self.engine.leave()
