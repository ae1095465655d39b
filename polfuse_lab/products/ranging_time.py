"""Ranging mode (thesis 5.2): one place, many sweeps; what moved, where to and how fast."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.standing import Record, usable_records
from polfuse_lab.rig import Waveform
from polfuse_lab.session import Session, open_session
from processing.radar.doppler import mean_range_doppler, unambiguous_speed_m_s
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.ramp_direction import RampShift, ramp_shift
from processing.radar.ranging import Sweeps, compress, cut_sweeps, range_axis, unambiguous_range_m
from processing.radar.sync import Sync, opposite
from processing.radar.tracks import Track, TrackSettings, find_tracks, moving_level_db

MIN_SWEEPS = 8
"""Fewest sweeps in which movement is looked for."""
_OVERSAMPLING = 4  # of the picture; tracks are looked for on every other bin


@dataclass(frozen=True)
class Target:
    """A moving target: its track in the up-ramps, and how it differs from the down-ramps'."""

    track: Track
    shift: RampShift | None
    """None where the target was not recognised in the down-ramps, or there are none."""
    ramp_speed_m_s: float | None
    """Range rate from the difference of up- and down-ramp, m/s: coarse, without aliases, whatever the bandwidth."""
    ramp_speed_sd_m_s: float | None

    @property
    def correction_m(self) -> float:
        """What to add to ranges in the up-ramp to take the Doppler shift of the beat off, m.

        Half the difference between the ramps where it is clear and of the right sign, else 0.
        """
        shift = self.shift
        if shift is None or abs(shift.shift_m) < 3 * shift.sd_m or shift.shift_m * self.track.speed_m_s < 0:
            return 0.0
        return -shift.shift_m / 2

    @property
    def r0_m(self) -> float:
        """Range at the track's first sweep, m."""
        return self.track.r0_m + self.correction_m

    @property
    def r1_m(self) -> float:
        """Range at the track's last sweep, m."""
        return self.track.r1_m + self.correction_m


@dataclass(frozen=True)
class RangeTime:
    """Range-time and range-Doppler pictures of one record, and the targets in them."""

    channel: Channel
    waveform: Waveform
    bandwidth_assumed: bool
    period_s: float
    time_s: NDArray[np.float64]
    """(sweeps,) centres of the up-ramps since the record's first sample, s."""
    range_m: NDArray[np.float64]
    """(bins,) uniform."""
    profiles: NDArray[np.complex128]
    """(sweeps, bins) range profiles of the up-ramps, fractions of full scale."""
    moving_db: NDArray[np.float64]
    """(sweeps, bins) what moves, dB over the noise."""
    doppler_power: NDArray[np.float64]
    """(speeds, bins) mean power of range-Doppler maps, full scale squared."""
    doppler_m_s: NDArray[np.float64]
    """(speeds,) range rates, aliased into +-``ambiguity_m_s``."""
    targets: tuple[Target, ...]

    @property
    def ambiguity_m_s(self) -> float:
        """Largest range rate that Doppler from sweep to sweep tells from its aliases, m/s."""
        return unambiguous_speed_m_s(self.waveform.wavelength_m, self.period_s)


def range_time(
    session: Session | Path | str,
    *,
    record: int | None = None,
    max_range_m: float | None = None,
    window: str = "hann",
    settings: TrackSettings | None = None,
) -> RangeTime:
    """Range-time picture, range-Doppler picture and moving targets of one audio record.

    Args:
        session: an open session, or its path.
        record: row of ``session.sweeps``; by default the record with the most sweeps.
        max_range_m: end of the range axis, m; by default 200 m or the unambiguous range if that is less.
        window: ``"hann"``, ``"taylor"`` or ``"rectangular"``.
        settings: what counts as a track.

    Raises:
        PolfuseError: no such record, or it holds fewer than 8 sweeps.
        DataError: a wrong window or range.
    """
    if not isinstance(session, Session):
        with open_session(session) as opened:
            return range_time(opened, record=record, max_range_m=max_range_m, window=window, settings=settings)
    chosen = _choose(session, record)
    waveform, sync = session.waveform, chosen.sync
    offset = 0.0 if session.rig is None else session.rig.geometry.range_offset_m
    if max_range_m is None:
        limit = unambiguous_range_m(waveform.bandwidth_hz, sync.ramp_samples) - abs(offset)
        max_range_m = min(200.0, limit - waveform.range_resolution_m)
    axis = range_axis(waveform.bandwidth_hz, max_range_m, _OVERSAMPLING)
    profiles, time_s = _profiles(chosen, sync, axis, waveform, window, offset)
    found = find_tracks(
        profiles[:, ::2],
        time_s,
        axis[::2],
        wavelength_m=waveform.wavelength_m,
        resolution_m=waveform.range_resolution_m,
        settings=settings,
    )
    power, speeds = mean_range_doppler(profiles - profiles.mean(axis=0), sync.period_s, waveform.wavelength_m)
    return RangeTime(
        channel=chosen.channel,
        waveform=waveform,
        bandwidth_assumed=bool(session.config["extra"].get("bandwidth_assumed", False)),
        period_s=sync.period_s,
        time_s=time_s,
        range_m=axis,
        profiles=profiles,
        moving_db=moving_level_db(profiles, sync.period_s, settings),
        doppler_power=power,
        doppler_m_s=speeds,
        targets=tuple(_targets(chosen, found, profiles[:, ::2], time_s, axis[::2], waveform, window, offset, settings)),
    )


