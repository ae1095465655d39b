"""One trial of the kill campaign: a collect, one blow at one of its processes, and what was left."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.collect_stand import AIMS, GONE_S, LIMIT_S, CollectStand, trial_folder, until
from benchmarks.kill_check import compare
from benchmarks.kill_plugin import EARLY_ANSWERS
from benchmarks.kill_processes import find, gone
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session.naming import partial_path
from polfuse_lab.session.recovery import recover

TRIES = 3
"""A collect may be over, or its process gone, before the blow falls; then it is tried again."""
STOPS_S = (0.05, 0.3, 0.8, 2.5)
"""How long a stopped process stands, s: also longer than the camera's watchdog waits."""


@dataclass(frozen=True)
class Case:
    """A blow: ``kill`` (SIGKILL), ``term`` (SIGTERM) or ``stop`` (SIGSTOP, then SIGCONT)."""

    seed: int
    process: str
    """``engine``, ``writer``, ``camera``, ``guard`` or ``recover``."""
    phase: str
    """Of :data:`benchmarks.collect_stand.AIMS`, or ``starting``."""
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
    """Audio blocks and frames that the devices delivered."""
    confirmed: int = 0
    """Records that the writer confirmed to be flushed."""
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
    """Carry out one case in a folder of its own."""
    began = time.monotonic()
    for number in range(TRIES):
        trial = Trial(case)
        chance = random.Random(f"{case.seed}/{number}")
        with trial_folder(defect=EARLY_ANSWERS if case.early_answers else "") as folder, CollectStand(folder) as stand:
            blow = _Blow(trial, stand, chance)
            blow.run()
        if blow.struck_ns or trial.problems:
            break
    else:
        trial.problems.append(f"the {case.process} was not there to be struck, {TRIES} times")
    trial.seconds = time.monotonic() - began
    return trial


class _Blow:
    """A collect, the blow, and all checks."""

    def __init__(self, trial: Trial, stand: CollectStand, chance: random.Random) -> None:
        self.trial, self.case, self.stand = trial, trial.case, stand
        self.chance = chance
        self.session = stand.folder / "sessions" / "s.h5"
        self.session.parent.mkdir()
        self.struck_ns = 0

    def run(self) -> None:
        """From start to end."""
        case, trial, stand = self.case, self.trial, self.stand
        stand.start(self.session)
        self._aim()
        if not self.struck_ns:
            trial.problems += stand.wait_for_peace()
            return
        if case.process == "engine" and case.blow == "kill":
            until(stand.safe, time.monotonic() + GONE_S)
            trial.safe_s = (time.monotonic_ns() - self.struck_ns) * 1e-9
        trial.problems += stand.wait_for_peace()
        trial.phase = "recover" if case.process == "recover" else stand.log.phase_at(self.struck_ns)
        self._look_at_outcome()
        self._look_at_file()
        trial.problems += stand.leftovers(self.session.parent, {self.session.name, "rescued.h5"})

    def _aim(self) -> None:
        case, end = self.case, 0.0
        role = "writer" if case.process == "recover" else case.process
        pid: int | None = None
        if case.phase == "starting":
            time.sleep(self.chance.uniform(0.0, 1.5))
        else:
            _, times, spread_s = AIMS[case.phase]
            if case.phase not in ("preparing", "any"):
                # Looked for in time: some phases are over within milliseconds.
                self.stand.log.wait_for(lambda line: line.kind == "created", 1, LIMIT_S)
                pid = find(self.stand.folder, role)
            self.stand.wait_for_phase(case.phase, self.chance.randint(1, times))
            end = time.monotonic() + self.chance.uniform(0.0, spread_s)
        give_up = time.monotonic() + 10.0
        while pid is None:
            pid = find(self.stand.folder, role)
            if pid is None and (time.monotonic() > give_up or self.stand.ended.is_set()):
                return
        time.sleep(max(end - time.monotonic(), 0.0))
        blow = {"kill": signal.SIGKILL, "term": signal.SIGTERM, "stop": signal.SIGSTOP}[case.blow]
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, blow)
            self.struck_ns = time.monotonic_ns()
            if case.blow == "stop":
                time.sleep(self.chance.choice(STOPS_S))
                os.kill(pid, signal.SIGCONT)

    def _look_at_outcome(self) -> None:
        case, trial = self.case, self.trial
        trial.outcome = self.stand.outcome
        early = trial.phase in ("starting", "preparing")
        words: tuple[str, ...] = ("finished",)
        if case.process == "engine" and case.blow == "kill":
            words = ("error: engine: the engine's process ended", "error: engine: the engine did not start")
        elif case.process == "engine" and case.blow == "term":
            words = ("aborted", "error: engine: the engine did not start") if early else ("aborted",)
        elif case.process in ("writer", "recover") and case.blow == "kill":
            words = ("failed",)
        elif case.process == "camera" and early:
            words = ("finished", "failed")
        if trial.phase == "closing":
            words += ("finished",)
        if not trial.outcome.startswith(words):
            trial.problems.append(f"ended as {trial.outcome!r}")

    def _look_at_file(self) -> None:
        trial, partial = self.trial, partial_path(self.session)
        path: Path | None = None
        trial.how = "none"
        if self.session.exists():
            path, trial.how = self.session, "closed"
            partial.unlink(missing_ok=True)
        elif partial.exists():
            path, trial.how = self.session.with_name("rescued.h5"), "recovered"
            if self.case.process == "recover":
                self._recover_and_strike(partial, path)
            if not path.exists():
                try:
                    recover(partial, path)
                except PolfuseError as error:
                    trial.problems.append(f"cannot be recovered: {error}")
                    return
            partial.unlink()
        compare(trial, self.stand.log, path, self.struck_ns)

    def _recover_and_strike(self, partial: Path, path: Path) -> None:
        """Begin to recover in another process and strike that, or its child."""
        folder = self.stand.folder
        code = "import sys; from polfuse_lab.session import recover; recover(sys.argv[1], sys.argv[2])"
        process = subprocess.Popen([sys.executable, "-c", code, partial, path], stderr=subprocess.DEVNULL)
        time.sleep(self.chance.uniform(0.3, 1.6))
        # The copying child works for a moment only: half of the blows wait for it.
        if self.chance.random() < 0.5:
            until(lambda: find(folder, "camera") is not None or process.poll() is not None, time.monotonic() + 10)
            time.sleep(self.chance.uniform(0.0, 0.5))
        child = find(folder, "camera")
        struck = child if child is not None and self.chance.random() < 0.5 else process.pid
        with contextlib.suppress(ProcessLookupError):
            os.kill(struck, signal.SIGKILL)
        process.wait(30)
        until(lambda: gone(folder), time.monotonic() + GONE_S)
