"""How images behind a turning polarizer are put in place, as a tolerance asks for: foretold from their own spectra.

An image that is displaced by d and left so errs at the frequency nu by ``|1 - exp(-2 pi i nu.d)|^2`` of its power
there; put back by a spline of degree n, by ``|1 - exp(-2 pi i nu.d) F_n(nu, d')|^2``, where F_n is what the spline does
at that very fraction of a pixel (:func:`processing.fusion.resampling.passed_at`) and d' the measured shift, known with
a standard deviation. Both are means over what d may be, and sums over the image's spectrum, noise taken off. Noise has
no place: it is in the errors of Stokes parameters, and no part of these.

The shift itself is measured on pieces of the picture first. Only where their standard deviation breaks the tolerance,
and that of all pixels would not, the whole picture is measured, which takes many times as long.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.fusion.resampling import DEGREES, passed_at
from processing.optics.pieces import spread_pieces
from processing.optics.shifts import LARGEST_PX, STILL, Shift, measure_shift
from processing.optics.spectra import FOLDS, above_noise, filled, folded_shares, frequencies, power_spectrum
from processing.tolerances import cheapest_within, check_tolerance, reason

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEFT = 0
"""Stands for no spline at all: an image is left where it is."""
NAMES = {LEFT: "left where they are", 1: "straight lines", 3: "cubic splines", 5: "splines of degree 5"}
SAFETY_DB = 0.5
"""How far below the tolerance the expected error must be."""

MEASURE_NS, AGAIN_NS = 1800.0, 850.0
"""Core time of measuring an image's shift, ns a pixel that is looked at; and of doing so from a shift nearly right."""
UNDO_NS = {LEFT: 0.0, 1: 110.0, 3: 180.0, 5: 310.0}
"""Core time of undoing it, ns a pixel. Only the order of these times decides."""

PIECE_PX, PIECES = 96, 6
"""Side of the pieces that are looked at, and how many of them at most, spread over the picture."""
LEAST_PX = 16
"""Smallest side of a picture whose errors can be foretold."""


@dataclass(frozen=True)
class Way:
    """One way of putting the images in place, and what is expected of it."""

    degree: int
    """Of the splines, or :data:`LEFT`."""
    whole: bool
    """Whether shifts are measured on the whole picture."""
    error_db: float
    """Root mean square over all images together, relative to them, dB."""
    undo: tuple[bool, ...]
    """Which images are put back; those that keep the tolerance by themselves stay as they are."""
    seconds: float
    """Expected core time, shifts measured included."""

    @property
    def name(self) -> str:
        """Short, as products keep it."""
        return f"{NAMES[self.degree]}{', shifts from the whole picture' if self.whole else ''}"


@dataclass(frozen=True)
class RegistrationChoice:
    """How the images are put in place, and why."""

    way: Way
    shifts: tuple[Shift, ...]
    """Of each image against the first, as measured."""
    tolerance_db: float
    kept: bool
    """Whether the tolerance is expected to be kept."""
    looked_at: str
    """Where the shifts were measured, in words."""
    ways: tuple[Way, ...] = field(default=())
    """All that were considered, cheapest first."""

    @property
    def predicted_error_db(self) -> float:
        """Root mean square of what is out of place over all images together, relative to them, dB."""
        return self.way.error_db

    @property
    def considered(self) -> dict[str, float]:
        """Expected error of each way, dB, cheapest first."""
        return {way.name: way.error_db for way in self.ways}

    @property
    def reason(self) -> str:
        """In a few words."""
        errors = [way.error_db for way in self.ways]
        return reason(self.predicted_error_db, errors, self.tolerance_db, kept=self.kept)

    def explain(self) -> list[str]:
        """The choice in words."""
        done = NAMES[LEFT] if self.way.degree == LEFT else f"put in place by {NAMES[self.way.degree]}"
        lines = [f"images {done}: {self.reason}; expected error {self.way.error_db:.1f} dB", self._known()]
        for way in self.ways:
            if way.name == self.way.name or (way.whole and way.degree == LEFT):
                continue  # to leave images where they are, nobody looks closer
            what = NAMES[LEFT] if way.degree == LEFT else f"by {NAMES[way.degree]}"
            if way.whole and not self.way.whole:
                what += " after measuring the whole picture"
            elif self.way.whole and not way.whole:
                what += " by what the pieces tell"
            if way.seconds < self.way.seconds:
                lines.append(f"not {what}: {way.error_db:.1f} dB")
            else:
                lines.append(
                    f"not {what}: takes {way.seconds / self.way.seconds:.3g} times as long ({way.error_db:.1f} dB)"
                )
        return lines

    def _known(self) -> str:
        measured = [shift for shift in self.shifts[1:] if shift.known]
        lost = len(self.shifts) - 1 - len(measured)
        words = []
        if measured:
            sds = [sd for shift in measured for sd in (shift.down_sd, shift.right_sd) if math.isfinite(sd)]
            largest = max(shift.size for shift in measured)
            words.append(f"shifts up to {largest:.3g} px, known to {max(sds):.2g} px from {self.looked_at}")
        if lost:
            words.append(f"{lost} of {len(self.shifts) - 1} shifts could not be measured")
        if self.way.degree != LEFT:
            words.append(f"{sum(self.way.undo)} of {len(self.shifts) - 1} are undone")
        return "; ".join(words) or "there is one image alone"


