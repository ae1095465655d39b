"""Images of one scene behind different polarizers, and how far one is shifted against the other.

A turning polarizer moves the image a little (its faces are not quite parallel), and so does a loose mount. Edges stay
where they are while their contrast changes with polarization, even its sign: so images are compared by the size of
their gradients, which has its maximum on an edge whatever the contrast.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude, spline_filter
from scipy.ndimage import shift as shift_image

from processing.errors import DataError

Floats = NDArray[np.float64]

SMOOTHING_PX = 1.5
"""Standard deviation of the Gaussian with which gradients are taken, pixels."""
LEAST_PX = 32
"""Smallest side of an image in which a shift can be measured."""
LARGEST_PX = 8.0
"""Largest shift that is looked for, pixels."""
CONTRAST_PX = 3.0
"""Standard deviation of the Gaussian within which an edge's contrast is taken to be one, pixels."""
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

    def significant(self, least_px: float = 0.03, sds: float = 4.0) -> bool:
        """Whether the shift is both above ``least_px`` and ``sds`` of its standard deviations."""
        # A direction that is not known takes no part in what is known of the other.
        known = [(s, sd) for s, sd in ((self.down, self.down_sd), (self.right, self.right_sd)) if np.isfinite(sd)]
        return any(abs(s) > max(least_px, sds * sd) for s, sd in known)


NOTHING_KNOWN = Shift(0.0, 0.0, float("inf"), float("inf"))
"""Where there is nothing to compare."""


def measure_shift(
    image: NDArray[np.floating], reference: NDArray[np.floating], mask: NDArray[np.bool_] | None = None
) -> Shift:
    """Shift of ``image`` against ``reference``, to a small part of a pixel.

    The sizes of the two gradients are matched by least squares (Gauss-Newton on the shift, after Lucas and Kanade 1981,
    with a contrast that changes slowly over the image), begun at the peak of their correlation.

    Args:
        image: (rows, columns).
        reference: same shape.
        mask: (rows, columns) pixels that are not to be used, such as saturated ones.

    Raises:
        DataError: images of different shapes.
    """
    if image.shape != reference.shape or image.ndim != 2:
        raise DataError(f"images have shapes {image.shape} and {reference.shape}", "compare images of one shape")
    if min(image.shape) < LEAST_PX:
        return NOTHING_KNOWN
    bad = ~(np.isfinite(image) & np.isfinite(reference))
    if mask is not None:
        bad = bad | mask
    weight = _weight(bad)
    if np.count_nonzero(weight) < LEAST_PX**2 / 4:
        return NOTHING_KNOWN
    moving, still = (_edges(np.where(bad, _typical(plane, bad), plane)) for plane in (image, reference))
    down, right = _coarse(moving * weight, still * weight)
    return _refined(moving, still, weight, down, right)


def shift_back(image: NDArray[np.floating], shift: Shift) -> Floats:
    """The image with its points where the reference has them, by cubic splines; NaN where nothing is known.

    Undefined pixels spoil the four by four pixels that a spline's value mostly depends on.
    """
    undefined = ~np.isfinite(image)
    filled = np.where(undefined, _typical(image, undefined), image)
    moved: Floats = shift_image(filled, (-shift.down, -shift.right), order=3, mode="mirror", output=np.float64)
    moved[mask_back(undefined, shift)] = np.nan
    return moved


