"""Judging records inside the engine: each is compressed to a range profile, and what is wrong with it is said.

It looks at copies of the records in a thread of its own. When it cannot keep up it skips the oldest; acquisition never
waits for it.
"""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.radar.health import Severity, SignalHealth, SyncMeasure, examine_signal
from polfuse_lab.records import Record, Sweeps
from polfuse_lab.rig import Rig
from processing.errors import DataError
from processing.radar.sync import Sync, find_sync

QUEUE = 8
"""Records that may wait to be shown."""


@dataclass(frozen=True)
class Preview:
    """A range profile for display. ``level_db`` is relative to full scale, (bins,) float32; bin i is at i * step_m."""

    number: int
    """Counts previews from 1."""
    position: int
    x_m: float
    channel: str
    step_m: float
    level_db: NDArray[np.float32]


class LivePipeline:
    """A thread that turns audio records into previews and warnings. Implements the scheduler's ``Viewer``."""

    def __init__(self, rig: Rig, *, max_range_m: float = 60.0) -> None:
        self._rig = rig
        self._max_range_m = max_range_m
        self._waiting: deque[Sweeps] = deque(maxlen=QUEUE)
        self._wake = threading.Event()
        self._ended = False
        self._preview: Preview | None = None
        self._fatal: str | None = None
        self._warnings: tuple[str, ...] = ()
        self._looked = 0
        self._thread = threading.Thread(target=self._work, name="live pipeline", daemon=True)
        self._thread.start()

    @property
    def preview(self) -> Preview | None:
        """The newest preview."""
        return self._preview

    @property
    def fatal(self) -> str | None:
        """Why the collect is pointless (no sync in the very first record)."""
        return self._fatal

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is wrong with the signal, each thing once."""
        return self._warnings

    def offer(self, record: Record) -> None:
        """Take a record; returns at once. The oldest waiting one is dropped when there are too many."""
        if isinstance(record, Sweeps):
            self._waiting.append(record)
            self._wake.set()

    def close(self, timeout_s: float = 2.0) -> None:
        """End the thread."""
        self._ended = True
        self._wake.set()
        self._thread.join(timeout_s)

    def _work(self) -> None:
        while not self._ended:
            self._wake.wait()
            self._wake.clear()
            while self._waiting and not self._ended:
                self._look(self._waiting.popleft())

    def _look(self, record: Sweeps) -> None:
        try:
            self._preview = self._compress(record)
        except DataError as error:
            if self._looked == 0:
                self._fatal = str(error)
            self._warn(f"no range profile at position {record.position}, {record.channel.name}: {error.what}")
        except Exception as error:
            # Nothing in the display may end a collect; what is wrong is said.
            self._warn(f"the live view failed ({type(error).__name__}: {error})")
        self._looked += 1

    def _compress(self, record: Sweeps) -> Preview:
        from processing.radar.ranging import average, compress, cut_sweeps, range_axis, unambiguous_range_m

        waveform = self._rig.waveform
        block = record.block
        sync = find_sync(
            block.samples,
            block.sample_rate_hz,
            nominal_period_s=waveform.sweep_period_s,
            ramp_up_s=waveform.ramp_up_s,
        )
        self._check_signal(record, sync)
        sweeps = cut_sweeps(block.samples, sync)
        reach = unambiguous_range_m(waveform.bandwidth_hz, sweeps.ramp_samples) - self._rig.geometry.range_offset_m
        # A whole cell below the limit, since the axis ends at or after the range asked for.
        axis = range_axis(waveform.bandwidth_hz, min(self._max_range_m, reach - waveform.range_resolution_m), 2)
        profile = average(
            compress(
                sweeps,
                axis,
                centre_hz=waveform.centre_hz,
                bandwidth_hz=waveform.bandwidth_hz,
                range_offset_m=self._rig.geometry.range_offset_m,
            )
        )
        power = np.abs(profile) / _full_scale(block.samples)
        level: NDArray[np.float32] = (20 * np.log10(np.maximum(power, 1e-9))).astype(np.float32)
        number = 1 if self._preview is None else self._preview.number + 1
        return Preview(number, record.position, record.x_m, record.channel.name, float(axis[1]), level)

    def _check_signal(self, record: Sweeps, sync: Sync) -> None:
        health = signal_health(self._rig, record.block.samples, record.block.sample_rate_hz, sync)
        for finding in health.findings:
            if finding.severity >= Severity.WARNING:
                measured = f" ({finding.measured})" if finding.measured else ""
                where = f"at position {record.position}, {record.channel.name}"
                self._warn(f"{finding.what} {where}{measured}: {finding.advice}")

    def _warn(self, text: str) -> None:
        # One line for each kind of trouble: the first place where it was seen is enough.
        kind = text.split(" at position", 1)[0]
        if not any(known.startswith(kind) for known in self._warnings):
            self._warnings = (*self._warnings, text)


def _full_scale(samples: NDArray[np.generic]) -> float:
    return 2.0 ** (8 * samples.dtype.itemsize - 1) - 1 if samples.dtype.kind == "i" else 1.0


def signal_health(
    rig: Rig, samples: NDArray[np.generic], sample_rate_hz: float, sync: Sync | None = None
) -> SignalHealth:
    """What is wrong with a recording, judged by the rig's waveform and, where it is known, the recording's sync."""
    waveform = rig.waveform
    measure = None
    if sync is not None:
        up = sync.ramp_samples / sync.period_samples
        measure = SyncMeasure(sync.channel, sync.period_s, 1 - up if sync.inverted else up)
    return examine_signal(
        samples,
        sample_rate_hz,
        nominal_period_s=waveform.sweep_period_s,
        ramp_up_s=waveform.ramp_up_s,
        sync=measure,
    )


def sync_problem(rig: Rig, samples: NDArray[np.generic], sample_rate_hz: float) -> str | None:
    """Why a recording cannot be ranged (silent, mono, no sync …), None when its sync is found."""
    try:
        find_sync(
            samples,
            sample_rate_hz,
            nominal_period_s=rig.waveform.sweep_period_s,
            ramp_up_s=rig.waveform.ramp_up_s,
        )
    except DataError as error:
        return str(error)
    return None
