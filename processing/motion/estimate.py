"""Velocity of a target along and across the track from its echoes, with uncertainty and what remains ambiguous.

1. Along the path of what stands where the target is seen, its echoes are a chirp: the line in their time-frequency
   distribution tells the speed along the track that they seem to have (of which range velocity and range acceleration
   are a part, see :mod:`processing.motion.prediction`), a search in its surroundings the one with the largest coherent
   sum.
2. Phases of sub-apertures are fitted (least squares, each with the noise beside its own Doppler line) by place and
   speed along the track, again and again until they stay.
3. A picture does not tell whether a target is displaced or moves in range. The beam does: its pattern, fitted to the
   amplitudes of the sub-apertures, tells when the target was abeam, and the range rate of that moment is its own
   (compare the reflectivity displacement of Moreira and Keydel 1995, IEEE TGRS 33(5) 1238). A known place (a road, the
   camera's picture) tells it better.
4. Pulses fold range rates by lambda PRF / 2; the walk through the range profiles tells how often.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from processing.errors import DataError
from processing.motion.path import Path, echoes_along
from processing.motion.time_frequency import chirp_line, time_frequency
from processing.radar.antenna import one_way_gain
from processing.radar.profiles import RangeProfiles

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_ITERATIONS = 6
_LEAST_SNR = 4.0
"""Power over noise of a sub-aperture whose phase is believed."""


@dataclass(frozen=True)
class EstimateSettings:
    """How velocities are looked for."""

    max_azimuth_m_s: float = 20.0
    """Fastest speed along the track."""
    sub_apertures: int = 32
    pointing_sd_rad: float = 0.0
    """How well the beam's direction is known, rad."""
    place_x_m: float | None = None
    """The target's place along the track at time 0 where it is known otherwise (road, camera), m."""
    place_sd_m: float = 5.0


@dataclass(frozen=True)
class MovingTarget:
    """A target's motion on the ground, at time 0; standard deviations are those of the fit."""

    x_m: float
    y_m: float
    azimuth_m_s: float
    """Along the track (x)."""
    azimuth_sd_m_s: float
    ground_m_s: float
    """Across the track (y), on the ground; positive away from it."""
    ground_sd_m_s: float
    slant_m_s: float
    """The same in slant range: the rate at which its range grows when it is abeam."""
    slant_sd_m_s: float
    abeam_s: float
    """When the beam's axis met it."""
    shift_m: float
    """Where a picture of what stands shows it, less where it was at that moment, along the track."""
    snr_db: float
    """Power of the coherent sum over what clutter and noise leave in it."""
    alias: int
    """How often pulses folded the range rate, found from the walk in range."""
    alias_sds: float
    """Standard deviations of that walk between this fold and the next."""
    path: Path
    """The path in which the echoes are coherent: seen x, y and speed."""
    phase_rms_rad: float
    """Of the sub-apertures about the fit; much above the noise's means acceleration or a turn."""

    @property
    def velocity_m_s(self) -> tuple[float, float, float]:
        """vx, vy, vz on level ground."""
        return self.azimuth_m_s, self.ground_m_s, 0.0


def estimate_motion(
    profiles: RangeProfiles,
    time_s: Floats,
    seen_at_m: tuple[float, float, float],
    *,
    beamwidth_rad: float | None,
    channel: int = 0,
    settings: EstimateSettings | None = None,
) -> MovingTarget:
    """Motion of the target that the picture of what stands shows at a place.

    Args:
        profiles: range profiles along a straight track in x, evenly spaced in time.
        time_s: (positions,) times of the pulses.
        seen_at_m: x, y, z in the picture focused for what stands: the middle of its streak.
        beamwidth_rad: half-power beam width of one antenna; None needs ``settings.place_x_m``.
        channel: index into the profiles.
        settings: how to look.

    Raises:
        DataError: neither beam nor place is known, no straight track, or no coherent echo there.
    """
    settings = settings or EstimateSettings()
    time = np.asarray(time_s, dtype=np.float64)
    if beamwidth_rad is None and settings.place_x_m is None:
        raise DataError(
            "a picture alone does not tell displacement from motion in range",
            "give the beam width, or the target's place along the track",
        )
    step, speed = _even_track(profiles, time)
    work = _Work(profiles, time, step, channel, settings.sub_apertures)
    x, y, z = seen_at_m
    path = work.first_path(Path(x, y, z, 0.0), speed, settings.max_azimuth_m_s)
    path = work.in_range(path, cells=2.0)
    for _ in range(_ITERATIONS):
        path, covariance, rms = work.fitted(path)
        path = work.in_range(path)
    blocks = work.blocks(path)
    walk, walk_sd = work.range_walk(path)
    fold = profiles.wavelength_m / (2 * step)
    alias = round(walk / fold)
    if alias:
        raise DataError(
            f"the echoes at x = {x:.0f} m, y = {y:.0f} m walk by {walk:+.1f} m/s more than their phases say",
            "this is a ghost of a target that stands elsewhere; look at its brighter image",
        )
    return _result(work, path, covariance, rms, blocks, speed, beamwidth_rad, settings, abs(fold / walk_sd))


