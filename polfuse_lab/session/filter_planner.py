"""Which filter a session is stored with: size and time of each, foretold from samples on this machine.

All filters are lossless, so that what is traded for time is room on the disk. How small samples get depends on how many
of their bits are noise, and how fast that goes on the processor: both are measured on a short sample of each kind, and
the disk's speed where the file will be. The cheapest filter is the one after which least time of processor and disk is
spent on each byte, among those that keep the plan's pace and whose file finds room.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.session.filters import FILTERS

ROOM = 1.15
"""Free room over the expected size that is asked for."""
PACE = 1.5
"""Expected bytes a second over those of the plan that are asked for."""
PROBE_BYTES = 8_000_000
ROUNDS = 3


@dataclass(frozen=True)
class Forecast:
    """What a filter does to one kind of data."""

    ratio: float
    """Stored bytes over raw ones."""
    ns_per_byte: float
    """Processor time of a raw byte."""


@dataclass(frozen=True)
class Demand:
    """What is to be stored, and where."""

    raw_bytes: Mapping[str, int]
    """By kind, ``"audio"`` and ``"images"``."""
    bytes_per_s: float
    """Raw bytes a second while all of them arrive at once."""
    disk_bytes_per_s: float
    """How fast the disk takes them."""
    free_bytes: int | None = None
    """Room on the disk; None where it is not known."""
    other_bytes: int = 0
    """Tables and text, which no filter touches."""


@dataclass(frozen=True)
class FilterPlan:
    """One filter for one demand."""

    bytes: int
    """Expected size of the file."""
    seconds: float
    """Expected time of processor and disk for all of it."""
    keeps_pace: bool
    finds_room: bool


@dataclass(frozen=True)
class FilterChoice:
    """A filter, and why."""

    filter: str
    """Of :data:`polfuse_lab.session.filters.FILTERS`."""
    predicted_bytes: int
    predicted_seconds: float
    kept: bool
    """Whether both pace and room are expected to suffice."""
    reason: str
    considered: dict[str, FilterPlan] = field(default_factory=dict)
    """All filters, cheapest first."""

    def explain(self) -> list[str]:
        """The choice in words."""
        lines = [
            f"stored with {self.filter}: {self.reason}; about {self.predicted_bytes / 1e6:.1f} MB, "
            f"{self.predicted_seconds:.2g} s of processor and disk"
        ]
        for name, plan in self.considered.items():
            if name == self.filter:
                continue
            against = [
                *([] if plan.keeps_pace else ["does not keep the pace"]),
                *([] if plan.finds_room else ["finds no room"]),
            ]
            told = f"{plan.bytes / 1e6:.1f} MB in {plan.seconds:.2g} s"
            lines.append(f"not {name}: {' and '.join([*against, told])}")
        return lines

    def told(self) -> dict[str, Any]:
        """The choice and what it foretells, for the session."""
        return {
            "filter": self.filter,
            "predicted_bytes": self.predicted_bytes,
            "predicted_seconds": float(f"{self.predicted_seconds:.3g}"),
            "kept": self.kept,
            "reason": self.reason,
        }


def forecast(sample: NDArray[Any], chunk: int | None = None) -> dict[str, Forecast]:
    """What each filter does to data like this sample.

    Args:
        sample: items along the first axis, type as stored.
        chunk: items in a chunk; all of the sample if left out. Only whole chunks are looked at.

    Raises:
        PolfuseError: an empty sample.
    """
    if not sample.size:
        raise PolfuseError("there is no sample to store", where="storage", advice="give at least one item")
    items = min(chunk or len(sample), len(sample))
    sample = sample[: len(sample) // items * items]  # a chunk that is not full takes the room of a full one
    chunks = (items, *sample.shape[1:])
    found = {}
    with h5py.File("sample", "w", driver="core", backing_store=False) as file:
        for name, options in FILTERS.items():
            least, size = math.inf, 0
            for turn in range(ROUNDS):
                stored = file.create_dataset(f"{name}{turn}", sample.shape, sample.dtype, chunks=chunks, **options)
                begun = time.thread_time()
                stored[...] = sample
                stored.flush()  # chunks stand in a cache until then
                least = min(least, time.thread_time() - begun)
                size = stored.id.get_storage_size()
            found[name] = Forecast(size / sample.nbytes, 1e9 * least / sample.nbytes)
    return found


def disk_bytes_per_s(folder: Path) -> float:
    """How fast the disk takes what is written in a folder, by writing some megabytes; infinite where that fails."""
    path = folder / f".polfuse-speed-{os.getpid()}"
    content = os.urandom(1 << 20)
    try:
        with open(path, "xb", buffering=0) as file:
            begun = time.perf_counter()
            for _ in range(PROBE_BYTES // len(content)):
                file.write(content)
            os.fsync(file.fileno())
            took = time.perf_counter() - begun
    except OSError:
        return math.inf
    finally:
        with contextlib.suppress(OSError):
            path.unlink()
    return PROBE_BYTES // len(content) * len(content) / max(took, 1e-6)


def choose_filter(forecasts: Mapping[str, Mapping[str, Forecast]], demand: Demand) -> FilterChoice:
    """The cheapest filter that keeps pace and finds room; where none does, the smallest of those that keep the pace,
    or else the fastest.

    Args:
        forecasts: of :func:`forecast`, by kind of data as in the demand.
        demand: what is to be stored.

    Raises:
        PolfuseError: data without a forecast.
    """
    missing = [kind for kind, size in demand.raw_bytes.items() if size and kind not in forecasts]
    if missing:
        raise PolfuseError(f"there is no sample of {missing[0]}", where="storage", advice="give one")
    plans = {name: _plan(name, forecasts, demand) for name in FILTERS}
    considered = dict(sorted(plans.items(), key=lambda item: item[1].seconds))
    fitting = [name for name, plan in considered.items() if plan.keeps_pace and plan.finds_room]
    if fitting:
        name, reason = fitting[0], "the cheapest that keeps the pace and finds room"
    elif in_time := [name for name, plan in considered.items() if plan.keeps_pace]:
        name = min(in_time, key=lambda one: considered[one].bytes)
        reason = f"none finds room for {ROOM:g} times its size: the smallest"
    else:
        name, reason = next(iter(considered)), "none keeps the pace: the fastest"
    chosen = considered[name]
    return FilterChoice(name, chosen.bytes, chosen.seconds, bool(fitting), reason, considered)


def _plan(name: str, forecasts: Mapping[str, Mapping[str, Forecast]], demand: Demand) -> FilterPlan:
    stored = seconds = 0.0
    for kind, size in demand.raw_bytes.items():
        if size:
            told = forecasts[kind][name]
            stored += told.ratio * size
            seconds += 1e-9 * told.ns_per_byte * size
    seconds += stored / demand.disk_bytes_per_s
    raw = sum(demand.raw_bytes.values())
    size = math.ceil(stored) + demand.other_bytes
    return FilterPlan(
        bytes=size,
        seconds=seconds,
        keeps_pace=seconds * PACE * demand.bytes_per_s <= raw,
        finds_room=demand.free_bytes is None or size * ROOM <= demand.free_bytes,
    )
