"""One trial of the campaign of failing disks: a collect, its disk taken away, what is left, and the rest elsewhere."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.collect_stand import AIMS, CollectStand, trial_folder
from benchmarks.kill_check import content
from benchmarks.kill_log import TapLog
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import info, join, open_session, recover
from polfuse_lab.session.naming import partial_path

DISK_BYTES = 6 << 20
LEFT_BYTES = 40_000
"""At most so much is left free on the disk that gets full."""
KINDS = ("full", "deleted", "read-only", "EIO", "EIO at the end too", "quota")
"""Ways in which a disk fails: another program fills it; the folder is deleted; the kernel finds an error and allows no
more changes; single writes fail; and then closing fails as well; the user's quota is used up."""
_FAULT = """\
import errno, os
append, end, count = writer.SessionWriter._append, writer.SessionWriter._end, [0]
def failing(self, record, **how):
    count[0] += 1
    if count[0] >= {after}: raise OSError(errno.{name}, os.strerror(errno.{name}))
    append(self, record, **how)
writer.SessionWriter._append = failing"""
_FAULT_AT_END = """
def failing_end(self, file, state, reason): raise RuntimeError("Unable to flush file (file write failed: errno = 5)")
writer.SessionWriter._end = failing_end"""


@dataclass(frozen=True)
class DiskCase:
    """How the disk fails, and the seed that says when."""

    seed: int
    kind: str = "full"


@dataclass
class DiskTrial:
    """What came of a case."""

    case: DiskCase
    phase: str = ""
    outcome: str = ""
    queued: int = 0
    """Records that the writer had been given."""
    kept: int = 0
    """Those of them that are in the file."""
    confirmed: int = 0
    rest: str = ""
    """How the collect ended that went on from there."""
    seconds: float = 0.0
    skipped: str = ""
    """Why this machine cannot try it."""
    problems: list[str] = field(default_factory=list)


def run_disk_trial(case: DiskCase) -> DiskTrial:
    """Carry out one case in a folder of its own."""
    began = time.monotonic()
    trial = DiskTrial(case)
    chance = random.Random(case.seed)
    with trial_folder(defect=_defect(case, chance)) as folder, contextlib.ExitStack() as mounted:
        try:
            disk = mounted.enter_context(_disk(folder, case.kind))
        except _CannotTry as reason:
            trial.skipped = str(reason)
            return trial
        with CollectStand(folder) as stand:
            _Failure(trial, stand, disk, chance).run()
    trial.seconds = time.monotonic() - began
    return trial


