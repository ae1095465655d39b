"""The radar's audio as it arrives: levels, a strip for the eye, range profiles, waterfall and range-Doppler map.

Everything is worked out from the newest sweeps alone, so it costs the same however long a record is.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.radar.health import Severity, SignalHealth, fractions
from polfuse_lab.live.board import Board
from polfuse_lab.live.pipeline import signal_health
from polfuse_lab.rig import Rig
from processing.errors import DataError
from processing.radar.doppler import range_doppler
from processing.radar.ranging import average, compress, cut_sweeps, range_axis, unambiguous_range_m
from processing.radar.sync import Sync, find_sync

JUDGE_S = 2.0
"""Length of the piece by which the signal's health is judged, s: enough to tell mains hum from the sweeps."""
JUDGE_EVERY_S = 1.0
WINDOW_SWEEPS = 3.6
"""Sweeps in which the sync is measured: enough for whole ramps whatever the phase."""
SHOWN_SWEEPS = 2
"""Sweeps in a strip."""
MEAN_SWEEPS = 4
"""Sweeps averaged in a profile, at most."""
DOPPLER_SWEEPS = 64
DOPPLER_LEAST = 8
DOPPLER_EVERY_S = 0.2
OVERSAMPLING = 4
WATERFALL_ROWS = 1024
"""Sweeps that a waterfall's ring keeps: 40 s at 25 sweeps a second."""
WORDS = 600
"""Characters of a sentence, at most."""
FLOOR = 1e-9
FULL_DB = "dB of full scale"
UNKNOWN = "unknown"
"""Channel while the route of the switches is not known."""


@dataclass(frozen=True)
class Piece:
    """Audio that has arrived: ``first`` counts frames, ``end_ns`` is when its last frame arrived."""

    samples: NDArray[np.generic]
    first: int
    rate_hz: float
    end_ns: int


@dataclass(frozen=True)
class _Sweep:
    start: float
    """Of its ramp, frames since the stream began."""
    profile: NDArray[np.complex128]
    channel: str


