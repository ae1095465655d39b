"""Range compression: whole up-ramps of beat samples to complex range profiles.

The beat of a point at range R during the up-ramp, with t from the ramp's centre, tau = 2 R / c and K = B / T, is
``v(t) = Re{conj(a) exp(+j (2 pi tau (f_c + K t) - pi K tau^2))}``. Its windowed spectrum at the beat frequency of the
range r, conjugated, with the residual video phase taken off,

    p(r) = conj( 2 / sum(w) * sum_n w_n (v_n - mean_w(v)) exp(-j 2 pi K (2 r / c) t_n) ) exp(-j pi K (2 r / c)^2),

is ``a exp(-j 4 pi f_c R / c) W(r - R)`` with a real, even envelope W and W(0) = 1: the convention of
:class:`processing.radar.profiles.RangeProfiles`. Samples lie at ``t_n`` relative to the centre of the *measured* ramp,
fractions of a sample included, and the window is evaluated there.

The beat is real: besides p stands its mirror image at -R, and the weighted mean is taken off, so that targets nearer
than about two resolution cells (Hann) are distorted; ``tests/ranging`` states by how much.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import ZoomFFT
from scipy.signal.windows import taylor

from processing.errors import DataError, undefined_is_nan
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.radar.sync import Sync

Window = Literal["hann", "taylor", "rectangular"]
WINDOWS: tuple[Window, ...] = ("hann", "taylor", "rectangular")

_TAYLOR_TERMS, _TAYLOR_LEVEL_DB = 4, 35.0


@dataclass(frozen=True, eq=False)
class Sweeps:
    """Beat samples of whole up-ramps."""

    beat: NDArray[np.float64]
    """(sweeps, samples) beat, as a fraction of full scale (see :func:`full_scale`)."""
    first: NDArray[np.float64]
    """(sweeps,) instant of the first sample after its ramp's start, samples (0 to 1)."""
    ramp_samples: float
    """Length of the ramp, samples; sweeps of one set share it."""
    sample_rate_hz: float
    """Sample rate, Hz."""
    start_s: NDArray[np.float64]
    """(sweeps,) start of each ramp since the recording's first sample, s."""

    @property
    def ramp_s(self) -> float:
        """Length of the ramp, s."""
        return self.ramp_samples / self.sample_rate_hz


def cut_sweeps(
    samples: NDArray[np.generic], sync: Sync, *, count: int | None = None, ramp_samples: float | None = None
) -> Sweeps:
    """Cut the beat of the whole up-ramps out of a recording.

    Args:
        samples: (n, 2) the recording that ``sync`` was measured in.
        sync: its sync.
        count: take only the first so many whole up-ramps.
        ramp_samples: length to give to the ramps instead of the median measured in this recording (that of a
            whole session, for example).

    Raises:
        DataError: fewer than ``count`` whole up-ramps.
    """
    samples = np.asarray(samples)
    starts = sync.starts
    ramp = sync.ramp_samples if ramp_samples is None else float(ramp_samples)
    if count is not None:
        if len(starts) < count:
            raise DataError(f"{len(starts)} whole up-ramps, {count} wanted", "record longer")
        starts = starts[:count]
    index = np.ceil(starts).astype(np.intp)
    length = int(np.floor(ramp)) + 1
    inside = index + length <= len(samples)
    starts, index = starts[inside], index[inside]
    if not len(starts) or (count is not None and len(starts) < count):
        raise DataError("the last up-ramp is cut off", "record longer")
    beat = samples[index[:, None] + np.arange(length), sync.beat_channel] / full_scale(samples.dtype)
    return Sweeps(beat, index - starts, ramp, sync.sample_rate_hz, starts / sync.sample_rate_hz)


def full_scale(dtype: np.dtype[Any]) -> float:
    """Counts of full scale of a sample type: 2^(bits - 1) for integers, 1 for floating point."""
    return 2.0 ** (8 * dtype.itemsize - 1) if dtype.kind in "iu" else 1.0