def _choose(session: Session, record: int | None) -> Record:
    records = usable_records(session, latest_only=False)
    if record is not None:
        records = [item for item in records if item.index == record]
        if not records:
            raise PolfuseError(
                f"has no usable record {record}",
                where=str(session.path),
                advice=f"choose 0 to {len(session.sweeps) - 1}",
            )
    chosen = max(records, key=lambda item: len(item.sync.starts))
    if len(chosen.sync.starts) < MIN_SWEEPS:
        raise PolfuseError(
            f"its longest record holds {len(chosen.sync.starts)} sweeps, too few to see movement ({MIN_SWEEPS})",
            where=str(session.path),
            advice="record longer from one place (plan: sweeps_per_channel), or focus the session as a SAR image",
        )
    return chosen


def _profiles(
    record: Record, sync: Sync, axis: NDArray[np.float64], waveform: Waveform, window: str, offset: float
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    sweeps: Sweeps = cut_sweeps(record.samples, sync)
    profiles = compress(
        sweeps,
        axis,
        centre_hz=waveform.centre_hz,
        bandwidth_hz=waveform.bandwidth_hz,
        window=window,
        range_offset_m=offset,
    )
    return profiles, sweeps.start_s + sweeps.ramp_s / 2


def _targets(
    record: Record,
    tracks: list[Track],
    up: NDArray[np.complex128],
    up_s: NDArray[np.float64],
    axis: NDArray[np.float64],
    waveform: Waveform,
    window: str,
    offset: float,
    settings: TrackSettings | None,
) -> list[Target]:
    """Tracks with what the down-ramps say about them."""
    sync = record.sync
    other = opposite(sync)
    if other is None or len(other.starts) < MIN_SWEEPS or not tracks:
        return [Target(track, None, None, None) for track in tracks]
    limit = unambiguous_range_m(waveform.bandwidth_hz, other.ramp_samples)
    reachable = axis[np.abs(axis + offset) <= limit]
    down, down_s = _profiles(record, other, reachable, waveform, window, offset)
    up_db = moving_level_db(up[:, : len(reachable)], sync.period_s, settings)
    down_db = moving_level_db(down, sync.period_s, settings)
    targets = []
    for track in tracks:
        shift = ramp_shift(track, up_db, down_db, up_s, down_s, reachable, waveform.range_resolution_m)
        # Both are ranges over the same bandwidth; the beat's shift in hertz does not depend on it.
        scale = waveform.bandwidth_hz / (2 * waveform.centre_hz * sync.ramp_s)
        targets.append(
            Target(
                track=track,
                shift=shift,
                ramp_speed_m_s=None if shift is None else shift.shift_m * scale,
                ramp_speed_sd_m_s=None if shift is None else shift.sd_m * scale,
            )
        )
    return targets


def assumed_note(data: RangeTime) -> str:
    """Words on the bandwidth for titles: every range and speed hangs on it."""
    words = "assumed bandwidth" if data.bandwidth_assumed else "bandwidth"
    cell = SPEED_OF_LIGHT_M_S / (2 * data.waveform.bandwidth_hz)
    return f"{words} {data.waveform.bandwidth_hz / 1e6:.4g} MHz (cell {cell:.2f} m)"