class Listener:
    """Makes pictures of audio pieces. Used by one thread.

    Args:
        rig: the rig.
        board: where they go.
        max_range_m: end of the range axis, where the sample rate allows it.
        continuous_wave: whether the ramp is switched off: there is no sync to look for, and there are no ranges.
        judge_apart: whether the signal is judged in a thread of its own, which takes a tenth of a second at 192 kHz.
    """

    def __init__(
        self,
        rig: Rig,
        board: Board,
        *,
        max_range_m: float = 60.0,
        continuous_wave: bool = False,
        judge_apart: bool = False,
    ) -> None:
        self._rig, self._board, self._max_range_m = rig, board, max_range_m
        self._continuous_wave, self._judge_apart = continuous_wave, judge_apart
        self._judging: threading.Thread | None = None
        self._pieces: deque[Piece] = deque()
        self._kept = 0
        self._routes: deque[tuple[int, str]] = deque([(0, UNKNOWN)], maxlen=64)
        self._following = -np.inf
        """Ramps that begin before this frame have been shown."""
        self._sweeps: deque[_Sweep] = deque(maxlen=DOPPLER_SWEEPS)
        self._judged_ns = -(1 << 62)
        self._mapped = 0.0
        self._health: SignalHealth | None = None
        self._trouble: tuple[str, str] = ("", "")
        self.skipped_s = 0.0
        """Audio that was not looked at since it came faster than it could be, s."""

    def route(self, channel: str, since_ns: int) -> None:
        """The switches stand on a channel since then."""
        if channel != self._routes[-1][1]:
            self._routes.append((since_ns, channel))

    def hear(self, piece: Piece) -> None:
        """Take in a piece; one that does not follow the last one begins anew."""
        if self._pieces:
            last = self._pieces[-1]
            follows = last.first + len(last.samples) == piece.first
            if not follows or last.rate_hz != piece.rate_hz or last.samples.dtype != piece.samples.dtype:
                self._forget()
        self._pieces.append(piece)
        self._kept += len(piece.samples)
        while self._kept - len(self._pieces[0].samples) >= JUDGE_S * piece.rate_hz:
            self._kept -= len(self._pieces.popleft().samples)

    def look(self) -> None:
        """Show what is new. Never raises for what is wrong with the signal."""
        if not self._pieces:
            return
        newest = self._pieces[-1]
        period = self._rig.waveform.sweep_period_s * newest.rate_hz
        window = self._last(round(WINDOW_SWEEPS * period))
        sync: Sync | None = None
        if len(window.samples) >= 3 * period and not self._continuous_wave:
            try:
                sync = self._sync(window)
                self._trouble = "", ""
            except DataError as error:
                self._trouble = error.what, error.advice
        self._judge(newest.end_ns)
        self._tell_levels(window, sync)
        self._show_strip(window, sync)
        if sync is not None:
            # When nobody looked for long, sweeps have left the window.
            gap = window.first - self._following
            self.skipped_s += max(gap - 1.5 * period, 0.0) / window.rate_hz if np.isfinite(gap) else 0.0
            self._show_sweeps(window, sync)

    def begin(self, channel: str) -> None:
        """What comes next does not follow what came before, and is of one channel."""
        self._forget()
        self._routes.clear()
        self._routes.append((0, channel))

    def _forget(self) -> None:
        self._pieces.clear()
        self._sweeps.clear()
        self._kept, self._following = 0, -np.inf

    def _last(self, frames: int) -> Piece:
        """The newest frames of all pieces, as one."""
        found: list[NDArray[np.generic]] = []
        missing = frames
        for piece in reversed(self._pieces):
            found.append(piece.samples[-missing:])
            missing -= len(found[-1])
            if missing <= 0:
                break
        newest = self._pieces[-1]
        samples = np.concatenate(found[::-1])
        return Piece(samples, newest.first + len(newest.samples) - len(samples), newest.rate_hz, newest.end_ns)

    def _sync(self, window: Piece) -> Sync:
        waveform = self._rig.waveform
        return find_sync(
            window.samples, window.rate_hz, nominal_period_s=waveform.sweep_period_s, ramp_up_s=waveform.ramp_up_s
        )

    def _judge(self, now_ns: int) -> None:
        rate = self._pieces[-1].rate_hz
        # A shorter piece cannot tell mains hum from the sweeps.
        enough = self._kept >= 0.9 * JUDGE_S * rate and not self._continuous_wave
        if enough and not 0 <= now_ns - self._judged_ns < JUDGE_EVERY_S * 1e9:
            self._judged_ns = now_ns
            piece = self._last(round(JUDGE_S * rate))
            if not self._judge_apart:
                self._examine(piece)
            elif self._judging is None or not self._judging.is_alive():
                self._judging = threading.Thread(target=self._examine, args=(piece,), name="live judge", daemon=True)
                self._judging.start()

    def _examine(self, piece: Piece) -> None:
        self._health = signal_health(self._rig, piece.samples, piece.rate_hz)

    def _tell_levels(self, window: Piece, sync: Sync | None) -> None:
        values = fractions(window.samples[-round(0.1 * window.rate_hz) :])
        peak, rms = np.abs(values).max(axis=0), np.sqrt(np.mean(values**2, axis=0))
        beat, other = (0, 1) if sync is None else (sync.beat_channel, sync.channel)
        light, what, mend = self._light()
        self._board.put(
            "levels",
            {},
            t_sample_ns=window.end_ns,
            units={"period_s": "s"},
            values={
                "beat_peak": float(peak[beat]),
                "beat_rms": float(rms[beat]),
                "sync_peak": float(peak[other]),
                "sync_rms": float(rms[other]),
                "clipped_fraction": float(np.mean(np.abs(values[:, beat]) >= 0.999)),
                "sync_channel": -1 if sync is None else sync.channel,
                "sync_inverted": sync is not None and sync.inverted,
                "period_s": 0.0 if sync is None else sync.period_s,
                "channel": self._routes[-1][1],
                "light": light,
                "what": what[:WORDS],
                "mend": mend[:WORDS],
            },
            slots=64,
        )

    def _light(self) -> tuple[str, str, str]:
        """The signal's light: ``ok``, ``warn`` or ``bad``, what is wrong and how to mend it."""
        what, mend = self._trouble
        if self._health is not None and self._health.error is not None:
            return "bad", self._health.error.sentence, self._health.error.advice
        if what:
            return "bad", what, mend
        found = [] if self._health is None else self._health.findings
        worst = [finding for finding in found if finding.severity >= Severity.WARNING]
        sentences = "; ".join(finding.sentence for finding in found)
        return ("warn", sentences, "; ".join(item.advice for item in worst)) if worst else ("ok", sentences, "")

    def _show_strip(self, window: Piece, sync: Sync | None) -> None:
        frames = round(SHOWN_SWEEPS * self._rig.waveform.sweep_period_s * window.rate_hz)
        values = fractions(window.samples[-frames:]).astype(np.float32)
        beat = 0 if sync is None else sync.beat_channel
        t_s = (np.arange(len(values)) - len(values)) / window.rate_hz
        self._board.put(
            "scope",
            {"t_s": t_s, "beat": values[:, beat], "sync": values[:, 1 - beat]},
            t_sample_ns=window.end_ns,
            units={"t_s": "s", "beat": "of full scale", "sync": "of full scale"},
            values={"sample_rate_hz": window.rate_hz},
        )

    def _show_sweeps(self, window: Piece, sync: Sync) -> None:
        starts = window.first + sync.starts
        fresh = (starts >= self._following) & (sync.ends + 1 < len(window.samples))
        if not fresh.any():
            return
        waveform, offset = self._rig.waveform, self._rig.geometry.range_offset_m
        try:
            sweeps = cut_sweeps(window.samples, replace(sync, starts=sync.starts[fresh], ends=sync.ends[fresh]))
            reach = unambiguous_range_m(waveform.bandwidth_hz, sweeps.ramp_samples) - offset
            # A whole cell below the limit, since the axis ends at or after the range asked for.
            limit = min(self._max_range_m, reach - waveform.range_resolution_m)
            axis = range_axis(waveform.bandwidth_hz, limit, OVERSAMPLING)
            profiles = compress(
                sweeps,
                axis,
                centre_hz=waveform.centre_hz,
                bandwidth_hz=waveform.bandwidth_hz,
                range_offset_m=offset,
            )
        except DataError as error:
            self._trouble = error.what, error.advice
            return
        begun = starts[fresh][: len(profiles)]
        self._following = float(begun[-1]) + 0.5 * sync.period_samples
        shown: set[str] = set()
        for start, profile in zip(begun, profiles, strict=True):
            ended_ns = window.end_ns - round((window.first + len(window.samples) - start) / window.rate_hz * 1e9)
            channel = self._channel(ended_ns)
            if self._sweeps and (
                self._sweeps[-1].channel != channel
                or len(self._sweeps[-1].profile) != len(axis)
                or start - self._sweeps[-1].start > 1.5 * sync.period_samples
            ):
                self._sweeps.clear()
            self._sweeps.append(_Sweep(float(start), profile, channel))
            self._board.put(
                f"waterfall.{channel}",
                {"level_db": level_db(profile)},
                t_sample_ns=window.end_ns,
                units={"level_db": FULL_DB, "t_s": "s", "range_step_m": "m"},
                values={"t_s": ended_ns * 1e-9, "range_step_m": float(axis[1])},
                slots=WATERFALL_ROWS,
            )
            shown.add(channel)
        self._show_profile(window, axis)
        self._show_map(window, axis, sync.period_s)

    def _channel(self, t_ns: int) -> str:
        """The route at that moment."""
        return next((channel for since, channel in reversed(self._routes) if since <= t_ns), self._routes[0][1])

    def _show_profile(self, window: Piece, axis: NDArray[np.float64]) -> None:
        newest = [sweep.profile for sweep in self._sweeps][-MEAN_SWEEPS:]
        mean = average(np.array(newest))
        power = np.abs(mean[1:])
        self._board.put(
            f"profile.{self._sweeps[-1].channel}",
            {"range_m": axis, "profile": mean.astype(np.complex64), "level_db": level_db(mean)},
            t_sample_ns=window.end_ns,
            units={"range_m": "m", "profile": "of full scale", "level_db": FULL_DB, "noise_db": FULL_DB},
            values={
                "channel": self._sweeps[-1].channel,
                "sweeps": len(newest),
                "noise_db": float(20 * np.log10(max(float(np.median(power)), FLOOR))),
            },
        )  # fmt: skip

    def _show_map(self, window: Piece, axis: NDArray[np.float64], period_s: float) -> None:
        now = time.monotonic()
        if len(self._sweeps) < DOPPLER_LEAST or now - self._mapped < DOPPLER_EVERY_S:
            return
        self._mapped = now
        profiles = np.array([sweep.profile for sweep in self._sweeps])
        values, speed = range_doppler(profiles, period_s, self._rig.waveform.wavelength_m)
        self._board.put(
            f"doppler.{self._sweeps[-1].channel}",
            {"range_m": axis, "speed_m_s": speed, "level_db": level_db(values)},
            t_sample_ns=window.end_ns,
            units={"range_m": "m", "speed_m_s": "m/s", "level_db": FULL_DB},
            values={"sweeps": len(profiles)},
            slots=3,
        )


def level_db(values: NDArray[Any]) -> NDArray[np.float32]:
    """Amplitudes in dB, float32; NaN stays NaN."""
    with np.errstate(invalid="ignore"):
        level: NDArray[np.float32] = (20 * np.log10(np.maximum(np.abs(values), FLOOR))).astype(np.float32)
    return level