class _Failure:
    """A collect, its disk's failure, and all checks."""

    def __init__(self, trial: DiskTrial, stand: CollectStand, disk: Path, chance: random.Random) -> None:
        self.trial, self.stand, self.disk, self.chance = trial, stand, disk, chance
        self.session = disk / "day" / "s.h5"
        self.session.parent.mkdir()
        self.elsewhere = stand.folder / "elsewhere"
        self.elsewhere.mkdir()

    def run(self) -> None:
        """From start to end."""
        trial, stand = self.trial, self.stand
        stand.start(self.session)
        struck_ns = self._fail()
        trial.problems += stand.wait_for_peace()
        trial.phase, trial.outcome = stand.log.phase_at(struck_ns), stand.outcome
        trial.queued, trial.confirmed = len(stand.log.queued), stand.log.confirmed
        part = self._part()
        if part is None:
            return
        self._compare(part, stand.log)
        if trial.outcome.startswith("finished"):
            return
        self._go_on(part)

    def _fail(self) -> int:
        """Let the disk fail at a random moment; return when, ns."""
        phase = self.chance.choice(("moving", "recording", "optics", "flushing", "flushing"))
        _, times, spread_s = AIMS[phase]
        self.stand.wait_for_phase(phase, self.chance.randint(1, times))
        time.sleep(self.chance.uniform(0.0, spread_s))
        match self.trial.case.kind:
            case "full":
                free = shutil.disk_usage(self.disk).free - int(self.chance.uniform(0, LEFT_BYTES))
                with open(self.disk / "filler", "wb") as file, contextlib.suppress(OSError):
                    file.write(bytes(max(free, 0)))
                    file.flush()
            case "deleted":
                shutil.rmtree(self.session.parent, ignore_errors=True)
            case "read-only":
                name = os.path.basename(os.path.realpath(_loop_device(self.disk)))
                Path("/sys/fs/ext4", name, "trigger_fs_error").write_text("1")
        return time.monotonic_ns()

    def _part(self) -> Path | None:
        """The file that was left, rescued where it was not closed."""
        trial, partial = self.trial, partial_path(self.session)
        whole = trial.case.kind not in ("read-only", "EIO at the end too")
        if self.session.exists():
            return self.session
        if whole or not partial.exists():
            trial.problems.append("the file was not closed cleanly" if partial.exists() else "there is no file")
        if not partial.exists():
            return None
        rescued = self.elsewhere / "rescued.h5"
        try:
            recover(partial, rescued)
        except PolfuseError as error:
            trial.problems.append(f"cannot be recovered: {error}")
            return None
        return rescued

    def _compare(self, part: Path, log: TapLog) -> None:
        trial = self.trial
        with open_session(part) as session:
            have = content(session, trial.problems)
            state, reason = session.state, session.reason
        present = [(told.kind, told.number) in have for told in log.queued]
        trial.kept = present.index(False) if False in present else len(present)
        if any(present[trial.kept :]):
            trial.problems.append(f"a record in the middle is missing: {log.queued[trial.kept]}")
        if trial.kept < trial.confirmed:
            trial.problems.append(f"confirmed and lost: {trial.confirmed - trial.kept} records")
        if trial.outcome.startswith("finished"):
            if trial.kept < trial.queued:
                trial.problems.append("finished, and records are missing")
            return
        expected = {
            "full": "the disk is full",
            "quota": "the disk is full",
            "deleted": "was deleted while it was written",
        }
        words = expected.get(trial.case.kind, "writing failed")
        if words not in trial.outcome or not trial.outcome.startswith("failed"):
            trial.problems.append(f"ended as {trial.outcome!r}")
        if part == self.session and (state != "failed" or words not in reason):
            trial.problems.append(f"the file says {state!r}, {reason!r}")
        if part == self.session and self.disk in part.parents:
            left = sorted(path.name for path in part.parent.iterdir() if path != part)
            trial.problems += [f"left behind: {', '.join(left)}"] if left else []

    def _go_on(self, part: Path) -> None:
        """Collect the rest on another disk, join both, and look whether all is there."""
        trial, stand = self.trial, self.stand
        site = stand.folder / "site" / "sitecustomize.py"
        site.unlink(missing_ok=True)  # the other disk is sound
        rest, whole = self.elsewhere / "rest.h5", self.elsewhere / "whole.h5"
        stand.start(rest, continues=part)
        trial.problems += stand.wait_for_peace()
        trial.rest = stand.outcome
        if not trial.rest.startswith("finished"):
            if "nothing is missing" not in trial.rest:
                trial.problems.append(f"the rest ended as {trial.rest!r}")
            return
        try:
            join([part, rest], whole)
            found = info(whole)
            with open_session(whole) as session:
                content(session, trial.problems)
        except PolfuseError as error:
            trial.problems.append(f"the parts cannot be joined: {error}")
            return
        missing = [problem for problem in found["problems"] if "missing" in problem]
        if not found["complete"] or missing or found["positions"] != 7:
            trial.problems.append(f"joined, and not whole: {found['positions']} positions, {found['problems']}")


class _CannotTry(Exception):
    """This machine cannot make such a disk; the text says why."""


def _defect(case: DiskCase, chance: random.Random) -> str:
    name = {"EIO": "EIO", "EIO at the end too": "EIO", "quota": "EDQUOT"}.get(case.kind)
    if name is None:
        return ""
    return _FAULT.format(after=chance.randint(5, 90), name=name) + (_FAULT_AT_END if "end" in case.kind else "")


@contextlib.contextmanager
def _disk(folder: Path, kind: str) -> Iterator[Path]:
    """A small file system of its own, mounted while it is used."""
    disk = folder / "disk"
    disk.mkdir()
    if kind not in ("full", "read-only"):
        yield disk
        return
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        raise _CannotTry("a small file system can only be mounted by root on Linux")
    if kind == "full":
        _run("mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(disk))
    else:
        image = folder / "image"
        with open(image, "wb") as file:
            # Far more than a collect writes, for this disk is not to be full: not even where compression is left out.
            file.truncate(96 << 20)
        _run("mkfs.ext4", "-q", "-F", str(image))
        _run("mount", "-o", "loop,errors=remount-ro", str(image), str(disk))
    try:
        yield disk
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=False, capture_output=True)


def _loop_device(disk: Path) -> str:
    for line in Path("/proc/mounts").read_text().splitlines():
        device, place, *_ = line.split()
        if place == str(disk):
            return device
    raise _CannotTry("the loop device is not mounted")


def _run(*command: str) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except OSError as error:
        raise _CannotTry(f"{command[0]}: {error.strerror}") from None
    if done.returncode:
        raise _CannotTry(f"{command[0]}: {done.stderr.strip()}")
