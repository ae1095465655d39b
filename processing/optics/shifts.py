"""Images of one scene behind different polarizers, and how far one is shifted against the other.

A turning polarizer moves the image a little (its faces are not quite parallel), and so does a loose mount. Edges stay
where they are while their contrast changes with polarization, even its sign: so images are compared by the size of
their gradients, which has its maximum on an edge whatever the contrast.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude, spline_filter
from scipy.ndimage import shift as shift_image

from processing.errors import DataError
from processing.fusion.resampling import DEGREES

Floats = NDArray[np.float64]

SMOOTHING_PX = 1.5
"""Standard deviation of the Gaussian with which gradients are taken, pixels."""
LEAST_PX = 32
"""Smallest side of an image in which a shift can be measured."""
LARGEST_PX = 8.0
"""Largest shift that is looked for, pixels."""
CONTRAST_PX = 3.0
"""Standard deviation of the Gaussian within which an edge's contrast is taken to be one, pixels."""
BLOCK_PX = 16
"""Side of the blocks by whose scatter the standard deviation is told, pixels."""
LEAST_ALIKE = 0.12
"""Correlation of the edges' slopes below which they have nothing in common: that of noise at its best is up to 0.08."""
LEAST_SD_PX = 1e-3
"""What gradients between pixels, which splines make, leave of any shift even without noise."""
REGISTER = ("off", "auto", "on")
"""What :func:`registered` can do."""
_BORDER_PX = 4
_ITERATIONS = 25
_CLOSE_PX = 1e-4
_TINY = 1e-9


@dataclass(frozen=True)
class Shift:
    """Where a scene's points are in an image, less where they are in the reference: down and right, pixels, with sds.

    Sds are infinite, and the shift 0, in directions in which the images show no edges.
    """

    down: float
    right: float
    down_sd: float
    right_sd: float

    @property
    def size(self) -> float:
        """Length, pixels."""
        return float(np.hypot(self.down, self.right))

    @property
    def known(self) -> bool:
        """Whether it could be measured, in one direction at least."""
        return math.isfinite(min(self.down_sd, self.right_sd))

    def significant(self, least_px: float = 0.03, sds: float = 4.0) -> bool:
        """Whether the shift is both above ``least_px`` and ``sds`` of its standard deviations."""
        # A direction that is not known takes no part in what is known of the other.
        known = [(s, sd) for s, sd in ((self.down, self.down_sd), (self.right, self.right_sd)) if np.isfinite(sd)]
        return any(abs(s) > max(least_px, sds * sd) for s, sd in known)


STILL = Shift(0.0, 0.0, 0.0, 0.0)
"""Of the reference itself."""
NOTHING_KNOWN = Shift(0.0, 0.0, float("inf"), float("inf"))
"""Where there is nothing to compare."""


def measure_shift(
    image: NDArray[np.floating],
    reference: NDArray[np.floating],
    mask: NDArray[np.bool_] | None = None,
    *,
    windows: Sequence[tuple[slice, slice]] | None = None,
    begin: tuple[float, float] | None = None,
) -> Shift:
    """Shift of ``image`` against ``reference``, to a small part of a pixel.

    The sizes of the two gradients are matched by least squares (Gauss-Newton on the shift, after Lucas and Kanade 1981,
    with a contrast that changes slowly over the image), begun at the peak of their correlation.

    Args:
        image: (rows, columns).
        reference: same shape.
        mask: (rows, columns) pixels that are not to be used, such as saturated ones.
        windows: pieces of one size that alone are looked at, such as
            :func:`processing.optics.pieces.spread_pieces`; the whole image when left out.
        begin: shift down and right to begin with, instead of the correlation's peak.

    Raises:
        DataError: images of different shapes.
    """
    if image.shape != reference.shape or image.ndim != 2:
        raise DataError(f"images have shapes {image.shape} and {reference.shape}", "compare images of one shape")
    pieces = []
    for window in windows or [(slice(0, image.shape[0]), slice(0, image.shape[1]))]:
        pair = image[window], reference[window]
        if min(pair[0].shape) < LEAST_PX:
            return NOTHING_KNOWN
        bad = ~(np.isfinite(pair[0]) & np.isfinite(pair[1]))
        if mask is not None:
            bad = bad | mask[window]
        weight = _weight(bad)
        if weight.any():
            moving, still = (_edges(np.where(bad, _typical(plane, bad), plane)) for plane in pair)
            pieces.append(_Piece(moving, still, weight))
    if sum(np.count_nonzero(piece.weight) for piece in pieces) < LEAST_PX**2 / 4:
        return NOTHING_KNOWN
    return _refined(pieces, *(begin or _coarse(pieces)))


