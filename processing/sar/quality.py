"""How good a focused image is: values and peaks between pixels, widths, side lobes, and agreement of two images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.grid import ImageGrid
from processing.sar.interpolation import sinc_weights

TAPS = 12
"""Pixels per axis that a value between pixels is read from."""

SAMPLING = 2.5
"""Pixels per resolution cell that interpolation between pixels counts on, at least."""


@dataclass(frozen=True)
class Peak:
    """A local maximum of an image's magnitude."""

    x_m: float
    y_m: float
    value: complex
    """Complex amplitude at the maximum, between pixels."""

    @property
    def level_db(self) -> float:
        """``20 log10 |value|``."""
        return float(20 * np.log10(abs(self.value)))

    @property
    def phase_rad(self) -> float:
        """Phase at the maximum."""
        return float(np.angle(self.value))


@dataclass(frozen=True)
class Cut:
    """A point response along one axis."""

    width_m: float
    """-3 dB width; NaN where the image ends first."""
    peak_sidelobe_db: float
    """Highest side lobe over the peak; NaN where the cut holds none."""
    integrated_sidelobe_db: float
    """Energy outside the first nulls over energy within them; NaN where the cut ends first."""


@dataclass(frozen=True)
class PointResponse:
    """A peak and its two cuts."""

    peak: Peak
    x: Cut
    y: Cut


@dataclass(frozen=True)
class Carrier:
    """Where a focused image's phase comes from: the waves that the aperture's centre sees."""

    antenna_m: tuple[float, float, float]
    """Centre of the aperture."""
    centre_hz: float

    def turns(self, grid: ImageGrid, row: float, column: float) -> tuple[float, float]:
        """Phase that the image gains from one pixel to the next, rad, along rows (y) and along columns (x)."""
        x = np.interp(column, np.arange(len(grid.x_m)), grid.x_m)
        y = np.interp(row, np.arange(len(grid.y_m)), grid.y_m)
        sight = np.array([x, y, grid.z_m]) - self.antenna_m
        k = 4 * np.pi * self.centre_hz / SPEED_OF_LIGHT_M_S * sight / np.linalg.norm(sight)
        dx, dy = (float(axis[1] - axis[0]) if len(axis) > 1 else 0.0 for axis in (grid.x_m, grid.y_m))
        return float(k[1] * dy), float(k[0] * dx)


def carrier_of(antenna_m: NDArray[np.float64], centre_hz: float) -> Carrier:
    """Carrier of the image that a track (positions, 3) makes."""
    x, y, z = (float(value) for value in np.mean(antenna_m, axis=0))
    return Carrier((x, y, z), centre_hz)


def value_between(
    image: NDArray[np.complexfloating],
    row: ArrayLike,
    column: ArrayLike,
    *,
    turns: tuple[float, float] | None = None,
) -> NDArray[np.complex128]:
    """Complex values at fractional rows and columns, by a separable Kaiser-windowed sinc of twelve taps.

    A focused image carries phase that turns fast, by several turns from pixel to pixel. The mean turn around each
    place is taken off before and put back after interpolation; the pixels tell it but for whole turns, which
    ``turns`` settles.

    Args:
        image: (ny, nx) complex, at least ``SAMPLING`` pixels per resolution cell.
        row: fractional row indices, any shape.
        column: fractional column indices, same shape.
        turns: expected phase from one row and from one column to the next, rad (:meth:`Carrier.turns`). Without it
            magnitudes are right, but phases between pixels may be off by fractions of whole turns.

    Returns:
        Same shape; NaN where one of the pixels needed is undefined or outside the image.
    """
    rows, columns = np.broadcast_arrays(np.asarray(row, np.float64), np.asarray(column, np.float64))
    values = np.full(rows.shape, complex(np.nan, np.nan))
    for place in np.ndindex(rows.shape):
        values[place] = _value_at(image, float(rows[place]), float(columns[place]), turns)
    return values


