"""How the thesis looks at a target in an image (its Fig. 5.16): a strip around it against range, and a square region.

Powers are means of |image|^2 over pixels; undefined (NaN) pixels are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

FOOT_M = 0.3048
STRIP_M = 2 * FOOT_M
"""Width of the thesis's strip and edge of its region."""


def strip_power(image: ArrayLike, x_m: ArrayLike, centre_m: float, width_m: float = STRIP_M) -> Floats:
    """Mean power (channels, ny) over the columns within ``width_m`` around ``centre_m``, for each row.

    Args:
        image: (channels, ny, nx) complex.
        x_m: (nx,) m.
        centre_m: middle of the strip, m.
        width_m: its width, m (thesis: 2 ft).

    Raises:
        DataError: the strip holds no column, or is partly outside the image.
    """
    values, columns = _checked(image), _within(x_m, centre_m, width_m, "cross-range")
    return _mean(np.abs(values[:, :, columns]) ** 2, axis=2)


@dataclass(frozen=True, eq=False)
class RegionMatrices:
    """Scattering of a region relative to HH, [receive, transmit] with H before V; NaN where there is no channel.

    From received powers, as the thesis prints it (5.11, 5.14, 5.15), and from complex amplitudes. The two say different
    things: powers do not tell a trihedral from a dihedral, whose VV has the opposite sign.
    """

    power: Floats
    """(2, 2) mean received power over that of HH."""
    complex: Complexes
    """(2, 2) ``<S HH*> / <|HH|^2>``: least-squares amplitude relative to HH."""
    coherence: Floats
    """(2, 2) ``|<S HH*>| / sqrt(<|S|^2> <|HH|^2>)``: 1 where a channel is a multiple of HH all over the region."""
    hh_power: float
    """Mean power of HH that they are relative to, in the image's unit."""
    pixels: int


def region_matrices(
    image: ArrayLike,
    channels: Sequence[str],
    x_m: ArrayLike,
    y_m: ArrayLike,
    at: tuple[float, float],
    *,
    size_m: float = STRIP_M,
) -> RegionMatrices:
    """Matrices of a square region of an image.

    Args:
        image: (channels, ny, nx) complex.
        channels: names, transmit-then-receive.
        x_m, y_m: (nx,), (ny,) m.
        at: middle (x, y) of the region, m.
        size_m: its edge, m (thesis: 2 ft).

    Raises:
        DataError: the region holds no pixel or is partly outside the image, there is no HH, or it is zero there.
    """
    values = _checked(image)
    if "HH" not in channels or len(channels) != len(values):
        raise DataError(
            f"channels {', '.join(channels)} of an image with {len(values)} planes", "give one name each, HH among them"
        )
    rows, columns = _within(y_m, at[1], size_m, "ground-range"), _within(x_m, at[0], size_m, "cross-range")
    part = values[:, rows][:, :, columns].reshape(len(values), -1)
    defined = np.isfinite(part).all(axis=0)
    part = part[:, defined]
    hh = part[list(channels).index("HH")] if defined.any() else np.empty(0)
    level = float(np.mean(np.abs(hh) ** 2)) if hh.size else 0.0
    if not level > 0:
        raise DataError(
            f"HH is zero or undefined in the whole region around ({at[0]:.2f}, {at[1]:.2f}) m",
            "look at another place",
        )
    power, relative = np.full((2, 2), np.nan), np.full((2, 2), np.nan + 1j * np.nan)
    coherence = np.full((2, 2), np.nan)
    for name, plane in zip(channels, part, strict=True):
        where = "HV".index(name[1]), "HV".index(name[0])
        strength = float(np.mean(np.abs(plane) ** 2))
        together = complex(np.mean(plane * hh.conj()))
        power[where], relative[where] = strength / level, together / level
        coherence[where] = min(abs(together) / np.sqrt(strength * level), 1.0) if strength > 0 else np.nan
    return RegionMatrices(power, relative, coherence, level, int(defined.sum()))


@dataclass(frozen=True, eq=False)
class Repeats:
    """Mean of the powers of repeated measurements, and how well it is known."""

    mean: Floats
    """Mean power, of the shape of one measurement."""
    sd_db: Floats
    """Standard deviation of one measurement, dB to first order; NaN for a single one."""
    mean_sd_db: Floats
    """Standard deviation of the mean: ``sd_db / sqrt(n)``."""
    count: int


def mean_of_repeats(powers: Sequence[ArrayLike]) -> Repeats:
    """Mean power of n repeated measurements (thesis 5.5 takes four), each of one shape.

    Raises:
        DataError: no measurement, or shapes that differ.
    """
    measured = [np.asarray(power, dtype=np.float64) for power in powers]
    if not measured or any(item.shape != measured[0].shape for item in measured):
        raise DataError(
            f"{len(measured)} measurements have shapes {sorted({item.shape for item in measured})}",
            "give at least one, all on the same grid",
        )
    stack = np.stack(measured)
    mean = stack.mean(axis=0)
    if len(measured) == 1:
        unknown = np.full(mean.shape, np.nan)
        return Repeats(mean, unknown, unknown, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sd_db = 10 / np.log(10) * np.where(mean > 0, stack.std(axis=0, ddof=1) / mean, np.nan)
    return Repeats(mean, sd_db, sd_db / np.sqrt(len(measured)), len(measured))


def _checked(image: ArrayLike) -> Complexes:
    values = np.asarray(image)
    if values.ndim != 3:
        raise DataError(f"the image has shape {values.shape}", "give (channels, rows, columns)")
    return values.astype(np.complex128)


def _within(axis_m: ArrayLike, centre_m: float, width_m: float, name: str) -> NDArray[np.bool_]:
    axis = np.asarray(axis_m, dtype=np.float64)
    if not (np.isfinite(centre_m) and np.isfinite(width_m) and width_m > 0):
        raise DataError(f"a {name} extent of {width_m} m around {centre_m} m", "give a positive, finite extent")
    inside = np.abs(axis - centre_m) <= width_m / 2 * (1 + 1e-9)
    step = float(np.ptp(axis)) / max(axis.size - 1, 1)
    covered = axis.size and axis.min() - step <= centre_m - width_m / 2 and centre_m + width_m / 2 <= axis.max() + step
    if not (covered and inside.any()):
        raise DataError(
            f"{name} {centre_m - width_m / 2:.2f} to {centre_m + width_m / 2:.2f} m is not in the image",
            "choose a place within it, a wider strip, or focus a larger or finer grid",
        )
    return np.asarray(inside)


def _mean(power: Floats, axis: int) -> Floats:
    """Mean over an axis without NaN; NaN where nothing is defined."""
    defined = np.isfinite(power)
    count = defined.sum(axis=axis)
    total = np.where(defined, power, 0.0).sum(axis=axis)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))
