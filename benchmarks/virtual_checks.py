"""What must be so after any interleaving: nothing lost or mixed, devices safe, file whole, everybody of one mind."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.virtual_devices import PROBE_FRAMES, VirtualRadar, VirtualTrolley, decode
from benchmarks.virtual_optics import VirtualPolarizer, decode_angles
from benchmarks.virtual_run import VirtualRun
from polfuse_lab.plans.steps import Checkpoint
from polfuse_lab.records import SUPERSEDED, FrameFlag, SweepFlag
from polfuse_lab.scheduler import Outcome
from polfuse_lab.session import Session, info, open_session
from polfuse_lab.session.naming import partial_path
from polfuse_lab.session.space import ballast_path

ABORT_S = 1.0
ABORT_REAL_S = 5.0
"""Longest real time from an abort to the end; a hanging driver alone is waited for 1.1 s."""
PLACE_TOLERANCE_M = 0.0015
"""The scheduler's own limit (1 mm), three standard deviations of a fix, and the unit of the samples' place."""
PASS_TOLERANCE_M = 0.001
PASS_M_S = 0.5
"""Fastest in a pass. Places between two fixes are exact but where it starts or stops between them: the chord of a
corner is beside it by at most the change of speed times a quarter of the time between the fixes."""
ANGLE_TOLERANCE_RAD = math.radians(0.52)

LEGAL = {
    "preparing": {"preparing", "running", "paused", "stopping"},
    "running": {"running", "paused", "stopping"},
    "paused": {"paused", "running", "stopping"},
    "stopping": {"finished"},
    "finished": set[str](),
}


@dataclass
class Injected:
    """What the test has done to the run, as far as the checks must know."""

    notes: list[str] = field(default_factory=list)
    """Notes made before the run ended."""
    abort_ns: int | None = None
    """Virtual time of the abort."""
    disk_failed: bool = False


def violations(run: VirtualRun, injected: Injected) -> list[str]:
    """Everything that is not as it must be, one sentence each."""
    outcome = run.outcome
    assert outcome is not None
    # A driver that hung at the end comes back, and what waits behind that call is done.
    run.clock.advance(60.0)
    found = [*_status(run, outcome), *_devices(run), *_abort(run, outcome, injected), *_resumes(run)]
    left = [path for path in (partial_path(run.path), ballast_path(run.path)) if path.exists()]
    found += [f"{path.name} is left behind" for path in left]
    if outcome.session is None:
        if run.recorder.begun:
            found.append(f"a session was begun and the outcome names none ({outcome.reason})")
        return found
    summary = info(outcome.session)
    with open_session(outcome.session) as session:
        found += _agreement(run, outcome, session, injected)
        found += _problems(outcome, session, list(summary["problems"]))
        found += _sweeps(session)
        found += _frames(session)
        if not injected.disk_failed:
            found += _nothing_lost(run, session)
            notes = [bytes(text).decode() for text in session.notes["text"]]
            if notes != injected.notes:
                found.append(f"notes in the file are {notes} where {injected.notes} were made")
    return found


def _status(run: VirtualRun, outcome: Outcome) -> Iterator[str]:
    for before, after in itertools.pairwise(run.changes):
        if after.state not in LEGAL[before.state]:
            yield f"the run went from {before.state} to {after.state}"
    last = run.scheduler.status()
    if (str(last.state), last.reason) != ("finished", outcome.reason):
        yield f"the last status is {last.state} ({last.reason}), the outcome {outcome.state} ({outcome.reason})"
    if "defect" in outcome.reason:
        yield f"the outcome tells of a defect: {outcome.reason}"


def _devices(run: VirtualRun) -> Iterator[str]:
    """All that are connected have been made safe after the last command, and stand."""
    world, now = run.truth.world, run.clock.now_ns
    opened = any(change.reason == "listening to the radar" for change in run.changes)
    for kind, device in run.devices.items():
        if not device.plugged or device.lost or not opened:
            continue
        if device.opened:
            yield f"the {kind} was not closed"
        if device.unsafe_since is not None and kind not in _unsafe(run):
            yield f"the {kind} was not made safe after its last command"
        if kind in _unsafe(run):
            continue
        if isinstance(device, VirtualTrolley) and world.trolley_x_m.at(now) != world.trolley_x_m.at(now + 10**10):
            yield "the trolley still moves"
        if isinstance(device, VirtualPolarizer) and device.track.at(now) != device.track.at(now + 10**10):
            yield f"the {kind} still turns"
        if isinstance(device, VirtualRadar) and device.recording:
            yield "the radar still records"


def _unsafe(run: VirtualRun) -> set[str]:
    """Kinds that the run itself says it could not make safe (their driver hung)."""
    return {kind for kind in run.devices if any(f"the {kind} " in text for text in run.scheduler.unsafe)}


def _abort(run: VirtualRun, outcome: Outcome, injected: Injected) -> Iterator[str]:
    if injected.abort_ns is None:
        return
    assert run.ended_ns is not None
    # The last records wait for room in the writer's queue, with the devices safe.
    ended_ns = max([change.now_ns for change in run.changes if change.state == "stopping"], default=run.ended_ns)
    took = (ended_ns - injected.abort_ns) * 1e-9
    if took > ABORT_S:
        yield f"the abort took {took:.2f} s ({outcome.state}: {outcome.reason})"
    late = run.ended_ns - max(ended_ns, injected.abort_ns, run.recorder.full_until_ns)
    if late * 1e-9 > ABORT_S:
        yield f"the file was closed {late * 1e-9:.2f} s after the abort"
    if run.abort_real_s is not None and run.abort_real_s > ABORT_REAL_S:
        yield f"the abort took {run.abort_real_s:.1f} s of real time"
    before = any(change.state == "stopping" and change.now_ns <= injected.abort_ns for change in run.changes)
    if outcome.state == "finished" and not before and not _was_ending(run, injected.abort_ns):
        yield "the run was aborted and finished all the same"


def _was_ending(run: VirtualRun, at_ns: int) -> bool:
    """Whether all steps had been done by then: only the file was to be closed."""
    done = [change for change in run.changes if change.now_ns <= at_ns and change.state == "running"]
    return bool(done) and done[-1].step >= len(run.steps) - 1


def _resumes(run: VirtualRun) -> Iterator[str]:
    """Steps follow each other; a run goes back only to its beginning or to right behind a checkpoint."""
    begun = [change for change in run.changes if change.state == "running"]
    for before, after in itertools.pairwise(begun):
        if after.step in (before.step, before.step + 1):
            continue
        if after.step > before.step:
            yield f"step {after.step + 1} came after step {before.step + 1}"
        elif after.step and not isinstance(run.steps[after.step - 1], Checkpoint):
            yield f"the run went back to step {after.step + 1}, which follows no checkpoint"
        else:
            ticket = sum(isinstance(step, Checkpoint) for step in run.steps[: after.step])
            if after.confirmed < ticket:
                yield f"the run went back to step {after.step + 1} before what is before it was on the disk"


def _agreement(run: VirtualRun, outcome: Outcome, session: Session, injected: Injected) -> Iterator[str]:
    if session.state != outcome.state and not injected.disk_failed:
        yield f"the file says {session.state}, the outcome {outcome.state}"
    if outcome.reason.encode()[:900] != session.reason.encode()[:900] and not injected.disk_failed:
        yield f"the file says {session.reason!r}, the outcome {outcome.reason!r}"
    if injected.disk_failed:
        return
    for name, told, kept in (
        ("audio records", outcome.sweeps, len(session.sweeps)),
        ("frames", outcome.frames, len(session.frames)),
        ("lost samples", outcome.samples_lost, session.samples_lost),
        ("lost frames", outcome.frames_lost, session.frames_lost),
    ):
        if told != kept:
            yield f"the outcome counts {told} {name} and the file holds {kept}"


def _problems(outcome: Outcome, session: Session, problems: list[str]) -> Iterator[str]:
    """A finished run misses nothing; what else is told must be so."""
    for text in problems:
        if "point at data" in text or "cannot be read" in text or "never closed" in text:
            yield f"the file is not whole: {text}"
        elif outcome.state == "finished" and ("missing" in text or "no record" in text):
            yield f"the run finished, and {text}"
    flagged = int(np.count_nonzero(session.sweeps["flags"] & int(SweepFlag.LOST)))
    if bool(flagged) != any("lost audio frames" in text for text in problems):
        yield f"{flagged} records are marked as lost, and info says {problems}"


def _sweeps(session: Session) -> Iterator[str]:
    """Each record's samples against what the file says of it."""
    attempts: dict[tuple[int, int], int] = {}
    fixes_ns = np.sort(session.trolley["t_host_ns"])
    for index, row in enumerate(session.sweeps):
        flags = SweepFlag(int(row["flags"]))
        numbers, routes, places = decode(session.audio(index))
        where = f"record {index} (position {row['position']}, channel {row['channel']}, {flags!r})"
        if not np.array_equal(numbers, np.arange(row["device_frame"], row["device_frame"] + row["samples"])):
            yield f"{where}: samples are not those from {row['device_frame']}"
        vouched = not flags & (SweepFlag.SWITCH_CHANGED | SweepFlag.SWITCH_UNVERIFIED)
        if vouched and not np.all(routes == row["channel"]):
            yield f"{where}: routes were {np.unique(routes)}"
        still = not flags & (SweepFlag.MOVED | SweepFlag.CONTINUOUS | SweepFlag.SWITCH_UNVERIFIED)
        if still and np.max(np.abs(places - row["x_m"])) > PLACE_TOLERANCE_M:
            yield f"{where}: the trolley was at {places.min():.4f} .. {places.max():.4f} m, not at {row['x_m']:.4f} m"
        if flags & SweepFlag.CONTINUOUS and not flags & SUPERSEDED and not flags & SweepFlag.SWITCH_UNVERIFIED:
            away = abs(float(places[len(places) // 2]) - float(row["x_m"]))
            middle_ns = int(row["t_host_ns"]) + round(len(places) / session.sample_rate_hz * 0.5e9)
            if away > PASS_TOLERANCE_M + PASS_M_S * _gap_s(fixes_ns, middle_ns) / 4:
                yield f"{where}: it is placed {away * 1e3:.1f} mm beside where the trolley was"
        key = (int(row["position"]), int(row["channel"]))
        expected = attempts.get(key, -1) + 1
        attempts[key] = int(row["attempt"])
        if int(row["attempt"]) != expected:
            yield f"{where}: it is attempt {row['attempt']} where {expected} comes next"
        again = bool(flags & (SweepFlag.RETRY | SweepFlag.REPEATED))
        if again != (expected > 0) and not flags & SweepFlag.CONTINUOUS:
            yield f"{where}: attempt {expected} is {'' if again else 'not '}marked as taken again"
        if expected > 0 and not again:
            yield f"{where}: attempt {expected} is not marked as taken again"


def _gap_s(fixes_ns: NDArray[np.int64], at_ns: int) -> float:
    """Time between the trolley's fixes around an instant, s."""
    after = int(np.searchsorted(fixes_ns, at_ns))
    if not 0 < after < len(fixes_ns):
        return math.inf
    return float(fixes_ns[after] - fixes_ns[after - 1]) * 1e-9


def _frames(session: Session) -> Iterator[str]:
    """Each frame's true angles against what the file says of it."""
    for index, row in enumerate(session.frames):
        number, angles, sources = decode_angles(session.frame(index))
        where = f"frame {index}"
        if number != row["frame_id"]:
            yield f"{where}: the image is of frame {number}, the row of {row['frame_id']}"
        if int(row["flags"]) & int(FrameFlag.MOVED):
            continue
        if np.max(np.abs(angles - row["angle_rad"])) > ANGLE_TOLERANCE_RAD:
            yield f"{where}: the polarizer was at {np.degrees(angles)}, not at {np.degrees(row['angle_rad']):.2f} deg"
        source = float(row["source_angle_rad"])
        if not math.isnan(source) and np.max(np.abs(sources - source)) > ANGLE_TOLERANCE_RAD:
            yield f"{where}: the source was at {np.degrees(sources)}, not at {np.degrees(source):.2f} deg"


def _nothing_lost(run: VirtualRun, session: Session) -> Iterator[str]:
    """Whatever a device delivered is in the file, once; but for the listening before, and looks for an exposure."""
    kept = [(int(row["device_frame"]), int(row["samples"])) for row in session.sweeps]
    wanted = [
        (number, frames)
        for number, (frames, step) in run.truth.audio.items()
        if not (frames == PROBE_FRAMES and step == "preparing")
    ]
    steps = {number: step for number, (_, step) in run.truth.audio.items()}
    late = {number for kind, number in run.truth.late if kind == "radar"}
    yield from _compare("audio records", wanted, kept, steps, late)
    frames = [(int(row["frame_id"]), 1) for row in session.frames]
    shown = [(number, 1) for number, step in run.truth.frames.items() if step != "AutoExpose"]
    late = {number for kind, number in run.truth.late if kind == "camera"}
    yield from _compare("frames", shown, frames, run.truth.frames, late)


def _compare(
    what: str, delivered: list[tuple[int, int]], kept: list[tuple[int, int]], steps: dict[int, str], late: set[int]
) -> Iterator[str]:
    if len(set(kept)) != len(kept):
        yield f"{what} are in the file twice"
    for item in sorted(set(delivered) - set(kept)):
        if item[0] not in late:
            yield f"{what}: number {item[0]} was delivered in step {steps[item[0]]} and is not in the file"
    for item in sorted(set(kept) - set(delivered)):
        yield f"{what}: number {item[0]} is in the file and was never delivered"