def mask_back(mask: NDArray[np.bool_], shift: Shift) -> NDArray[np.bool_]:
    """Pixels of the image shifted back that depend on pixels in the mask or beyond the border."""
    rows, columns = mask.shape
    outside = np.pad(mask, 1, constant_values=True)
    found = np.zeros_like(mask)
    for i in np.unique(np.floor(shift.down) + np.arange(-1, 3)).astype(int):
        for k in np.unique(np.floor(shift.right) + np.arange(-1, 3)).astype(int):
            row = np.clip(np.arange(rows) + i, -1, rows) + 1
            column = np.clip(np.arange(columns) + k, -1, columns) + 1
            found |= outside[np.ix_(row, column)]
    return found


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
    shifts = [Shift(0.0, 0.0, 0.0, 0.0), *(measure_shift(image, images[0], saturated) for image in images[1:])]
    known = [bool(np.isfinite([shift.down_sd, shift.right_sd]).any()) for shift in shifts]
    undo = [i > 0 and known[i] and (how == "on" or shift.significant()) for i, shift in enumerate(shifts)]
    images, spoilt = images.copy(), saturated.copy()
    for i, shift in enumerate(shifts):
        if undo[i]:
            images[i] = shift_back(images[i], shift)
            # Only what the frame holds: beyond its border nothing is saturated, but undefined.
            spoilt |= mask_back(saturated, shift) & np.isfinite(images[i])
    return images, spoilt, tuple(shifts), tuple(undo)


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


def _coarse(moving: Floats, still: Floats) -> tuple[float, float]:
    """Peak of the correlation within :data:`LARGEST_PX`, whole pixels."""
    spectra = [np.fft.rfft2(plane - plane.mean()) for plane in (moving, still)]
    correlation = np.fft.irfft2(spectra[0] * np.conj(spectra[1]), s=moving.shape)
    reach = int(LARGEST_PX)
    near = np.roll(correlation, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
    down, right = np.unravel_index(int(np.argmax(near)), near.shape)
    return float(down) - reach, float(right) - reach


def _refined(moving: Floats, still: Floats, weight: Floats, down: float, right: float) -> Shift:
    slopes = np.gradient(still)
    spline = spline_filter(moving, order=3, mode="mirror", output=np.float64)
    power = gaussian_filter(still * still, CONTRAST_PX, mode="mirror") + _TINY * float(np.max(still)) ** 2 + _TINY
    edges = weight * still
    if not edges.sum() > 0:
        return NOTHING_KNOWN
    count = float(weight.sum())
    moved = np.array([down, right])
    for _ in range(_ITERATIONS):
        warped = shift_image(spline, tuple(-moved), order=3, mode="mirror", prefilter=False)
        # Warped too far by e it is contrast (still + e gradient), to first order; contrast differs from edge to edge.
        contrast = gaussian_filter(warped * still, CONTRAST_PX, mode="mirror") / power
        # Where two edges with different changes of contrast meet, the model is wrong: such places count less.
        misfit = gaussian_filter((warped - contrast * still) ** 2, SMOOTHING_PX, mode="mirror")
        typical = float(np.average(misfit, weights=edges)) + _TINY
        trust = np.sqrt(weight / (1.0 + misfit / typical))
        design = np.stack([(contrast * slope * trust).ravel() for slope in slopes], axis=1)
        residual = ((warped - contrast * still) * trust).ravel()
        normal = design.T @ design
        # A direction along which nothing changes cannot be measured.
        known = np.diag(normal) > _TINY * count * float(np.max(power))
        if not known.any():
            return NOTHING_KNOWN
        inverse = np.zeros((2, 2))
        inverse[np.ix_(known, known)] = np.linalg.pinv(normal[np.ix_(known, known)])
        step = inverse @ (design.T @ residual)
        moved -= step
        if not np.hypot(*moved) <= 2 * LARGEST_PX:
            return NOTHING_KNOWN
        if np.hypot(*step) < _CLOSE_PX:
            break
    # Smoothed noise is alike over 4 pi s^2 pixels: so many fewer of them are independent.
    alike = 4 * np.pi * SMOOTHING_PX**2
    variance = float(residual @ residual) / count
    sds = np.where(known, np.sqrt(variance * np.diag(inverse) * alike), np.inf)
    moved[~known] = 0.0
    return Shift(float(moved[0]), float(moved[1]), float(sds[0]), float(sds[1]))
