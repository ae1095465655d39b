"""From image amplitudes to scattering amplitudes: find the calibration target, and the constant that it gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.rcs import to_dbsm
from processing.errors import DataError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]

DB_PER_NEPER_OF_POWER = float(10 / np.log(10))


@dataclass(frozen=True)
class TargetPeak:
    """A point-like target in an image."""

    row: int
    column: int
    """Brightest pixel."""
    x_m: float
    y_m: float
    """Place of the peak between the pixels, m."""
    values: NDArray[np.complex128]
    """(channels,) image values at the peak: the brightest pixel's, scaled to the peak between the pixels."""
    power: float
    """|value|^2 of the reference channel."""
    background: float
    """Mean power of the image's background in the reference channel (noise, clutter and side lobes)."""

    @property
    def snr_db(self) -> float:
        """Peak power over background, dB; infinite without background."""
        return float(to_dbsm(self.power / self.background)) if self.background > 0 else float("inf")


def background_power(image: ArrayLike) -> float:
    """Mean power of an image's background: median of |image|^2 over ln 2; NaN pixels are left out.

    The power of complex Gaussian noise is exponentially distributed, whose median is ln 2 times its mean. Targets
    that cover less than half of the image hardly move a median; where they cover more, this is an upper bound.
    """
    values = np.asarray(image)
    power = (values.real.astype(np.float64) ** 2 + values.imag.astype(np.float64) ** 2)[np.isfinite(values)]
    return float(np.median(power) / np.log(2)) if power.size else float("nan")


def locate_target(
    image: ArrayLike,
    x_m: ArrayLike,
    y_m: ArrayLike,
    at: tuple[float, float],
    *,
    radius_m: float,
    reference: int = 0,
    min_snr_db: float = 10.0,
    gain: ArrayLike = 1.0,
) -> TargetPeak:
    """Find the brightest local maximum near the stated place of a target.

    The peak between the pixels comes from a parabola through the logarithms of three pixels in each direction (exact
    for a Gaussian main lobe). The image's phase turns with range, so values between pixels are not interpolated:
    the brightest pixel's are scaled by the reference channel's gain, which keeps the ratios of the channels.

    Args:
        image: (channels, ny, nx) complex focused image.
        x_m: (nx,) m.
        y_m: (ny,) m.
        at: stated place (x, y) in the image, m.
        radius_m: how far from there the peak may be, m.
        reference: index of the channel in which to look.
        min_snr_db: smallest peak over background, dB.
        gain: amplitude gain that the image contains and that changes over a main lobe, broadcast to (ny, nx); the peak
            is looked for without it (see :func:`processing.sar.quality.range_gain`).

    Raises:
        DataError: the place is outside the image, there is no local maximum near it, or it is too weak.
    """
    values = np.asarray(image)
    x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
    place = f"({at[0]:.2f}, {at[1]:.2f}) m"
    if not (np.isfinite(at).all() and x[0] <= at[0] <= x[-1] and y[0] <= at[1] <= y[-1]):
        raise DataError(
            f"the target's stated place {place} is outside the image (x {x[0]:.2f} to {x[-1]:.2f}, "
            f"y {y[0]:.2f} to {y[-1]:.2f} m)",
            "give its x along the rail and its ground range y, or focus a larger grid",
        )
    amplification = np.broadcast_to(np.asarray(gain, dtype=np.float64), values.shape[1:])
    power = np.abs(values[reference].astype(np.complex128) / amplification) ** 2
    background = background_power(values[reference])
    filled = np.where(np.isfinite(power), power, -np.inf)
    peaks = _local_maxima(filled) & (np.hypot(x[None, :] - at[0], y[:, None] - at[1]) <= radius_m)
    if not peaks.any():
        raise DataError(
            f"there is no peak within {radius_m:.2f} m of the target's stated place {place}",
            "check the place against the focused picture, or allow a larger search radius",
        )
    row, column = (int(i) for i in np.unravel_index(np.argmax(np.where(peaks, filled, -np.inf)), filled.shape))
    dx, rise_x = _parabola(filled[row, column - 1 : column + 2])
    dy, rise_y = _parabola(filled[row - 1 : row + 2, column])
    slope_y, slope_x = (np.gradient(amplification, axis=axis)[row, column] for axis in (0, 1))
    at_peak = amplification[row, column] + dx * slope_x + dy * slope_y
    rise = rise_x * rise_y * (at_peak / amplification[row, column]) ** 2
    peak = TargetPeak(
        row=row,
        column=column,
        x_m=float(x[column] + dx * (x[1] - x[0])),
        y_m=float(y[row] + dy * (y[1] - y[0])),
        values=values[:, row, column].astype(np.complex128) * np.sqrt(rise),
        power=float(power[row, column] * amplification[row, column] ** 2 * rise),
        background=background,
    )
    if not np.isfinite(peak.values).all():
        raise DataError(f"the image is undefined in a channel at the target's place {place}", "focus it again")
    if peak.snr_db < min_snr_db:
        raise DataError(
            f"the brightest peak within {radius_m:.2f} m of {place} stands only {peak.snr_db:.1f} dB above the "
            f"background (at least {min_snr_db:.1f} dB is needed)",
            "use a larger or nearer target, more sweeps, or check its place",
        )
    return peak


