"""One trial of the kill campaign: a collect, one blow at one of its processes, and what was left."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.kill_check import compare
from benchmarks.kill_log import TapLog, phase_of
from benchmarks.kill_plugin import SHAPE, install
from benchmarks.kill_processes import alive_in, find, gone
from hw_mocks.grbl import start_grbl
from hw_mocks.rotator import start_rotator
from hw_mocks.switch_box import start_switch_box
from hw_mocks.world import World
from polfuse_lab.engine import EngineClient, Finished
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session.recovery import recover
from polfuse_lab.session.space import ballast_path

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


@dataclass(frozen=True)
class Case:
    """A blow: ``kill`` (SIGKILL), ``term`` (SIGTERM) or ``stop`` (SIGSTOP, then SIGCONT)."""

    seed: int
    process: str
    """``engine``, ``writer``, ``camera``, ``guard`` or ``recover``."""
    phase: str
    """Of :data:`AIMS`, or ``starting``."""
    blow: str = "kill"
    early_answers: bool = False
    """With a defect: a writer that answers a flush without having made it."""


@dataclass
class Trial:
    """What came of a case."""

    case: Case
    phase: str = ""
    """What the engine was really at when the blow fell."""
    outcome: str = ""
    how: str = ""
    """How the file came to be: ``closed``, ``recovered`` or ``none``."""
    delivered: int = 0
    confirmed: int = 0
    lost: int = 0
    """Delivered audio blocks and frames that are not in the file."""
    lost_s: float = 0.0
    """Age of the oldest of them when the blow fell, s."""
    lost_positions: int = 0
    seconds: float = 0.0
    safe_s: float = 0.0
    """From the blow until the switches were at HH and the trolley stood, s."""
    problems: list[str] = field(default_factory=list)


def run_trial(case: Case) -> Trial:
    """Carry out one case in a folder of its own, which is removed. Changes this process's environment meanwhile."""
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    folder = Path(tempfile.mkdtemp(prefix="polfuse-kill-", dir=memory))
    began = time.monotonic()
    before = dict(os.environ)
    try:
        site = folder / "site"
        for made in (site, folder / "run", folder / "data"):
            made.mkdir(mode=0o700)
        install(site, early_answers=case.early_answers)
        os.environ |= {
            "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)]),
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "POLFUSE_USER_DATA": str(folder / "data"),
        }
        sys.path.insert(0, str(site))  # the client looks the drivers up as well
        trial = _Collect(case, folder).run()
    finally:
        sys.path[:] = [path for path in sys.path if path != str(folder / "site")]
        os.environ.clear()
        os.environ.update(before)
        for pid in alive_in(folder):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        shutil.rmtree(folder, ignore_errors=True)
    trial.seconds = time.monotonic() - began
    return trial


