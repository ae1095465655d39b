"""All tasks, one after the other."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numba

from polfuse_lab.errors import PolfuseError
from polfuse_lab.trade.focusing import SIZES, focus_rows, ranging_rows
from polfuse_lab.trade.light import debias_rows, optics_rows, raytrace_rows
from polfuse_lab.trade.polarimetry import decomposition_rows, speckle_rows
from polfuse_lab.trade.rows import Row, pareto, settle
from polfuse_lab.trade.storage import storage_rows


@dataclass(frozen=True)
class Trade:
    """One group of tasks: how it is measured, in full and quickly."""

    kind: str | None
    """Of tolerances (:data:`polfuse_lab.tolerances.TOLERANCES_DB`); None where the error is no error."""
    measure: Callable[[bool], Iterator[Row]]
    """Takes whether to be quick."""


def _focus(quick: bool) -> Iterator[Row]:
    for size in SIZES:
        yield from focus_rows(size, 1 if quick else 3)


def _optics(quick: bool) -> Iterator[Row]:
    for size in (64, 256) if quick else (64, 256, 1024):
        yield from optics_rows(size, 1 if quick else 3)


def _speckle(quick: bool) -> Iterator[Row]:
    for size in (96,) if quick else (96, 384):
        yield from speckle_rows(size, 1 if quick else 3)


def _decompose(quick: bool) -> Iterator[Row]:
    yield from decomposition_rows(64 if quick else 128, 1 if quick else 3)


def _raytrace(quick: bool) -> Iterator[Row]:
    yield from raytrace_rows(*(16, 1, 4096) if quick else (32, 2, 16384))


TASKS: dict[str, Trade] = {
    "focus": Trade("focus", _focus),
    "ranging": Trade("ranging", lambda quick: ranging_rows(2 if quick else 5)),
    "optics.demosaic": Trade("picture", _optics),
    "optics.debias": Trade("picture", lambda quick: debias_rows(2 if quick else 5)),
    "raytrace": Trade("picture", _raytrace),
    "speckle": Trade("estimate", _speckle),
    "decompose": Trade("picture", _decompose),
    "storage": Trade(None, lambda quick: storage_rows(4 if quick else 24, 1 if quick else 3)),
}
"""Groups by the name that they are asked for."""

KIND_OF = {"optics.precision": "arithmetic", "decompose.precision": "arithmetic"}
"""Tasks within a group whose errors are of another kind."""


def kind_of(task: str, group: str) -> str | None:
    """Which tolerances judge a task."""
    return next((kind for name, kind in KIND_OF.items() if task.startswith(name)), TASKS[group].kind)


def trade(
    names: Sequence[str] = (), *, quick: bool = False, progress: Callable[[str, float], None] = lambda _, __: None
) -> tuple[list[Row], dict[str, str | None]]:
    """Measure on one core of this machine.

    Args:
        names: of :data:`TASKS`; all if left out.
        quick: smaller work and fewer rounds.
        progress: told which group is being measured, and which fraction of the groups is done.

    Returns:
        Rows, and by task which kind of tolerances judges it.

    Raises:
        PolfuseError: an unknown name.
    """
    unknown = [name for name in names if name not in TASKS]
    if unknown:
        raise PolfuseError(f"there is no task {unknown[0]!r}", where="trade", advice=f"choose from {', '.join(TASKS)}")
    chosen = list(names) or list(TASKS)
    rows: list[Row] = []
    kinds: dict[str, str | None] = {}
    with _one_thread():
        for number, group in enumerate(chosen):
            progress(f"measuring {group}", number / len(chosen))
            found = list(TASKS[group].measure(quick))
            for task in dict.fromkeys(row.task for row in found):
                own = [row for row in found if row.task == task]
                kinds[task] = kind = kind_of(task, group)
                rows += pareto(own) if kind is None else settle(own, kind)
    return rows, kinds


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Kernels on one thread: where others work too, threads wait for each other, which counts as processor time."""
    before = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
