"""A whole collect to be disturbed: its devices, client, log and folder; for campaigns of kills and of full disks."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from pathlib import Path

from benchmarks.kill_log import Line, TapLog, phase_of
from benchmarks.kill_plugin import SHAPE, install
from benchmarks.kill_processes import alive_in, gone
from hw_mocks.grbl import start_grbl
from hw_mocks.rotator import start_rotator
from hw_mocks.switch_box import start_switch_box
from hw_mocks.world import World
from polfuse_lab.engine import EngineClient, Finished
from polfuse_lab.errors import PolfuseError

LIMIT_S = 60.0
"""A collect that has not ended by then hangs."""
GONE_S = 20.0
"""All processes end within this time after the blow (or the collect's end)."""
ROOT = Path(__file__).resolve().parent.parent

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.02
sweep_period_s = 0.04
[geometry]
antenna_height_m = 1.069
[radar]
driver = "counting"
options = {{log = "{log}"}}
[switches]
driver = "dowkey_ms"
settle_s = 0.01
options = {{port = "{switches}", settle_s = 0.01, cycles_folder = "{folder}"}}
[trolley]
driver = "grbl"
length_m = 3.2
speed_m_s = 0.5
options = {{port = "{trolley}", length_m = 3.2, feed_m_s = 0.5}}
[camera]
driver = "numbered"
height_px = {rows}
width_px = {columns}
exposure_s = 0.02
focal_length_m = 0.008
pixel_pitch_m = 8e-6
options = {{log = "{log}"}}
[polarizer]
driver = "ell14"
options = {{port = "{polarizer}", home_at_open = false}}
"""
PLAN = """\
aperture_m = 0.6
step_m = 0.1
sweeps_per_channel = 2
move_settle_s = 0.0
channels = ["HH", "VV"]
[optics]
frames_per_angle = 2
settle_s = 0.0
"""
AIMS: dict[str, tuple[str, int, float]] = {
    "preparing": ("preparing", 1, 1.0),
    "moving": ("moving", 7, 0.25),
    "recording": ("recording", 14, 0.1),
    "optics": ("optics", 8, 0.06),
    "flushing": ("asking", 7, 0.01),
    "closing": ("closing", 1, 0.12),
    "any": ("preparing", 1, 4.0),
}
"""Where a blow can be aimed: the phase, how often it comes, and how long after its begin the blow may fall, s."""


@contextlib.contextmanager
def trial_folder(*, defect: str = "") -> Iterator[Path]:
    """A folder of its own, with the plug-in's devices; changes this process's environment meanwhile, and removes it.

    Args:
        defect: a line of Python for the writer's process, see :func:`benchmarks.kill_plugin.install`.
    """
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="polfuse-kill-", dir=memory))
    before = dict(os.environ)
    # This process's own; it would count as one of the trial's if it were started later.
    resource_tracker.ensure_running()
    site = folder / "site"
    try:
        for made in (site, folder / "run", folder / "data"):
            made.mkdir(mode=0o700)
        install(site, defect=defect)
        os.environ |= {
            "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)]),
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "POLFUSE_USER_DATA": str(folder / "data"),
        }
        sys.path.insert(0, str(site))  # the client looks the drivers up as well
        yield folder
    finally:
        sys.path[:] = [path for path in sys.path if path != str(site)]
        os.environ.clear()
        os.environ.update(before)
        kill_all(folder)
        shutil.rmtree(folder, ignore_errors=True)


def kill_all(folder: Path) -> None:
    """End every process of a folder."""
    for pid in alive_in(folder):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def until(ready: Callable[[], object], end_s: float) -> bool:
    """Wait until something is so; False when it is not by ``end_s`` (monotonic)."""
    while not ready():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.01)
    return True


class CollectStand:
    """The devices of one collect, and the collect itself once :meth:`start` is called. Use it with ``with``."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.world = World()
        self.log = TapLog(folder / "tap")
        self.rig, self.plan = folder / "rig.toml", folder / "plan.toml"
        self.finished: Finished | None = None
        self.error: PolfuseError | None = None
        self.ended = threading.Event()
        self._client = threading.Thread()
        self._closing = contextlib.ExitStack()

    def __enter__(self) -> CollectStand:
        switches = self._closing.enter_context(start_switch_box(self.world, actuation_s=0.005))
        trolley = self._closing.enter_context(start_grbl(self.world, length_m=3.2))
        polarizer = self._closing.enter_context(start_rotator(self.world))
        rig = RIG.format(
            log=self.folder / "tap", switches=switches.url, trolley=trolley.url, polarizer=polarizer.url,
            folder=self.folder / "data", rows=SHAPE[0], columns=SHAPE[1],
        )  # fmt: skip
        self.rig.write_text(rig)
        self.plan.write_text(PLAN)
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()
        self.log.close()

    def start(self, session: Path, *, continues: Path | None = None) -> None:
        """Begin to collect; :attr:`ended` is set when the client has returned."""
        self.finished, self.error = None, None
        self.ended.clear()
        self._client = threading.Thread(target=self._collect, args=(session, continues), name="client", daemon=True)
        self._client.start()

    def _collect(self, session: Path, continues: Path | None) -> None:
        try:
            with EngineClient.start(self.rig, self.plan, session, continues=continues) as client:
                self.finished = client.wait()
        except PolfuseError as error:
            self.error = error
        finally:
            self.ended.set()

    @property
    def outcome(self) -> str:
        """How the client says that it ended."""
        return f"error: {self.error}" if self.finished is None else f"{self.finished.state}: {self.finished.reason}"

    def wait_for_phase(self, phase: str, count: int) -> bool:
        """Wait until something has come for the ``count``-th time: a phase of :data:`AIMS`."""
        name = AIMS[phase][0]

        def wanted(line: Line) -> bool:
            if name == "asking":
                return bool(line.kind == "asking" and line.words[0])
            return line.kind == "phase" and phase_of(*line.words) == name

        return self.log.wait_for(wanted, count, LIMIT_S)

    def safe(self) -> bool:
        """Whether the switches are at HH and the trolley stands."""
        x_m = self.world.trolley_x_m.at()
        time.sleep(0.02)
        return self.world.transmit.at() + self.world.receive.at() == "HH" and self.world.trolley_x_m.at() == x_m

    def wait_for_peace(self) -> list[str]:
        """Wait until the collect has ended, the devices are safe and no process is left; what of it did not come."""
        problems = []
        if not self.ended.wait(LIMIT_S):
            problems.append(f"the collect did not end within {LIMIT_S:g} s")
            kill_all(self.folder)
        end = time.monotonic() + GONE_S
        if not until(self.safe, end):
            route = self.world.transmit.at() + self.world.receive.at()
            problems.append(f"devices not safe: route {route}, trolley at {self.world.trolley_x_m.at():.3f} m")
        if not until(lambda: gone(self.folder), end):
            problems.append(f"processes left: {sorted(set(alive_in(self.folder).values()))}")
            kill_all(self.folder)
        if not self.safe():
            problems.append("devices did not stay safe")
        self._client.join(5)
        return problems

    def leftovers(self, sessions: Path, expected: set[str]) -> list[str]:
        """Files of the run, shared memory and files beside the sessions that nobody needs any more."""
        problems = [
            f"left behind: {path.relative_to(self.folder)}"
            for path in (self.folder / "run").rglob("*")
            if path.name != "polfuse-lab"
        ]
        for line in self.log.lines("memory"):
            block = Path("/dev/shm", line.words[0].lstrip("/"))
            if block.exists():
                problems.append(f"left behind: shared memory {block.name}")
                block.unlink(missing_ok=True)
        extra = sorted(path.name for path in sessions.iterdir() if path.name not in expected)
        if extra:
            problems.append(f"left behind in the session's folder: {', '.join(extra)}")
        return problems
