"""One thing that happens, at every single moment of a plan at which it could."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from benchmarks.interleaving_plans import PLANS
from benchmarks.virtual_checks import Injected, violations
from benchmarks.virtual_devices import VirtualRadar, VirtualSwitches, VirtualTrolley
from benchmarks.virtual_run import VirtualRun
from drivers.records import Channel
from polfuse_lab.plans.files import parse_plan

Action = Callable[[VirtualRun, Injected], None]


def _abort(run: VirtualRun, injected: Injected) -> None:
    injected.abort_ns = run.clock.now_ns
    run.abort()


def _pause(run: VirtualRun, injected: Injected) -> None:
    run.control.pause()
    run.go_seconds(2.0)
    run.control.resume()


def _pause_and_abort(run: VirtualRun, injected: Injected) -> None:
    run.control.pause()
    run.go_seconds(2.0)
    if not run.ended:
        _abort(run, injected)


def _note(run: VirtualRun, injected: Injected) -> None:
    if run.recorder.begun and not run.closing:
        injected.notes.append("here")
        run.scheduler.note("here")


def _full_queue(run: VirtualRun, injected: Injected) -> None:
    run.recorder.full_until_ns = run.clock.now_ns + 300_000_000


def _slow_disk_and_pause(run: VirtualRun, injected: Injected) -> None:
    run.recorder.flush_s = 10.0
    run.go_steps(12)
    _pause(run, injected)


def _full_disk(run: VirtualRun, injected: Injected) -> None:
    if run.recorder.begun and not run.closing:
        injected.disk_failed = True
        run.recorder.fail()


def _unplug(kind: str, seconds: float) -> Action:
    def act(run: VirtualRun, injected: Injected) -> None:
        device = run.devices.get(kind)
        if device is not None:
            device.plugged = False
            run.go_seconds(seconds)
            device.plugged = True

    return act


def _hang(kind: str) -> Action:
    def act(run: VirtualRun, injected: Injected) -> None:
        if kind in run.devices:
            run.devices[kind].hang_s = 1.0

    return act


def _jump(run: VirtualRun, injected: Injected) -> None:
    switches = run.devices.get("switches")
    if isinstance(switches, VirtualSwitches):
        switches.jump(Channel.VH, 0.01)


def _bump(run: VirtualRun, injected: Injected) -> None:
    trolley = run.devices.get("trolley")
    if isinstance(trolley, VirtualTrolley):
        trolley.bump(0.02)


def _lose(run: VirtualRun, injected: Injected) -> None:
    radar = run.devices.get("radar")
    if isinstance(radar, VirtualRadar):
        radar.lose = 10


KINDS = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
ACTIONS: dict[str, Action] = {
    "abort": _abort,
    "pause": _pause,
    "pause and abort": _pause_and_abort,
    "note": _note,
    "full queue": _full_queue,
    "slow disk and pause": _slow_disk_and_pause,
    "full disk": _full_disk,
    "switches jump": _jump,
    "bump trolley": _bump,
    "lose audio": _lose,
    **{f"unplug {kind}": _unplug(kind, 1.0) for kind in KINDS},
    **{f"hang {kind}": _hang(kind) for kind in KINDS},
}
"""What may happen, by name."""


def moments(plan: str) -> int:
    """How many places there are in a plan at which others can act."""
    with _run(plan) as run:
        run.finish()
        return run.points


def sweep(plan: str, action: str, *, first: int = 0, every: int = 1) -> Iterator[tuple[int, str, list[str]]]:
    """Do ``action`` at each ``every``-th moment of a plan, from number ``first`` on.

    Yields:
        The moment, the kind of step in which it was, and what was wrong afterwards.
    """
    for moment in range(first, moments(plan), every):
        with _run(plan) as run:
            yield moment, *_one(run, Injected(), action, moment)


@contextlib.contextmanager
def _run(plan: str) -> Iterator[VirtualRun]:
    folder = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with (
        tempfile.TemporaryDirectory(prefix="polfuse-moments-", dir=folder) as made,
        VirtualRun(parse_plan(PLANS[plan], plan), Path(made) / "s.h5") as run,
    ):
        yield run


def _one(run: VirtualRun, injected: Injected, action: str, moment: int) -> tuple[str, list[str]]:
    _answering(run, moment)
    step = run.step_name()
    if not run.ended:
        ACTIONS[action](run, injected)
    run.finish()
    return step, violations(run, injected)


def _answering(run: VirtualRun, moment: int) -> None:
    """Go on to a moment; questions on the way are answered as they are in a run to the end."""
    while run.points <= moment and not run.ended:
        run.go_on(lambda: run.points > moment or bool(run.scheduler.prompts.open()))
        if run.points <= moment:
            run.answer_prompts()