def shift_back(image: NDArray[np.floating], shift: Shift, degree: int = 3) -> Floats:
    """The image with its points where the reference has them, by splines; NaN where nothing is known.

    Undefined pixels spoil the ``degree + 1`` squared pixels that a spline's value mostly depends on.

    Args:
        image: (rows, columns).
        shift: of the image.
        degree: of :data:`processing.fusion.resampling.DEGREES`; 1 is interpolation by straight lines.

    Raises:
        DataError: another degree.
    """
    if degree not in DEGREES:
        raise DataError(f"a spline of degree {degree}", f"take one of {', '.join(map(str, DEGREES))}")
    undefined = ~np.isfinite(image)
    filled = np.where(undefined, _typical(image, undefined), image)
    moved: Floats = shift_image(filled, (-shift.down, -shift.right), order=degree, mode="mirror", output=np.float64)
    moved[mask_back(undefined, shift, degree)] = np.nan
    return moved


def mask_back(mask: NDArray[np.bool_], shift: Shift, degree: int = 3) -> NDArray[np.bool_]:
    """Pixels of the image shifted back that depend on pixels in the mask or beyond the border."""
    found = mask
    around = np.arange(-(degree // 2), degree // 2 + 2)
    for axis, offset in enumerate((shift.down, shift.right)):
        length = mask.shape[axis]
        outside = np.pad(found, [(1, 1) if n == axis else (0, 0) for n in range(2)], constant_values=True)
        whole = (math.floor(offset) + around).tolist()
        places = [np.clip(np.arange(length) + step, -1, length) + 1 for step in whole]
        found = np.logical_or.reduce([np.take(outside, place, axis=axis) for place in places])
    return np.asarray(found)


def registered(
    light: NDArray[np.floating], saturated: NDArray[np.bool_], how: str
) -> tuple[Floats, NDArray[np.bool_], tuple[Shift, ...], tuple[bool, ...]]:
    """Images of one scene on the places of the first.

    Args:
        light: (K, rows, columns).
        saturated: (rows, columns) in any of them.
        how: ``"off"``, ``"auto"`` (significant shifts are undone) or ``"on"`` (all that could be measured).

    Returns:
        The images, NaN where one does not reach; what is saturated in them; their shifts against the first (none with
        ``"off"``) and which were undone.

    Raises:
        DataError: another word.
    """
    if how not in REGISTER:
        raise DataError(f"registration {how!r}", f"take one of {', '.join(REGISTER)}")
    images = np.asarray(light, dtype=np.float64)
    if how == "off":
        return images, saturated, (), ()
    shifts = [STILL, *(measure_shift(image, images[0], saturated) for image in images[1:])]
    undo = [i > 0 and shift.known and (how == "on" or shift.significant()) for i, shift in enumerate(shifts)]
    images, spoilt = put_back(images, saturated, shifts, undo)
    return images, spoilt, tuple(shifts), tuple(undo)


def put_back(
    light: NDArray[np.floating],
    saturated: NDArray[np.bool_],
    shifts: Sequence[Shift],
    undo: Sequence[bool],
    degree: int = 3,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Copies of the images with some of their shifts undone, and what is saturated in them.

    Args:
        light: (K, rows, columns).
        saturated: (rows, columns) in any of them.
        shifts: of each image.
        undo: whether each is undone.
        degree: of the splines.
    """
    images, spoilt = np.array(light, dtype=np.float64), saturated.copy()
    for i, shift in enumerate(shifts):
        if undo[i]:
            images[i] = shift_back(images[i], shift, degree)
            # Only what the frame holds: beyond its border nothing is saturated, but undefined.
            spoilt |= mask_back(saturated, shift, degree) & np.isfinite(images[i])
    return images, spoilt


def _typical(image: NDArray[np.floating], bad: NDArray[np.bool_]) -> float:
    return float(np.median(image[~bad])) if not bad.all() else 0.0


def _edges(image: NDArray[np.floating]) -> Floats:
    found: Floats = gaussian_gradient_magnitude(np.asarray(image, dtype=np.float64), SMOOTHING_PX, mode="mirror")
    return found


def _weight(bad: NDArray[np.bool_]) -> Floats:
    """1 where the gradient depends on no bad pixel and no border, else 0."""
    from scipy.ndimage import binary_dilation

    reach = int(np.ceil(4 * SMOOTHING_PX)) + 1
    usable = ~binary_dilation(bad, np.ones((2 * reach + 1, 2 * reach + 1), dtype=bool)) if bad.any() else ~bad
    usable[:_BORDER_PX] = usable[-_BORDER_PX:] = False
    usable[:, :_BORDER_PX] = usable[:, -_BORDER_PX:] = False
    return usable.astype(np.float64)


@dataclass(frozen=True)
class _Piece:
    """Sizes of the gradients in a part of the two images, and which of them are used."""

    moving: Floats
    still: Floats
    weight: Floats


def _coarse(pieces: list[_Piece]) -> tuple[float, float]:
    """Peak of the correlation within :data:`LARGEST_PX`, whole pixels."""
    reach = int(LARGEST_PX)
    total = np.zeros((2 * reach + 1, 2 * reach + 1))
    for piece in pieces:
        planes = piece.moving * piece.weight, piece.still * piece.weight
        spectra = [np.fft.rfft2(plane - plane.mean()) for plane in planes]
        correlation = np.fft.irfft2(spectra[0] * np.conj(spectra[1]), s=piece.still.shape)
        total += np.roll(correlation, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    down, right = np.unravel_index(int(np.argmax(total)), total.shape)
    return float(down) - reach, float(right) - reach


class _Fit:
    """Least squares of one piece, at any shift."""

    def __init__(self, piece: _Piece, floor: float) -> None:
        self.still, self.weight = piece.still, piece.weight
        self.spline = spline_filter(piece.moving, order=3, mode="mirror", output=np.float64)
        self.power = gaussian_filter(piece.still**2, CONTRAST_PX, mode="mirror") + floor
        self.slopes = _slopes(piece.still)
        self.warped = self.contrast = self.misfit = self.difference = np.zeros_like(piece.still)

    def look(self, moved: Floats) -> tuple[float, float]:
        """Warp by that shift; the misfit times the edges' strength, and that strength, both summed."""
        self.warped = warped = shift_image(self.spline, tuple(-moved), order=3, mode="mirror", prefilter=False)
        # Warped too far by e it is contrast (still + e gradient), to first order; contrast differs from edge to edge.
        self.contrast = gaussian_filter(warped * self.still, CONTRAST_PX, mode="mirror") / self.power
        self.difference = warped - self.contrast * self.still
        # Where two edges with different changes of contrast meet, the model is wrong: such places count less.
        self.misfit = gaussian_filter(self.difference**2, SMOOTHING_PX, mode="mirror")
        edges = self.weight * self.still
        return float((self.misfit * edges).sum()), float(edges.sum())

    def equations(self, typical: float) -> _Equations:
        """With the trust that a typical misfit gives."""
        trust = 1.0 / (1.0 + self.misfit / typical)
        along = [self.contrast * slope for slope in self.slopes]
        # Noise is in the reference's slopes as in the image's, but not the same: squares of either would be too large.
        slopes = _slopes(self.warped)
        weight = trust * self.weight
        return _Equations(
            normal=_products(along, slopes, weight),
            trusted=_products(along, slopes, weight * trust),
            squares=_products(along, along, weight).diagonal() * _products(slopes, slopes, weight).diagonal(),
            scores=np.stack([_by_block(a * weight * self.difference) for a in along], axis=1),
        )


class _Equations(NamedTuple):
    """Least squares of a piece, or of all of them (:func:`_together`)."""

    normal: Floats
    """(2, 2) what a step along each axis changes."""
    trusted: Floats
    """(2, 2) the same, less what trust loses by it."""
    squares: Floats
    """(2,) squares of the two images' slopes along each axis, summed and multiplied."""
    scores: Floats
    """(blocks, 2) misfit along each axis."""


def _together(parts: list[_Equations]) -> _Equations:
    normal, trusted = (np.sum([part[n] for part in parts], axis=0) for n in range(2))
    squares = np.sum([np.sqrt(part.squares) for part in parts], axis=0) ** 2
    return _Equations(normal, trusted, squares, np.concatenate([part.scores for part in parts]))


def _slopes(values: Floats) -> list[Floats]:
    """Down and right."""
    down, right = np.gradient(values)
    return [np.asarray(down), np.asarray(right)]


def _products(some: Sequence[Floats], others: Sequence[Floats], weight: Floats) -> Floats:
    return np.array([[float((weight * a * b).sum()) for b in others] for a in some])


def _by_block(values: Floats) -> Floats:
    """Sums over blocks of :data:`BLOCK_PX` squared, those at the border smaller."""
    for axis in (0, 1):
        values = np.add.reduceat(values, np.arange(0, values.shape[axis], BLOCK_PX), axis=axis)
    return values.ravel()


def _refined(pieces: list[_Piece], down: float, right: float) -> Shift:
    largest = max(float(np.max(piece.still)) for piece in pieces)
    if not sum(float((piece.weight * piece.still).sum()) for piece in pieces) > 0:
        return NOTHING_KNOWN
    fits = [_Fit(piece, _TINY * largest**2 + _TINY) for piece in pieces]
    power = sum(float((fit.weight * fit.still**2).sum()) for fit in fits)
    moved = np.array([down, right])
    for _ in range(_ITERATIONS):
        misfits, edges = np.sum([fit.look(moved) for fit in fits], axis=0)
        found = _together([fit.equations(float(misfits / edges) + _TINY) for fit in fits])
        # A direction along which nothing changes cannot be measured, nor one along which all that changes is noise.
        known = np.diag(found.normal) > np.maximum(LEAST_ALIKE * np.sqrt(found.squares), _TINY * power)
        if not known.any():
            return NOTHING_KNOWN
        step = _inverse(found.normal, known) @ found.scores.sum(axis=0)
        moved -= step
        if not np.hypot(*moved) <= 2 * LARGEST_PX:
            return NOTHING_KNOWN
        if np.hypot(*step) < _CLOSE_PX:
            break
    # Misfits are alike over some pixels, by noise that was smoothed or by polarization; blocks are hardly so.
    spread = found.scores @ _inverse(found.trusted, known).T
    sds = np.where(known, np.sqrt((spread**2).sum(axis=0) + LEAST_SD_PX**2), np.inf)
    moved[~known] = 0.0
    return Shift(float(moved[0]), float(moved[1]), float(sds[0]), float(sds[1]))


def _inverse(matrix: Floats, known: NDArray[np.bool_]) -> Floats:
    """(2, 2) of the directions that are known, 0 elsewhere."""
    inverse = np.zeros((2, 2))
    inverse[np.ix_(known, known)] = np.linalg.pinv(matrix[np.ix_(known, known)])
    return inverse