def snr_sd_db(snr_db: float) -> float:
    """Standard deviation of a peak's power in dB that complex noise of mean power 1/SNR adds.

    With amplitude a and noise power N, ``sd(|a + n|^2) = sqrt(2 a^2 N)`` to first order.
    """
    return float(DB_PER_NEPER_OF_POWER * np.sqrt(2 * 10 ** (-snr_db / 10)))


@dataclass(frozen=True)
class AmplitudeMap:
    """Image power to RCS: ``rcs_dbsm = slope * power_db + constant_db``. Physics wants a slope of 1."""

    slope: float
    constant_db: float

    def rcs_dbsm(self, power: ArrayLike) -> Floats:
        """RCS of image powers, dBsm; zero power gives -inf."""
        return self.slope * to_dbsm(power) + self.constant_db

    def scattering(self, image: ArrayLike) -> NDArray[np.complex128]:
        """Scattering amplitudes of image values, sqrt(m^2); phases are kept, NaN stays NaN."""
        values = np.asarray(image, dtype=np.complex128)
        factor = 10 ** (self.constant_db / 20)
        if self.slope == 1.0:
            return np.asarray(values * factor)
        magnitude = np.abs(values)
        with np.errstate(divide="ignore", invalid="ignore"):
            scaled = values * factor * magnitude ** (self.slope - 1)
        return np.asarray(np.where(magnitude == 0, 0, scaled))


def offset_map(peak_power: float, expected_rcs_m2: float) -> AmplitudeMap:
    """The constant that gives the target its expected RCS (thesis 5.9 with slope 1)."""
    _positive("peak power of the target", peak_power)
    _positive("expected RCS of the target", expected_rcs_m2)
    return AmplitudeMap(1.0, float(to_dbsm(expected_rcs_m2) - to_dbsm(peak_power)))


def two_point_map(
    peak_power: float, expected_rcs_m2: float, noise_power: float, noise_rcs_dbsm: float = 0.0
) -> AmplitudeMap:
    """The map that the thesis draws through target and noise (5.9), with the noise at ``noise_rcs_dbsm``.

    Kept to reproduce the thesis: a slope other than 1 contradicts RCS being proportional to received power.

    Raises:
        DataError: the noise is not below the target.
    """
    _positive("peak power of the target", peak_power)
    _positive("expected RCS of the target", expected_rcs_m2)
    _positive("noise power", noise_power)
    if noise_power >= peak_power:
        raise DataError("the noise is as strong as the target", "use a stronger target or offset calibration")
    top, peak_db, noise_db = (float(to_dbsm(value)) for value in (expected_rcs_m2, peak_power, noise_power))
    slope = (top - noise_rcs_dbsm) / (peak_db - noise_db)
    return AmplitudeMap(slope, noise_rcs_dbsm - slope * noise_db)


def _local_maxima(power: Floats) -> NDArray[np.bool_]:
    """Pixels not below any of their eight neighbours and above -inf; the image's border is never one."""
    inner = power[1:-1, 1:-1]
    best = np.full(inner.shape, -np.inf)
    rows, columns = power.shape
    for i in range(3):
        for j in range(3):
            if (i, j) != (1, 1):
                np.maximum(best, power[i : rows - 2 + i, j : columns - 2 + j], out=best)
    found = np.zeros(power.shape, dtype=bool)
    # A plateau, such as an empty image, has no peak.
    found[1:-1, 1:-1] = (inner >= best) & (inner > 0) & (inner > _lowest_neighbour(power))
    return found


def _lowest_neighbour(power: Floats) -> Floats:
    rows, columns = power.shape
    lowest = np.full((rows - 2, columns - 2), np.inf)
    for i, j in ((0, 1), (1, 0), (1, 2), (2, 1)):
        np.minimum(lowest, power[i : rows - 2 + i, j : columns - 2 + j], out=lowest)
    return lowest


def _parabola(power: Floats) -> tuple[float, float]:
    """Offset in pixels of the vertex through three log powers, and the vertex's power over the middle one."""
    if not (power > 0).all() or not np.isfinite(power).all():
        return 0.0, 1.0
    below, middle, above = np.log(power)
    curvature = below - 2 * middle + above
    if curvature >= 0:
        return 0.0, 1.0
    offset = float(np.clip(0.5 * (below - above) / curvature, -0.5, 0.5))
    return offset, float(np.exp(-0.25 * (below - above) * offset))


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"the {name} is {value}", "it must be positive and finite; check target and image")