def range_axis(bandwidth_hz: float, max_range_m: float, oversampling: int = 8) -> NDArray[np.float64]:
    """Uniform ranges from 0 to at least ``max_range_m`` in steps of the resolution c / 2B over ``oversampling``, m.

    Raises:
        DataError: bandwidth, range or oversampling not positive.
    """
    if not (bandwidth_hz > 0 and np.isfinite(max_range_m) and max_range_m > 0 and oversampling >= 1):
        raise DataError(
            f"bandwidth {bandwidth_hz} Hz, maximum range {max_range_m} m and oversampling {oversampling} do not make "
            "a range axis", "give positive ones")  # fmt: skip
    step = SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz) / oversampling
    axis: NDArray[np.float64] = np.arange(int(np.ceil(max_range_m / step - 1e-9)) + 1, dtype=np.float64) * step
    return axis


def unambiguous_range_m(bandwidth_hz: float, ramp_samples: float) -> float:
    """Range whose beat stands at half the sample rate, m: c T f_s / 4B."""
    return SPEED_OF_LIGHT_M_S * ramp_samples / (4 * bandwidth_hz)


def window_weights(window: str, position: ArrayLike, ramp_samples: float) -> NDArray[np.float64]:
    """Window over the ramp at any position, times the share of each sample's interval that lies in the ramp.

    Args:
        window: ``"hann"``, ``"taylor"`` (4 terms, -35 dB) or ``"rectangular"``.
        position: instants as fractions of the ramp from its centre; the ramp is -1/2 to 1/2.
        ramp_samples: length of the ramp in samples.

    Raises:
        DataError: unknown window.
    """
    position = np.asarray(position, dtype=np.float64)
    if window == "hann":
        shape = np.cos(np.pi * position) ** 2
    elif window == "taylor":
        terms = _taylor_terms()
        shape = 1 + 2 * sum(f * np.cos(2 * np.pi * (m + 1) * position) for m, f in enumerate(terms))
    elif window == "rectangular":
        shape = np.ones_like(position)
    else:
        raise DataError(f"unknown window {window!r}", f"choose one of {', '.join(WINDOWS)}")
    covered = np.clip((0.5 - np.abs(position)) * ramp_samples + 0.5, 0.0, 1.0)
    weights: NDArray[np.float64] = np.where(covered > 0, shape * covered, 0.0)
    return weights


def _taylor_terms() -> NDArray[np.float64]:
    """Cosine terms F_m of the Taylor window, read off SciPy's samples of it."""
    count = 64
    samples = taylor(count, nbar=_TAYLOR_TERMS, sll=_TAYLOR_LEVEL_DB, norm=False)
    position = (np.arange(count) + 0.5) / count - 0.5
    terms: NDArray[np.float64] = np.array(
        [np.mean(samples * np.cos(2 * np.pi * m * position)) for m in range(1, _TAYLOR_TERMS)]
    )
    return terms


def compress(
    sweeps: Sweeps,
    range_m: NDArray[np.float64],
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "hann",
    range_offset_m: float = 0.0,
) -> NDArray[np.complex128]:
    """Range profiles of sweeps on a uniform range axis, by a chirp-z transform of each sweep.

    Each sweep is transformed alone, so that its profile has the same bits in any company.

    Args:
        sweeps: the up-ramps.
        range_m: (bins,) uniform range axis from the antennas, m (see :func:`range_axis`).
        centre_hz: frequency at the ramp's centre, Hz.
        bandwidth_hz: frequency swept in the ramp, Hz.
        window: ``"hann"``, ``"taylor"`` or ``"rectangular"``.
        range_offset_m: range that cables and electronics add, m; targets appear at their range without it.

    Returns:
        (sweeps, bins) profiles; a point whose beat has amplitude a has |profile| = a at its range.

    Raises:
        DataError: axis not uniform, beyond the unambiguous range, unknown window.
    """
    path = _path(sweeps, range_m, bandwidth_hz, range_offset_m)
    step = float(path[1] - path[0]) if len(path) > 1 else 1.0
    if len(path) > 1 and np.abs(np.diff(path) - step).max() > 1e-6 * step:
        raise DataError("the range axis is not uniform", "make it with range_axis()")
    cycles = _cycles_per_sample(path, sweeps.ramp_samples, bandwidth_hz)
    pitch = float(cycles[-1] - cycles[0]) / max(len(path) - 1, 1)
    zoom = ZoomFFT(sweeps.beat.shape[1], [cycles[0], cycles[0] + pitch * len(path)], m=len(path), fs=1.0)
    profiles = np.empty((len(sweeps.beat), len(path)), dtype=np.complex128)
    for index, (beat, first) in enumerate(zip(sweeps.beat, sweeps.first, strict=True)):
        weights, delay = _weights(sweeps, float(first), window)
        spectrum = zoom(_without_mean(beat, weights)) * _turns(-cycles * delay)
        profiles[index] = 2 / weights.sum() * np.conj(spectrum)
    profiles *= _carrier(path, sweeps.ramp_s, centre_hz, bandwidth_hz, range_offset_m)
    return profiles


