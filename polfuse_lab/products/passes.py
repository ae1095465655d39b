"""Range profiles of sessions whose trolley did not stop: every sweep at its own place."""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.record_sync import find_record_sync
from polfuse_lab.session import Session
from polfuse_lab.session.runs import Run, gapless_runs
from polfuse_lab.session.track import TrolleyTrack, sample_times
from processing.errors import DataError
from processing.radar.ranging import average, compress, cut_sweeps, noise_of_average
from processing.radar.sync import Sync

CELL_WAVELENGTHS = 1 / 16
"""Sweeps within so many wavelengths along the rail are averaged: 0.2 dB are lost at most, towards the rail's ends."""
WORST_SD_WAVELENGTHS = 1 / 8
"""A sweep whose place is not known better is left out: its phase (4 pi x / wavelength) would be a guess."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PassSweeps:
    """The sweeps of one run, and where each was taken."""

    run: Run
    samples: NDArray[np.generic]
    sync: Sync
    x_m: NDArray[np.float64]
    """(sweeps,) at the middle of each up-ramp; NaN where it is not known."""
    sd_m: NDArray[np.float64]
    """(sweeps,) standard uncertainty of ``x_m``."""
    speed_m_s: NDArray[np.float64]
    """(sweeps,) speed along x at the middle of each up-ramp."""


@dataclass(frozen=True)
class PassProfiles:
    """Range profiles of all passes, each place in one channel only."""

    values: NDArray[np.complex128]
    """(channels, places, bins); NaN in all channels but the place's own."""
    noise: NDArray[np.float64]
    """(channels, places)."""
    antenna_m: NDArray[np.float64]
    """(places, 3)."""
    sd_m: NDArray[np.float64]
    """(places,) standard uncertainty of x."""
    channels: tuple[Channel, ...]
    velocity_m_s: NDArray[np.float64]
    """(places, 3) of the trolley while it swept."""
    ramp_s: float
    """Length of the up-ramp."""


def pass_sweeps(session: Session) -> list[PassSweeps]:
    """The sweeps of every usable run of a session with their places; runs without sync are left out and logged.

    Raises:
        PolfuseError: no run is left, with the reason of the last one refused.
    """
    track = TrolleyTrack.of(session)
    found: list[PassSweeps] = []
    refused: DataError | None = None
    for run in gapless_runs(session):
        samples = run.samples(session)
        try:
            sync = find_record_sync(session, samples)
        except DataError as error:
            _log.warning("pass %d (%s): %s", run.number, run.channel.name, error)
            refused = error
            continue
        middles = sync.starts + sync.ramp_samples / 2
        times_ns, time_sd_s = sample_times(session, run.indices[0], middles)
        # Without clock fixes the time's uncertainty is unknown, but the record's own stamp is good enough for a place.
        x_m, sd_m = track.at(times_ns, np.nan_to_num(time_sd_s, nan=0.0))
        found.append(PassSweeps(run, samples, sync, x_m, sd_m, track.speed_m_s(times_ns)))
    if not found:
        what = "holds no usable pass" if refused is None else f"no pass can be used: {refused.what}"
        raise PolfuseError(what, where=str(session.path), advice="record again" if refused is None else refused.advice)
    return found


def pass_profiles(session: Session, axis: NDArray[np.float64], window: str) -> PassProfiles:
    """Range profiles of a session's passes.

    Sweeps that lie within :data:`CELL_WAVELENGTHS` are averaged (a trolley that stands, or creeps), so that no place
    counts more than others; sweeps whose place is not known are left out.

    Args:
        session: an open session.
        axis: (bins,) ranges, m.
        window: over the ramp.

    Raises:
        PolfuseError: no sweep is left.
        DataError: a wrong window or range.
    """
    waveform = session.waveform
    sweeps = pass_sweeps(session)
    ramp = float(np.median(np.concatenate([item.sync.ends - item.sync.starts for item in sweeps])))
    cell_m = CELL_WAVELENGTHS * waveform.wavelength_m
    channels = tuple(sorted({item.run.channel for item in sweeps}))
    rows: list[tuple[int, NDArray[np.complex128], float, float, float, float]] = []
    for item in sweeps:
        cut = cut_sweeps(item.samples, item.sync, ramp_samples=ramp)
        profiles = compress(
            cut,
            axis,
            centre_hz=waveform.centre_hz,
            bandwidth_hz=waveform.bandwidth_hz,
            window=window,
            range_offset_m=0.0 if session.rig is None else session.rig.geometry.range_offset_m,
        )
        x_m, sd_m = item.x_m[: len(profiles)], item.sd_m[: len(profiles)]
        speed = item.speed_m_s[: len(profiles)]
        known = np.isfinite(x_m) & (sd_m <= WORST_SD_WAVELENGTHS * waveform.wavelength_m)
        cells = np.where(known, np.floor(np.nan_to_num(x_m) / cell_m), np.nan)
        for cell in np.unique(cells[known]):
            members = np.flatnonzero(cells == cell)
            rows.append(
                (
                    channels.index(item.run.channel),
                    average(profiles[members]),
                    noise_of_average(profiles[members]),
                    float(x_m[members].mean()),
                    float(sd_m[members].max()),
                    float(speed[members].mean()),
                )
            )
    if not rows:
        raise PolfuseError(
            "knows of no sweep where the trolley was",
            where=str(session.path),
            advice="use a trolley that tells its position while it moves",
        )
    values = np.full((len(channels), len(rows), len(axis)), np.nan + 1j * np.nan, dtype=np.complex128)
    noise = np.full(values.shape[:2], np.nan)
    antenna = np.zeros((len(rows), 3))
    velocity = np.zeros((len(rows), 3))
    for place, (channel, profile, power, x, _, speed_m_s) in enumerate(rows):
        values[channel, place], noise[channel, place] = profile, power
        antenna[place, 0], velocity[place, 0] = x, speed_m_s
    sd_m = np.array([row[4] for row in rows])
    return PassProfiles(values, noise, antenna, sd_m, channels, velocity, ramp / session.sample_rate_hz)


def spacing_weights(antenna_m: NDArray[np.float64], present: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Weights of places that do not stand evenly: the length of rail that each stands for in its channel.

    Args:
        antenna_m: (places, 3).
        present: (channels, places) whether a channel has a profile at a place.

    Returns:
        (places,), relative to each channel's median; at most 4, so that a gap in a pass is not filled by its edges.
    """
    weights = np.ones(len(antenna_m))
    for row in present:
        places = np.flatnonzero(row)
        if len(places) < 2:
            continue
        order = places[np.argsort(antenna_m[places, 0], kind="stable")]
        lengths = np.gradient(antenna_m[order, 0])
        weights[order] = np.clip(lengths / np.median(lengths), 0.0, 4.0)
    return weights