@dataclass(frozen=True)
class Spectra:
    """What is seen in the images, by frequency."""

    powers: tuple[float, ...]
    """Mean square of each image, noise taken off."""
    spectra: tuple[Floats, ...]
    """(rows, columns // 2 + 1) of each, about its mean (:func:`processing.optics.spectra.power_spectrum`)."""
    shares: dict[tuple[int, int], Floats]
    """Of all of them (:func:`processing.optics.spectra.folded_shares`)."""


def image_spectra(
    light: NDArray[np.floating], windows: Sequence[tuple[slice, slice]], variance: ArrayLike = 0.0
) -> Spectra:
    """Spectra of images, mean over pieces of one size.

    Args:
        light: (K, rows, columns), NaN where undefined.
        windows: the pieces.
        variance: of the noise, mean over the pixels; one number, or one for each image.

    Raises:
        DataError: no light in the images.
    """
    count = len(light)
    noise = np.broadcast_to(np.asarray(variance, dtype=np.float64), (count,))
    powers, spectra, pieces = np.zeros(count), [np.zeros(())] * count, 0
    for window in windows:
        piece = np.asarray(light[:, *window], dtype=np.float64)
        piece = piece[:, : piece.shape[1] // 2 * 2, : piece.shape[2] // 2 * 2]
        if np.isfinite(piece).all(axis=0).mean() < 0.5:
            continue
        piece = filled(piece)
        pieces += 1
        for i in range(count):
            mean, spectrum = power_spectrum(piece[i : i + 1], float(noise[i]))
            powers[i] += mean + float(spectrum.sum())
            spectra[i] = spectra[i] + spectrum
    if not pieces or not powers.sum() > 0:
        raise DataError("no error can be foretold of images without light", "check the frames")
    together = np.asarray(sum(spectra, np.zeros(()))) / pieces
    means = tuple(above_noise(spectrum / pieces, float(own)) for spectrum, own in zip(spectra, noise, strict=True))
    return Spectra(tuple((powers / pieces).tolist()), means, folded_shares(together, float(noise.sum())))


def misplaced_power(spectrum: Floats, shares: dict[tuple[int, int], Floats], shift: Shift, degree: int) -> float:
    """Mean square of an image's error, left displaced or put back; its mean over what the shift may be.

    Args:
        spectrum: of the image (:func:`processing.optics.spectra.power_spectrum`).
        shares: of what is beyond half the sampling frequency (:func:`processing.optics.spectra.folded_shares`).
        shift: as measured, with its standard deviations; an infinite one alone means that nothing changes in that
            direction, two of them that nothing is known: then it is anything that would have been looked for.
        degree: of the splines that undo it, or :data:`LEFT`.
    """
    if not shift.known:
        anything = LARGEST_PX / math.sqrt(3)  # uniform
        shift = Shift(0.0, 0.0, anything, anything)
    nu, mu = frequencies(spectrum)
    down, down_power = _axis(nu, shift.down, shift.down_sd, degree)
    right, right_power = _axis(mu, shift.right, shift.right_sd, degree)
    stays = np.zeros_like(spectrum)
    for (i, k), share in shares.items():
        stays += share * (down[i] * right[k]).real
    return max(float((spectrum * (1 - 2 * stays + down_power * right_power)).sum()), 0.0)


def _axis(nu: Floats, offset: float, sd: float, degree: int) -> tuple[dict[int, NDArray[np.complex128]], Floats]:
    """Along one axis: what stays itself, mean over the shift's distribution, of each multiple; and the power."""
    sd = sd if math.isfinite(sd) else 0.0
    made = np.ones(nu.shape, dtype=np.complex128) if degree == LEFT else passed_at(degree, nu, offset)
    stays = {i: made * np.exp(-2j * np.pi * (nu + i) * offset - 2 * (np.pi * (nu + i) * sd) ** 2) for i in FOLDS}
    return stays, np.abs(made) ** 2


def choose_registration(
    light: NDArray[np.floating], saturated: Bools, tolerance_db: float, *, variance: ArrayLike = 0.0
) -> RegistrationChoice:
    """The cheapest way whose expected error is within the tolerance; where there is none, the best of them.

    Shifts are measured on the way, on pieces or on the whole picture; :func:`processing.optics.shifts.put_back` undoes
    them with the choice's ``shifts``, ``way.undo`` and ``way.degree``.

    Args:
        light: (K, rows, columns) images of one scene, NaN where undefined.
        saturated: (rows, columns) in any of them.
        tolerance_db: largest error, dB (negative).
        variance: of the noise, mean over the pixels; one number, or one for each image.

    Raises:
        DataError: a tolerance that is no negative number, a smaller picture than :data:`LEAST_PX`, or no light.
    """
    check_tolerance(tolerance_db, "images")
    if light.ndim != 3 or min(light.shape[1:]) < LEAST_PX:
        raise DataError(f"images of shape {light.shape}", f"give rows and columns, at least {LEAST_PX} each")
    windows = tuple(spread_pieces(light.shape[1:], PIECE_PX, PIECES))
    looked = sum((rows.stop - rows.start) * (columns.stop - columns.start) for rows, columns in windows)
    pixels = light[0].size
    seen = image_spectra(np.where(saturated, np.nan, light), windows, variance)
    first = measured_on_pieces(light, saturated)
    pieces = _ways(seen, first, tolerance_db, whole=False, looked=looked, pixels=pixels)
    if looked == pixels:
        return _chosen(pieces, first, tolerance_db, "the whole picture")
    narrower = math.sqrt(looked / pixels)
    better = tuple(replace(s, down_sd=s.down_sd * narrower, right_sd=s.right_sd * narrower) for s in first)
    ways = [*pieces, *_ways(seen, better, tolerance_db, whole=True, looked=looked, pixels=pixels)]
    made = _chosen(ways, first, tolerance_db, f"{len(windows)} pieces of {PIECE_PX} x {PIECE_PX} pixels")
    if not made.way.whole:
        return made
    shifts = measured_again(light, saturated, first)
    ways = _ways(seen, shifts, tolerance_db, whole=True, looked=looked, pixels=pixels)
    made = _chosen(ways, shifts, tolerance_db, "the whole picture")
    return replace(made, ways=tuple(sorted([*pieces, *ways], key=lambda way: way.seconds)))


def measured_on_pieces(light: NDArray[np.floating], saturated: Bools) -> tuple[Shift, ...]:
    """Shifts of the images against the first, from pieces of them; small images are looked at as a whole."""
    windows = tuple(spread_pieces(light.shape[1:], PIECE_PX, PIECES))
    return (STILL, *(measure_shift(image, light[0], saturated, windows=windows) for image in light[1:]))


def measured_again(light: NDArray[np.floating], saturated: Bools, shifts: Sequence[Shift]) -> tuple[Shift, ...]:
    """Shifts from the whole images, where those from pieces are nearly right."""
    begins = [(shift.down, shift.right) if shift.known else None for shift in shifts[1:]]
    return (STILL, *(measure_shift(i, light[0], saturated, begin=at) for i, at in zip(light[1:], begins, strict=True)))


def _ways(
    seen: Spectra, shifts: tuple[Shift, ...], tolerance_db: float, *, whole: bool, looked: int, pixels: int
) -> list[Way]:
    """All that can be done with these shifts."""
    left = [
        misplaced_power(spectrum, seen.shares, shift, LEFT) if i else 0.0
        for i, (spectrum, shift) in enumerate(zip(seen.spectra, shifts, strict=True))
    ]
    limit = 10 ** ((tolerance_db - SAFETY_DB) / 10)
    seconds = 1e-9 * (len(shifts) - 1) * (MEASURE_NS * looked + (AGAIN_NS * pixels if whole else 0.0))
    power = sum(seen.powers)
    ways = []
    for degree in (LEFT, *DEGREES):
        errors, undo = list(left), [False] * len(left)
        for i, shift in enumerate(shifts):
            if degree == LEFT or not i or not shift.known or left[i] <= limit * seen.powers[i]:
                continue
            put = misplaced_power(seen.spectra[i], seen.shares, shift, degree)
            if put < left[i]:
                errors[i], undo[i] = put, True
        if degree != LEFT and not any(undo):
            continue
        cost = seconds + 1e-9 * UNDO_NS[degree] * pixels * sum(undo)
        error_db = 10 * math.log10(max(sum(errors) / power, 1e-32))
        ways.append(Way(degree, whole, error_db, tuple(undo), cost))
    return ways


def _chosen(ways: list[Way], shifts: tuple[Shift, ...], tolerance_db: float, looked_at: str) -> RegistrationChoice:
    ways = sorted(ways, key=lambda way: way.seconds)
    way = ways[cheapest_within([way.error_db for way in ways], tolerance_db, SAFETY_DB)]
    return RegistrationChoice(way, shifts, tolerance_db, way.error_db <= tolerance_db, looked_at, tuple(ways))