class _Collect:
    """A collect in a folder, and the blow."""

    def __init__(self, case: Case, folder: Path) -> None:
        self.case, self.folder = case, folder
        self.chance = random.Random(case.seed)
        self.trial = Trial(case)
        self.session = folder / "sessions" / "s.h5"
        self.session.parent.mkdir()
        self.world = World()
        self.log = TapLog(folder / "tap")
        self.ended = threading.Event()
        self.finished: Finished | None = None
        self.error: PolfuseError | None = None
        self.struck_ns = 0

    def run(self) -> Trial:
        """The collect from start to end, and all checks."""
        world, trial = self.world, self.trial
        with (
            start_switch_box(world, actuation_s=0.005) as switches,
            start_grbl(world, length_m=3.2) as trolley,
            start_rotator(world) as polarizer,
        ):
            rig = RIG.format(
                log=self.folder / "tap", switches=switches.url, trolley=trolley.url, polarizer=polarizer.url,
                folder=self.folder / "data", rows=SHAPE[0], columns=SHAPE[1],
            )  # fmt: skip
            (self.folder / "rig.toml").write_text(rig)
            (self.folder / "plan.toml").write_text(PLAN)
            client = threading.Thread(target=self._client, name="client", daemon=True)
            client.start()
            self._aim()
            if not self.struck_ns:
                trial.problems.append(f"the {self.case.process} was not there to be struck")
                self.struck_ns = time.monotonic_ns()
            if not self.ended.wait(LIMIT_S):
                trial.problems.append(f"the collect did not end within {LIMIT_S:g} s")
                self._kill_all()
            self._wait_for_peace()
        client.join(5)
        trial.phase = "recover" if self.case.process == "recover" else self.log.phase_at(self.struck_ns)
        self._look_at_outcome()
        self._look_at_file()
        self._look_for_leftovers()
        self.log.close()
        return trial

    def _client(self) -> None:
        try:
            rig, plan = self.folder / "rig.toml", self.folder / "plan.toml"
            with EngineClient.start(rig, plan, self.session) as client:
                self.finished = client.wait()
        except PolfuseError as error:
            self.error = error
        finally:
            self.ended.set()

    def _aim(self) -> None:
        case = self.case
        if case.phase == "starting":
            time.sleep(self.chance.uniform(0.0, 1.5))
        else:
            name, times, spread_s = AIMS[case.phase]
            count = self.chance.randint(1, times)
            self.log.wait_for(
                lambda line: (
                    line.kind == "asking" and line.words[0]
                    if name == "asking"
                    else line.kind == "phase" and phase_of(*line.words) == name
                ),
                count,
                LIMIT_S,
            )
            end = time.monotonic() + self.chance.uniform(0.0, spread_s)
        role = "writer" if case.process == "recover" else case.process
        pid = find(self.folder, role)
        give_up = time.monotonic() + 10.0
        while pid is None and time.monotonic() < give_up and not self.ended.is_set():
            time.sleep(0.002)
            pid = find(self.folder, role)
        if pid is None:
            return
        if case.phase != "starting":
            time.sleep(max(end - time.monotonic(), 0.0))
        with contextlib.suppress(ProcessLookupError):
            match case.blow:
                case "kill":
                    os.kill(pid, signal.SIGKILL)
                case "term":
                    os.kill(pid, signal.SIGTERM)
                case _:
                    os.kill(pid, signal.SIGSTOP)
            self.struck_ns = time.monotonic_ns()
            if case.blow == "stop":
                time.sleep(self.chance.choice((0.05, 0.3, 0.8, 2.5)))
                os.kill(pid, signal.SIGCONT)

    def _wait_for_peace(self) -> None:
        """Until the devices are safe and no process is left."""
        trial = self.trial
        end = time.monotonic() + GONE_S
        if not _until(self._safe, end):
            route = self.world.transmit.at() + self.world.receive.at()
            trial.problems.append(f"devices not safe: route {route}, trolley moving or route not HH")
        trial.safe_s = (time.monotonic_ns() - self.struck_ns) * 1e-9
        if not _until(lambda: gone(self.folder), end):
            trial.problems.append(f"processes left: {sorted(set(alive_in(self.folder).values()))}")
            self._kill_all()
        if not self._safe():
            trial.problems.append("devices did not stay safe")

    def _safe(self) -> bool:
        x_m = self.world.trolley_x_m.at()
        time.sleep(0.02)
        return self.world.transmit.at() + self.world.receive.at() == "HH" and self.world.trolley_x_m.at() == x_m

    def _kill_all(self) -> None:
        for pid in alive_in(self.folder):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def _look_at_outcome(self) -> None:
        case, trial = self.case, self.trial
        if self.finished is not None:
            trial.outcome = f"{self.finished.state}: {self.finished.reason}"
        else:
            trial.outcome = f"error: {self.error}"
        early = trial.phase in ("starting", "preparing")
        late = trial.phase == "closing"
        words: tuple[str, ...] = ("finished",)
        if case.process == "engine" and case.blow == "kill":
            words = ("error: engine: the engine's process ended", "error: engine: the engine did not start")
        elif case.process == "engine" and case.blow == "term":
            words = ("aborted",) + (("error: engine: the engine did not start",) if early else ())
        elif case.process in ("writer", "recover") and case.blow == "kill":
            words = ("failed",)
        elif case.process == "camera" and early:
            words = ("finished", "failed")
        if late:
            words += ("finished",)
        if not trial.outcome.startswith(words):
            trial.problems.append(f"ended as {trial.outcome!r}")

    def _look_at_file(self) -> None:
        trial, partial = self.trial, self.session.with_name("s.h5.partial")
        path: Path | None = None
        if self.session.exists():
            path, trial.how = self.session, "closed"
            partial.unlink(missing_ok=True)
        elif partial.exists():
            path = self.session.with_name("rescued.h5")
            if self.case.process == "recover":
                self._recover_and_strike(partial, path)
            if not path.exists():
                try:
                    recover(partial, path)
                except PolfuseError as error:
                    trial.problems.append(f"cannot be recovered: {error}")
                    return
            trial.how = "recovered"
            partial.unlink()
        else:
            trial.how = "none"
        compare(trial, self.log, path, self.struck_ns)

    def _recover_and_strike(self, partial: Path, path: Path) -> None:
        """Begin to recover in another process and strike that, or its child."""
        code = "import sys; from polfuse_lab.session import recover; recover(sys.argv[1], sys.argv[2])"
        process = subprocess.Popen([sys.executable, "-c", code, partial, path], stderr=subprocess.DEVNULL)
        time.sleep(self.chance.uniform(0.3, 1.6))
        # The copying child works for a moment only: half of the blows wait for it.
        if self.chance.random() < 0.5:
            _until(lambda: find(self.folder, "camera") is not None or process.poll() is not None, time.monotonic() + 10)
            time.sleep(self.chance.uniform(0.0, 0.5))
        child = find(self.folder, "camera")
        struck = child if child is not None and self.chance.random() < 0.5 else process.pid
        with contextlib.suppress(ProcessLookupError):
            os.kill(struck, signal.SIGKILL)
        process.wait(30)
        _until(lambda: gone(self.folder), time.monotonic() + GONE_S)

    def _look_for_leftovers(self) -> None:
        problems = self.trial.problems
        for path in (self.folder / "run").rglob("*"):
            if path.name != "polfuse-lab":
                problems.append(f"left behind: {path.relative_to(self.folder)}")
        for line in self.log.lines("memory"):
            if Path("/dev/shm", line.words[0].lstrip("/")).exists():
                problems.append(f"left behind: shared memory {line.words[0]}")
                Path("/dev/shm", line.words[0].lstrip("/")).unlink(missing_ok=True)
        expected = {self.session.name, "rescued.h5"}
        extra = sorted(path.name for path in self.session.parent.iterdir() if path.name not in expected)
        if self.trial.how == "none" and ballast_path(self.session).name in extra:
            problems.append("a ballast was left without a session")
        elif extra:
            problems.append(f"left behind in the session's folder: {', '.join(extra)}")


def _until(ready: object, end: float) -> bool:
    assert callable(ready)
    while not ready():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True