def compress_reference(
    sweeps: Sweeps,
    range_m: NDArray[np.float64],
    *,
    centre_hz: float,
    bandwidth_hz: float,
    window: str = "hann",
    range_offset_m: float = 0.0,
) -> NDArray[np.complex128]:
    """The definition of :func:`compress`: a direct sum at each range of any axis. Slow."""
    path = _path(sweeps, range_m, bandwidth_hz, range_offset_m)
    cycles = _cycles_per_sample(path, sweeps.ramp_samples, bandwidth_hz)
    profiles = np.empty((len(sweeps.beat), len(path)), dtype=np.complex128)
    samples = np.arange(sweeps.beat.shape[1])
    for index, (beat, first) in enumerate(zip(sweeps.beat, sweeps.first, strict=True)):
        weights, delay = _weights(sweeps, float(first), window)
        kernel = np.exp(-2j * np.pi * cycles[:, None] * (samples + delay))
        profiles[index] = 2 / weights.sum() * np.conj((kernel * _without_mean(beat, weights)).sum(axis=1))
    profiles *= _carrier(path, sweeps.ramp_s, centre_hz, bandwidth_hz, range_offset_m)
    return profiles


@undefined_is_nan
def average(profiles: NDArray[np.complexfloating]) -> NDArray[np.complex128]:
    """Mean over the first axis whose bits do not depend on the order of the profiles.

    Real and imaginary parts are sorted along the axis before they are added, smallest first.
    """
    values = np.asarray(profiles, dtype=np.complex128)
    real, imaginary = np.sort(values.real, axis=0), np.sort(values.imag, axis=0)
    total: NDArray[np.complex128] = np.zeros(values.shape[1:], dtype=np.complex128)
    for index in range(len(values)):
        total.real += real[index]
        total.imag += imaginary[index]
    return total / len(values)


def remove_coupling(
    profiles: NDArray[np.complexfloating], reference: NDArray[np.complexfloating] | None = None
) -> NDArray[np.complexfloating]:
    """Take the direct coupling between the antennas off.

    Args:
        profiles: (..., positions, bins).
        reference: profile of the coupling alone, broadcast against ``profiles`` (from a sky recording); without it the
            mean over positions is taken, which also removes what does not change along the rail.
    """
    if reference is None:
        with np.errstate(invalid="ignore"):
            known = np.isfinite(profiles).all(axis=-1, keepdims=True)
            count = np.maximum(known.sum(axis=-2, keepdims=True), 1)
            reference = np.where(known, profiles, 0).sum(axis=-2, keepdims=True) / count
    result: NDArray[np.complexfloating] = (profiles - reference).astype(profiles.dtype)
    return result