def _value_at(
    image: NDArray[np.complexfloating], row: float, column: float, turns: tuple[float, float] | None = None
) -> complex:
    if not (np.isfinite(row) and np.isfinite(column)):
        return complex(np.nan, np.nan)
    y0, x0 = int(np.floor(row)), int(np.floor(column))
    # An edge pixel asked for exactly needs no neighbours beyond it: those have no weight.
    reach = np.arange(1 - TAPS // 2, TAPS // 2 + 1)
    wy, wx = (sinc_weights(p - np.floor(p), TAPS, SAMPLING) for p in (row, column))
    ys, xs = y0 + reach, x0 + reach
    use_y, use_x = np.abs(wy) > 1e-12, np.abs(wx) > 1e-12
    if min(ys[use_y].min(), xs[use_x].min()) < 0 or ys[use_y].max() >= len(image) or xs[use_x].max() >= image.shape[1]:
        return complex(np.nan, np.nan)
    chip = image[np.ix_(ys[use_y], xs[use_x])].astype(np.complex128)
    turn_y = _turn(chip[1:], chip[:-1])
    turn_x = _turn(chip[:, 1:], chip[:, :-1])
    if turns is not None:
        turn_y += 2 * np.pi * round((turns[0] - turn_y) / (2 * np.pi))
        turn_x += 2 * np.pi * round((turns[1] - turn_x) / (2 * np.pi))
    carrier = np.exp(-1j * (turn_y * (ys[use_y] - row)[:, None] + turn_x * (xs[use_x] - column)[None, :]))
    return complex(wy[use_y] @ (chip * carrier) @ wx[use_x])


def _turn(later: NDArray[np.complex128], earlier: NDArray[np.complex128]) -> float:
    return float(np.angle(np.sum(later * np.conj(earlier)))) if later.size else 0.0


def range_gain(x_m: ArrayLike, y_m: ArrayLike, z_m: float) -> NDArray[np.float64]:
    """R^2 from the aperture's centre, m^2: what range compensation multiplies an image by.

    Over a main lobe that is metres deep this gain is anything but constant: it pulls the maximum outward by about
    2 s^2 / R (s the lobe's standard deviation; 0.6 m at 8.7 m for 80 MHz and a Hann window) and makes it too strong.
    Maxima are therefore looked for without it, and their amplitude is multiplied by it at their place.
    """
    x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
    return np.asarray(x**2 + y**2 + z_m**2)


def without_gain(
    image: NDArray[np.complexfloating], grid: ImageGrid, range_compensated: bool
) -> NDArray[np.complexfloating]:
    """An image as it would be without range compensation, see :func:`range_gain`."""
    return image / range_gain(grid.x_m, grid.y_m[:, None], grid.z_m) if range_compensated else image


def with_gain(peak: Peak, grid: ImageGrid, range_compensated: bool) -> Peak:
    """A peak that was found without range compensation, with it where the image has it."""
    if not range_compensated:
        return peak
    return Peak(peak.x_m, peak.y_m, peak.value * float(range_gain(peak.x_m, peak.y_m, grid.z_m)))


def _climb(image: NDArray[np.complexfloating], row: int, column: int) -> tuple[float, float]:
    """Newton's method on the log magnitude, which is near a paraboloid at the top of any lobe.

    Lobes away from broadside are ridges oblique to the grid, so that the top may be several pixels from the largest.
    """
    place = np.array([row, column], dtype=np.float64)
    h = 0.25
    for _ in range(30):
        around = np.array(
            [[_value_at(image, place[0] + i * h, place[1] + j * h) for j in (-1, 0, 1)] for i in (-1, 0, 1)]
        )
        if not np.isfinite(around).all() or (around == 0).any():
            break
        level = np.log(np.abs(around))
        slope = np.array([level[2, 1] - level[0, 1], level[1, 2] - level[1, 0]]) / (2 * h)
        across = (level[2, 2] - level[2, 0] - level[0, 2] + level[0, 0]) / 4
        along = level[2, 1] - 2 * level[1, 1] + level[0, 1], level[1, 2] - 2 * level[1, 1] + level[1, 0]
        curvature = np.array([[along[0], across], [across, along[1]]]) / h**2
        values, vectors = np.linalg.eigh(curvature)
        # Uphill even where the surface still bends the other way; not at all along a level crest.
        bent = np.abs(values) > 1e-4 * np.abs(values).max()
        step = vectors @ np.where(bent, (vectors.T @ slope) / np.where(bent, np.abs(values), 1.0), 0.0)
        step *= min(1.0, 1.5 / max(float(np.linalg.norm(step)), 1e-12))
        place = place + step
        if np.linalg.norm(step) < 1e-4:
            return float(place[0]), float(place[1])
    # No top was reached: an edge or an undefined pixel is near.
    return float(row), float(column)


def refine_peak(
    image: NDArray[np.complexfloating], grid: ImageGrid, row: int, column: int, carrier: Carrier | None = None
) -> Peak:
    """The maximum of the interpolated magnitude nearest to a pixel that exceeds its neighbours.

    With ``carrier`` the value has its true phase. Nearer than six pixels to an edge or to undefined pixels the pixel
    itself is returned.
    """
    best_row, best_column = _climb(image, row, column)
    x = np.interp(best_column, np.arange(len(grid.x_m)), grid.x_m)
    y = np.interp(best_row, np.arange(len(grid.y_m)), grid.y_m)
    turns = None if carrier is None else carrier.turns(grid, best_row, best_column)
    return Peak(float(x), float(y), _value_at(image, best_row, best_column, turns))


def point_response(
    image: NDArray[np.complexfloating],
    grid: ImageGrid,
    x_m: float,
    y_m: float,
    *,
    reach_m: tuple[float, float],
    range_compensated: bool = False,
    carrier: Carrier | None = None,
) -> PointResponse:
    """Peak nearest to a place and its cuts along x and y.

    Args:
        image: (ny, nx) complex, one channel.
        grid: where it stands, uniform.
        x_m: about where the peak is; the largest pixel within half of ``reach_m`` is taken.
        y_m: likewise.
        reach_m: how far the cuts go to either side, in x and in y.
        range_compensated: whether amplitudes were multiplied by R^2, see :func:`range_gain`; the cuts are without it.
        carrier: of the image, for the peak's phase.

    Raises:
        DataError: nothing is defined around that place.
    """
    image = without_gain(image, grid, range_compensated)
    near = (np.abs(grid.y_m - y_m)[:, None] <= reach_m[1] / 2) & (np.abs(grid.x_m - x_m)[None, :] <= reach_m[0] / 2)
    level = np.where(near & np.isfinite(image), np.abs(image), 0.0)
    if not level.any():
        raise DataError(f"nothing is defined around x = {x_m:g} m, y = {y_m:g} m", "ask for a place in the image")
    row, column = np.unravel_index(int(level.argmax()), level.shape)
    peak = refine_peak(image, grid, int(row), int(column), carrier)
    steps = [abs(float(axis[1] - axis[0])) for axis in (grid.x_m, grid.y_m)]
    at = [float(np.interp(p, axis, np.arange(len(axis)))) for p, axis in ((peak.x_m, grid.x_m), (peak.y_m, grid.y_m))]
    cuts = []
    for axis, (step, reach) in enumerate(zip(steps, reach_m, strict=True)):
        away = np.arange(-round(16 * reach / step), round(16 * reach / step) + 1) / 16
        columns = at[0] + (away if axis == 0 else 0 * away)
        rows = at[1] + (away if axis == 1 else 0 * away)
        cuts.append(measure_cut(np.abs(value_between(image, rows, columns)), step / 16))
    return PointResponse(with_gain(peak, grid, range_compensated), cuts[0], cuts[1])


def measure_cut(magnitude: NDArray[np.floating], step_m: float) -> Cut:
    """Width and side lobes of a cut whose middle sample is the peak; undefined ends are left out.

    Args:
        magnitude: (2 n + 1,) finely sampled magnitude, NaN where undefined.
        step_m: its step.
    """
    middle = len(magnitude) // 2
    right, left = _defined(magnitude[middle:]), _defined(magnitude[middle::-1])
    halves = [_half_width(side) for side in (left, right)]
    nulls = [_first_null(side) for side in (left, right)]
    lobes = [side[null:].max() for side, null in zip((left, right), nulls, strict=True) if null is not None]
    peak_sidelobe = 20 * np.log10(max(lobes) / magnitude[middle]) if lobes else np.nan
    integrated = np.nan
    if nulls[0] is not None and nulls[1] is not None:
        inside = np.sum(left[1 : nulls[0]] ** 2) + np.sum(right[: nulls[1]] ** 2)
        outside = np.sum(left[nulls[0] :] ** 2) + np.sum(right[nulls[1] :] ** 2)
        integrated = 10 * np.log10(outside / inside)
    return Cut(step_m * sum(halves), float(peak_sidelobe), float(integrated))


def _defined(side: NDArray[np.floating]) -> NDArray[np.floating]:
    undefined = np.flatnonzero(~np.isfinite(side))
    return side[: undefined[0]] if undefined.size else side


def _half_width(side: NDArray[np.floating]) -> float:
    below = np.flatnonzero(side < side[0] * np.sqrt(0.5)) if side.size else np.array([], dtype=np.intp)
    if not below.size:
        return float("nan")
    last = int(below[0])
    # Power, not magnitude, is near a parabola at half height: interpolate linearly in dB.
    upper, lower = np.log(side[last - 1]), np.log(max(float(side[last]), 1e-300))
    return last - 1 + float((upper - np.log(side[0] * np.sqrt(0.5))) / (upper - lower))


def _first_null(side: NDArray[np.floating]) -> int | None:
    """Index of the first minimum beyond which the cut rises again; None where it only falls, or rises at once."""
    rising = np.flatnonzero(np.diff(side) > 0)
    return int(rising[0]) if rising.size and rising[0] > 0 else None


def complex_correlation(
    a: NDArray[np.complexfloating], b: NDArray[np.complexfloating], mask: NDArray[np.bool_] | None = None
) -> complex:
    """Normalised complex correlation ``sum a conj(b) / sqrt(sum |a|^2 sum |b|^2)`` where both are defined.

    Args:
        a: image of any shape.
        b: image of the same shape.
        mask: where to look; everywhere where left out.

    Raises:
        DataError: shapes disagree, or nothing is defined and different from zero in both.
    """
    if a.shape != b.shape:
        raise DataError(f"images of shapes {a.shape} and {b.shape} cannot be compared", "focus both on one grid")
    use = np.isfinite(a) & np.isfinite(b)
    if mask is not None:
        use &= mask
    first, second = a[use].astype(np.complex128), b[use].astype(np.complex128)
    energy = float(np.sum(np.abs(first) ** 2) * np.sum(np.abs(second) ** 2))
    if energy <= 0:
        raise DataError("the images have no common support", "compare where both are defined and not zero")
    return complex(np.sum(first * np.conj(second)) / np.sqrt(energy))