@dataclass(frozen=True)
class _Blocks:
    """Sub-apertures: coherent means along a path and the noise in them."""

    time_s: Floats
    values: Complexes
    noise: Floats
    """Variance of each mean."""

    @property
    def total(self) -> complex:
        """Coherent sum, each with its own weight."""
        amplitude = np.sqrt(np.maximum(np.abs(self.values) ** 2 - self.noise, 0.0))
        return complex(np.sum(self.values * amplitude / self.noise))


class _Work:
    def __init__(self, profiles: RangeProfiles, time: Floats, step: float, channel: int, count: int) -> None:
        self.profiles, self.time, self.step, self.channel = profiles, time, step, channel
        self.length = len(time) // count
        self.count = count
        if self.length < 16:
            raise DataError(f"{len(time)} pulses are too few for {count} sub-apertures", "take fewer, or more pulses")

    def echoes(self, path: Path, offset_m: float = 0.0) -> Complexes:
        ranges = path.ranges_m(self.profiles.antenna_m, self.time)
        return echoes_along(self.profiles, ranges, channel=self.channel, offset_m=offset_m)

    def first_path(self, still: Path, speed: float, max_azimuth: float) -> Path:
        """Place and speed along the track from the time-frequency line, then from the largest coherent sum."""
        wavelength = self.profiles.wavelength_m
        slant = float(np.hypot(still.y_m, still.z_m))
        per_rate = wavelength * slant / (4 * speed)
        keep = max(int(1 / (self.step * 8 * max_azimuth / per_rate)), 1)
        thin = self.echoes(still)[: len(self.time) // keep * keep].reshape(-1, keep).mean(axis=1)
        window = max(min(len(thin) // 6 // 2 * 2, 64), 4)
        tf = time_frequency(thin, self.step * keep, start_s=float(self.time[0]), window=window, width=3)
        line = chirp_line(tf, max_rate_hz_s=max_azimuth / per_rate)
        # A frequency f at time 0 is a range rate -lambda f / 2, of which dx makes -dx V / R.
        here = still.moved(line.frequency_hz * wavelength * slant / (2 * speed), line.rate_hz_s * per_rate)
        best, largest = here, -1.0
        reach = max(0.3 * abs(here.speed_m_s), 1.0)
        size = 4 * len(thin)
        frequency = np.fft.fftfreq(size, self.step * keep)
        for faster in np.linspace(-reach, reach, 61):
            path = here.moved(0.0, faster)
            echo = self.echoes(path)[: len(self.time) // keep * keep].reshape(-1, keep).mean(axis=1)
            spectrum = np.abs(np.fft.fft(echo, size))
            k = int(np.argmax(spectrum))
            if spectrum[k] > largest:
                largest = float(spectrum[k])
                best = path.moved(float(frequency[k]) * wavelength * slant / (2 * speed), 0.0)
        return best

    def blocks(self, path: Path, offset_m: float = 0.0) -> _Blocks:
        used = self.length * self.count
        echo = self.echoes(path, offset_m)[:used].reshape(self.count, self.length)
        shape = np.sin(np.pi * (np.arange(self.length) + 0.5) / self.length) ** 2
        spectrum = np.fft.fft(echo * (shape / shape.sum()), axis=1)
        # Clutter and noise beside the target's own line, whose Hann window reaches two bins.
        beside = np.r_[3:8, -7:-2]
        noise = np.mean(np.abs(spectrum[:, beside]) ** 2, axis=1)
        # The plain mean has 2/3 of the noise of the Hann-weighted one.
        values = echo.mean(axis=1)
        floor = 1e-12 * float(np.max(np.abs(values)) ** 2) + 1e-300
        times = self.time[:used].reshape(self.count, self.length).mean(axis=1)
        return _Blocks(times, values, np.maximum(noise / 1.5, floor))

    def fitted(self, path: Path) -> tuple[Path, Floats, float]:
        """One step of place and speed along the track; their covariance and the phases' rms about the fit."""
        blocks = self.blocks(path)
        snr = np.abs(blocks.values) ** 2 / blocks.noise
        seen = snr > _LEAST_SNR
        if np.count_nonzero(seen) < 6:
            raise DataError(
                f"no steady echo at x = {path.x_m:.0f} m, y = {path.y_m:.0f} m stands above the clutter",
                "look at another place, or at a stronger target",
            )
        times = blocks.time_s[seen]
        phase = np.unwrap(np.angle(blocks.values[seen] * np.conj(blocks.total)))
        phase -= 2 * np.pi * np.rint(np.average(phase, weights=snr[seen]) / (2 * np.pi))
        antenna = np.stack([np.interp(times, self.time, axis) for axis in self.profiles.antenna_m.T], axis=1)
        # A range that is longer by dR than the path's turns the phase by -4 pi dR / lambda.
        turn = -4 * np.pi / self.profiles.wavelength_m
        design = np.stack([np.ones(len(times)), *(turn * path.slopes(antenna, times))], axis=1)
        weight = np.sqrt(2 * snr[seen])
        solution, *_ = np.linalg.lstsq(design * weight[:, None], phase * weight, rcond=None)
        residual = phase - design @ solution
        covariance = np.linalg.inv((design * weight[:, None]).T @ (design * weight[:, None]))
        excess = float(np.sum((residual * weight) ** 2) / max(len(times) - 3, 1))
        rms = float(np.sqrt(np.average(residual**2, weights=snr[seen])))
        return path.moved(float(solution[1]), float(solution[2])), covariance[1:, 1:] * max(excess, 1.0), rms

    def in_range(self, path: Path, cells: float = 0.5) -> Path:
        """The path moved in y, by up to some resolution cells, to where the coherent sum is largest."""
        half = 0.5 * self.profiles.resolution_m
        offsets = np.arange(-cells, cells + 0.25, 0.5) * self.profiles.resolution_m
        middle = self.blocks(path)
        amplitude = np.sqrt(np.maximum(np.abs(middle.values) ** 2 - middle.noise, 0.0)) / middle.noise
        turned = amplitude * np.exp(-1j * np.angle(middle.values))
        if not amplitude.any():
            return path
        # The largest sum of real parts keeps the sub-apertures' phases; noise elsewhere has none of them.
        sums = np.array([abs(np.sum(self.blocks(path, offset).values * turned)) for offset in offsets])
        k = int(np.clip(np.argmax(sums), 1, len(sums) - 2))
        bend = sums[k - 1] - 2 * sums[k] + sums[k + 1]
        part = 0.0 if bend >= 0 else float(np.clip(0.5 * (sums[k - 1] - sums[k + 1]) / bend, -1, 1))
        by = float(offsets[k]) + part * half
        slant = float(np.hypot(path.y_m, path.z_m))
        return Path(path.x_m, path.y_m + by * slant / path.y_m, path.z_m, path.speed_m_s)

    def range_walk(self, path: Path) -> tuple[float, float]:
        """Rate at which the echoes' envelope leaves the path, m/s, and its standard deviation."""
        cell = self.profiles.resolution_m
        middle = self.blocks(path)
        turned = np.exp(-1j * np.angle(middle.values))
        near, far = ((self.blocks(path, offset).values * turned).real for offset in (-0.5 * cell, 0.5 * cell))
        snr = np.maximum(np.abs(middle.values) ** 2 / middle.noise - 1, 0.0)
        # A parabola through three samples of the envelope; its bend is that of all sub-apertures together.
        level = np.abs(middle.values)
        bend = float(np.sum(snr * (2 - (near + far) / level)) / max(float(snr.sum()), 1e-300))
        away = np.clip(0.25 * cell * (far - near) / level / max(bend, 1e-3), -cell, cell)
        times = middle.time_s - np.average(middle.time_s, weights=snr)
        spread = float(np.sum(snr * times**2))
        slope = float(np.sum(snr * times * away)) / spread
        scatter = float(np.sqrt(np.average((away - slope * times) ** 2, weights=snr)))
        independent = max(float(snr.sum() ** 2 / np.sum(snr**2)), 1.0)
        return slope, scatter / math.sqrt(independent * spread / float(snr.sum()))


def _even_track(profiles: RangeProfiles, time: Floats) -> tuple[float, float]:
    """Time between pulses and speed along x."""
    if time.shape != (len(profiles.antenna_m),) or len(time) < 32:
        raise DataError(f"{time.shape} times for {len(profiles.antenna_m)} positions", "give one time for each")
    gaps = np.diff(time)
    step = float(np.median(gaps))
    if not (step > 0 and np.abs(gaps - step).max() < 0.01 * step):
        raise DataError("the pulses are not evenly spaced in time", "interpolate them, or leave out what is irregular")
    rate = np.polyfit(time, profiles.antenna_m, 1)
    off = profiles.antenna_m - (rate[0] * time[:, None] + rate[1])
    across = float(np.hypot(rate[0][1], rate[0][2]))
    if rate[0][0] == 0 or across > 1e-3 * abs(rate[0][0]) or np.abs(off).max() > profiles.wavelength_m:
        raise DataError("the track is not straight along x at constant speed", "use another part of the flight")
    return step, float(rate[0][0])


def _result(
    work: _Work, path: Path, covariance: Floats, rms: float, blocks: _Blocks, speed: float,
    beamwidth_rad: float | None, settings: EstimateSettings, alias_sds: float,
) -> MovingTarget:  # fmt: skip
    antenna, time = work.profiles.antenna_m, work.time
    middle = float(np.interp(0.0, time, antenna[:, 0]))
    closing = float(speed - path.speed_m_s)
    slant = float(np.hypot(path.y_m - antenna[:, 1].mean(), path.z_m - antenna[:, 2].mean()))
    if settings.place_x_m is not None:
        abeam = (settings.place_x_m - middle) / closing
        abeam_sd = settings.place_sd_m / abs(closing)
    else:
        assert beamwidth_rad is not None
        ranges = np.interp(blocks.time_s, time, path.ranges_m(antenna, time))
        abeam, abeam_sd = _abeam(blocks, ranges, closing, beamwidth_rad)
        abeam_sd = math.hypot(abeam_sd, slant * settings.pointing_sd_rad / abs(closing))
    # Range, its rate and their slopes by place and speed of the path, at the moment the target was abeam.
    ahead = path.x_m + path.speed_m_s * abeam - (middle + speed * abeam)
    distance = math.hypot(ahead, slant)
    rate = float(-closing * ahead / distance)
    slopes = np.array([-closing / distance, -closing / distance * abeam + ahead / distance])
    bend = closing**2 / distance
    rate_sd = math.sqrt(float(slopes @ covariance @ slopes) + (bend * abeam_sd) ** 2)
    height = path.z_m - float(antenna[:, 2].mean())
    away = math.sqrt(distance**2 - height**2)
    ground, ground_sd = rate * distance / away, rate_sd * distance / away
    along = speed - math.copysign(math.sqrt(max(closing**2 - ground**2, 0.0)), speed)
    along_sd = math.hypot(math.sqrt(float(covariance[1, 1])), ground / closing * ground_sd)
    snr = float(np.sum(np.maximum(np.abs(blocks.values) ** 2 / blocks.noise - 1, 0.0)))
    return MovingTarget(
        x_m=middle + (speed - along) * abeam,
        y_m=float(antenna[:, 1].mean()) + away - ground * abeam,
        azimuth_m_s=along,
        azimuth_sd_m_s=along_sd,
        ground_m_s=ground,
        ground_sd_m_s=ground_sd,
        slant_m_s=rate,
        slant_sd_m_s=rate_sd,
        abeam_s=abeam,
        shift_m=float(closing * ahead / speed),
        snr_db=10 * math.log10(max(snr, 1e-30)),
        alias=0,
        alias_sds=alias_sds,
        path=path,
        phase_rms_rad=rms,
    )


def _abeam(blocks: _Blocks, range_m: Floats, closing_m_s: float, beamwidth_rad: float) -> tuple[float, float]:
    """When the beam's axis met the target, s, and its standard deviation: the pattern fitted to the amplitudes.

    The range counts: a target that recedes stays longer in the beam behind than before it.
    """
    turned = (blocks.values * np.exp(-1j * np.angle(blocks.total))).real
    sd = np.sqrt(blocks.noise / 2)
    power = np.maximum(turned, 0.0) ** 2 / blocks.noise
    start = float(np.average(blocks.time_s, weights=power))

    def residual(numbers: Floats) -> Floats:
        sine = np.clip(closing_m_s * (blocks.time_s - numbers[1]) / range_m, -1, 1)
        cosine = np.sqrt(1 - sine**2)
        return np.asarray((numbers[0] * one_way_gain(cosine, beamwidth_rad) - turned) / sd)

    scale = float(np.max(turned))
    fit = least_squares(residual, [scale, start], x_scale=[scale, 1.0])
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    excess = max(2 * float(fit.cost) / max(len(sd) - 2, 1), 1.0)
    if not blocks.time_s[0] < fit.x[1] < blocks.time_s[-1]:
        raise DataError("the beam met the target before or after the collect", "use a longer one, or give its place")
    return float(fit.x[1]), math.sqrt(float(covariance[1, 1]) * excess)