@undefined_is_nan
def noise_of_average(profiles: NDArray[np.complexfloating]) -> float:
    """Noise power of one bin of the average of several sweeps' profiles, from how much the sweeps differ.

    Args:
        profiles: (sweeps, bins) not range-compensated, so that the noise is white.

    Returns:
        The typical bin's ``sum |p - mean|^2 / (n (n - 1))``: their median, which what changes from sweep to sweep in a
        few bins does not move, over that of a gamma distribution (Wilson and Hilferty 1931). NaN for one sweep.
    """
    count = len(profiles)
    if count < 2 or not profiles.size:
        return float("nan")
    values = np.asarray(profiles, dtype=np.complex128)
    # Both averages do not depend on the order of the sweeps, so neither does this.
    scatter = average(np.abs(values) ** 2).real - np.abs(average(values)) ** 2
    degrees = count - 1
    median_over_mean = (1 - 1 / (9 * degrees)) ** 3
    return float(max(np.median(scatter) / degrees / median_over_mean, 0.0))


def above_noise(reference: NDArray[np.complexfloating], noise: NDArray[np.float64]) -> NDArray[np.complex128]:
    """What of a reference profile stands above its own noise; the rest is dropped.

    A reference is subtracted at every position, so its noise would add up coherently along the aperture, to a bright
    streak abreast of the rail. With noise power N, amplitudes are kept where their power is above 10 N and dropped
    below 4 N, with a straight line in power between (firm threshold, Gao and Bruce 1997). Complex Gaussian noise alone
    exceeds 4 N in 2 % of the bins, 10 N in 5 of 100,000.

    Args:
        reference: (..., bins) not range-compensated.
        noise: (...) noise power of one bin; where it is NaN (unknown) everything is kept.
    """
    values = np.asarray(reference, dtype=np.complex128)
    level = np.asarray(noise, dtype=np.float64)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((np.abs(values) ** 2 / level - 4) / 6, 0.0, 1.0)
    return np.asarray(values * np.where(level > 0, share, 1.0))


def _path(
    sweeps: Sweeps, range_m: NDArray[np.float64], bandwidth_hz: float, range_offset_m: float
) -> NDArray[np.float64]:
    """Ranges with the electronics' share, checked against the sample rate."""
    path = np.asarray(range_m, dtype=np.float64) + range_offset_m
    if path.ndim != 1 or not len(path) or not np.isfinite(path).all():
        raise DataError("the range axis is empty or undefined", "make it with range_axis()")
    limit = unambiguous_range_m(bandwidth_hz, sweeps.ramp_samples)
    if np.abs(path).max() > limit * (1 + 1e-9):
        raise DataError(
            f"ranges up to {np.abs(path).max():.1f} m are asked for, the sample rate allows {limit:.1f} m",
            "ask for a shorter range",
        )
    return path


def _cycles_per_sample(path: NDArray[np.float64], ramp_samples: float, bandwidth_hz: float) -> NDArray[np.float64]:
    """Beat frequency of each range in cycles per sample: K tau / f_s."""
    return 2 * bandwidth_hz * path / (SPEED_OF_LIGHT_M_S * ramp_samples)


def _weights(sweeps: Sweeps, first: float, window: str) -> tuple[NDArray[np.float64], float]:
    """Window of one sweep and the instant of its first sample from the ramp's centre, samples."""
    delay = first - sweeps.ramp_samples / 2
    position = (np.arange(sweeps.beat.shape[1]) + delay) / sweeps.ramp_samples
    return window_weights(window, position, sweeps.ramp_samples), delay


def _without_mean(beat: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    result: NDArray[np.float64] = weights * (beat - (weights * beat).sum() / weights.sum())
    return result


def _turns(turns: NDArray[np.float64]) -> NDArray[np.complex128]:
    """exp(j 2 pi turns), reduced before it is scaled."""
    phase: NDArray[np.complex128] = np.exp(2j * np.pi * (turns - np.round(turns)))
    return phase


def _carrier(
    path: NDArray[np.float64], ramp_s: float, centre_hz: float, bandwidth_hz: float, range_offset_m: float
) -> NDArray[np.complex128]:
    """Residual video phase off, and the carrier's phase over the electronics' own path off."""
    delay = 2 * path / SPEED_OF_LIGHT_M_S
    offset = 2 * range_offset_m * centre_hz / SPEED_OF_LIGHT_M_S
    return _turns(-bandwidth_hz / ramp_s * delay**2 / 2 + offset)
