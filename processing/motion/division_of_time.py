"""What moves between the exposures of a turning polarizer, and pictures without the traces it leaves (thesis 8.2, 8.3).

A polarimeter by division of time takes its angles one after the other. Where an object moved in between, intensities of
different things are combined, and degrees of polarization come out that nothing there has. With the object's velocity,
known from the radar, each exposure is read where the object was (``x_k = x_0 + v t_k``); the ground that an exposure
did not see because the object stood before it is solved from the others, since three angles are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, optimize, spatial

from processing.errors import DataError
from processing.optics.analyser import least_squares
from processing.optics.camera_model import Pinhole

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SMOOTH_PX = 1.2
_SOLVABLE = 1e3
"""Condition number up to which the exposures that saw the ground determine its Stokes parameters."""


@dataclass(frozen=True)
class Compensated:
    """Exposures in which everything is where it was at the reference."""

    light: Floats
    """(K, rows, columns): the object's pixels read where it was, hidden ground filled in from the other exposures."""
    object_mask: Mask
    """(rows, columns) the object at the reference."""
    hidden: NDArray[np.uint8]
    """(rows, columns) number of exposures in which the object hid the ground; where too few are left, light is NaN."""


def error_image(light: ArrayLike, matrix: Floats) -> Floats:
    """How far the exposures contradict each other, (rows, columns): thesis 7.2 (in chapter 8), for any angles.

    Twice the root of the squared residuals of the least squares fit of S0, S1, S2; for 0, 45, 90 and 135 degrees
    ``|(I0 + I90) - (I45 + I135)|``. Zero for what stands still behind ideal polarizers, but for noise.

    Args:
        light: (K, rows, columns) above black, K of 4 or more.
        matrix: (K, 3) measurement matrix.

    Raises:
        DataError: three angles or fewer, which cannot contradict each other.
    """
    return _contradiction(_checked(light, matrix), matrix, 0.0)


def _contradiction(images: Floats, matrix: Floats, smoothing_px: float) -> Floats:
    """The error image of residuals that are smoothed with their signs: noise goes down, traces do not."""
    left = images - np.einsum("ki,il,lrc->krc", matrix, least_squares(matrix), images)
    if smoothing_px:
        left = ndimage.gaussian_filter(left, (0, smoothing_px, smoothing_px))
    return np.asarray(2 * np.sqrt(np.sum(left**2, axis=0)))


def camera_displacement(
    camera: Pinhole, velocity_m_s: ArrayLike, time_s: ArrayLike, z_m: float, *, reference: int = 0
) -> Floats:
    """How far an object on the plane ``z = z_m`` moves in the picture, (K, 2, rows, columns): down and right, pixels.

    Args:
        camera: the camera; it stands still between the exposures (or its pictures were registered on the ground).
        velocity_m_s: (3,) in the radar's and the camera's common coordinates.
        time_s: (K,) exposures.
        z_m: height of the object's surface.
        reference: exposure to which the others are referred.

    Returns:
        NaN where a pixel does not see the plane.
    """
    time = np.asarray(time_s, dtype=np.float64)
    column, row = np.meshgrid(np.arange(float(camera.width_px)), np.arange(float(camera.height_px)))
    place = camera.on_plane(column, row, z_m)
    fields = []
    for instant in time - time[reference]:
        u, v, _ = camera.project(place + np.asarray(velocity_m_s, dtype=np.float64) * instant)
        fields.append(np.stack([v - row, u - column]))
    return np.stack(fields)


def read_along(light: ArrayLike, displacement_px: ArrayLike) -> Floats:
    """Each exposure where the object was, (K, rows, columns), by cubic splines; NaN beyond the frame.

    Args:
        light: (K, rows, columns).
        displacement_px: (K, 2) or (K, 2, rows, columns), down and right.
    """
    images = np.asarray(light, dtype=np.float64)
    fields = _fields(displacement_px, images.shape)
    row, column = np.mgrid[0 : images.shape[1], 0 : images.shape[2]].astype(np.float64)
    out = np.empty_like(images)
    for k, (down, right) in enumerate(fields):
        if not (np.any(down) or np.any(right)):
            out[k] = images[k]
            continue
        at = np.stack([row + down, column + right])
        known = np.isfinite(at).all(axis=0)
        value = ndimage.map_coordinates(
            np.nan_to_num(images[k]), np.where(known, at, 0.0), order=3, mode="constant", cval=np.nan
        )
        out[k] = np.where(known, value, np.nan)
    return out


def touched(light: ArrayLike, matrix: Floats, *, sds: float = 6.0) -> Mask:
    """Pixels in which the exposures contradict each other by more than noise, (rows, columns).

    The noise is the error image's own typical size (its median over 0.674, as for the size of a normal variate), so
    most of the picture must stand still.
    """
    error = _contradiction(_checked(light, matrix), matrix, _SMOOTH_PX)
    typical = max(float(np.median(error)) / 0.674, 1e-300)
    sure = ndimage.binary_opening(error > sds * typical)
    # What adjoins sure traces needs half as much.
    found = ndimage.binary_propagation(sure, mask=error > 0.5 * sds * typical)
    return np.asarray(ndimage.binary_closing(found, iterations=2))


def object_at_reference(light: ArrayLike, matrix: Floats, displacement_px: ArrayLike) -> Mask:
    """The moving object's pixels at the reference.

    The exposures contradict each other where it stood in some of them and not in others; the convex hull of that is
    what it swept over. Of that it was, at the reference, where its way through all exposures stays within (erosion by
    the displacements, which is exact for a convex object). Of several things that move, the one that left most traces
    is taken.

    Args:
        light: (K, rows, columns).
        matrix: (K, 3) measurement matrix.
        displacement_px: (K, 2) or (K, 2, rows, columns), down and right.
    """
    images = _checked(light, matrix)
    fields = _fields(displacement_px, images.shape)
    swept = _swept(images, matrix, float(np.nanmax(np.hypot(fields[:, 0], fields[:, 1]))))
    row, column = np.mgrid[0 : images.shape[1], 0 : images.shape[2]].astype(np.float64)
    inside = np.ones(swept.shape, dtype=np.bool_)
    for down, right in np.nan_to_num(fields):
        inside &= ndimage.map_coordinates(swept.astype(np.float64), [row + down, column + right], order=1) > 0.5
    return inside


def _swept(images: Floats, matrix: Floats, longest_px: float) -> Mask:
    found = touched(images, matrix)
    # Leading and trailing traces of one object lie no further apart than it is long; those of two do.
    labels, count = ndimage.label(ndimage.binary_dilation(found, iterations=max(int(longest_px / 2), 2)))
    if count == 0:
        return np.zeros(found.shape, dtype=np.bool_)
    sums = ndimage.sum_labels(error_image(images, matrix) * found, labels, np.arange(1, count + 1))
    points = np.argwhere(found & (labels == 1 + int(np.argmax(sums))))
    every = np.indices(found.shape).reshape(2, -1).T
    try:
        hull = spatial.Delaunay(points[spatial.ConvexHull(points).vertices])
    except spatial.QhullError:
        # A single row of pixels is its own hull.
        return np.asarray(found & (labels == 1 + int(np.argmax(sums))))
    return np.asarray((hull.find_simplex(every) >= 0).reshape(found.shape))


def compensate(
    light: ArrayLike, matrix: Floats, displacement_px: ArrayLike, *, object_mask: Mask | None = None
) -> Compensated:
    """Take a moving object's traces out of the exposures.

    Args:
        light: (K, rows, columns) above black, K of 4 or more.
        matrix: (K, 3) measurement matrix.
        displacement_px: (K, 2) or (K, 2, rows, columns): how far the object had moved in each exposure, down and right;
            0 in the reference.
        object_mask: its pixels at the reference; found by :func:`object_at_reference` if left out.

    Raises:
        DataError: three angles or fewer, or shapes that do not fit.
    """
    images = _checked(light, matrix)
    fields = _fields(displacement_px, images.shape)
    mask = object_at_reference(images, matrix, fields) if object_mask is None else np.asarray(object_mask, dtype=bool)
    out = images.copy()
    out[:, mask] = read_along(images, fields)[:, mask]
    row, column = np.mgrid[0 : images.shape[1], 0 : images.shape[2]].astype(np.float64)
    # Where the object was: a pixel beside it belongs to it in part.
    wide = ndimage.binary_dilation(mask)
    covered = (
        np.stack(
            [
                ndimage.map_coordinates(
                    wide.astype(float), [row - np.nan_to_num(d), column - np.nan_to_num(r)], order=1
                )
                > 0.01
                for d, r in fields
            ]
        )
        & ~mask
    )
    for pattern in np.unique(covered.reshape(len(covered), -1), axis=1).T:
        if not pattern.any():
            continue
        where = (covered == pattern[:, None, None]).all(axis=0)
        seen = ~pattern
        if np.count_nonzero(seen) < 3 or np.linalg.cond(matrix[seen]) > _SOLVABLE:
            out[:, where] = np.nan
            continue
        stokes = np.linalg.pinv(matrix[seen]) @ out[seen][:, where]
        out[np.ix_(pattern, *(np.arange(n) for n in where.shape))] = np.where(where, 0.0, out[pattern])
        filled = np.zeros(images.shape)
        filled[:, where] = matrix @ stokes
        out[pattern] += filled[pattern]
    return Compensated(out, mask, covered.sum(axis=0).astype(np.uint8))


def refined_displacement(light: ArrayLike, matrix: Floats, displacement_px: ArrayLike, object_mask: Mask) -> Floats:
    """A displacement that makes the object's exposures agree best, from one that is known to some pixels.

    Two numbers are changed, the mean velocity in the picture, until the mean size of the error image over the object is
    least (Nelder and Mead 1965).

    Args:
        light, matrix, displacement_px: as :func:`compensate`.
        object_mask: (rows, columns) the object at the reference.

    Returns:
        (K, 2, rows, columns).
    """
    images = _checked(light, matrix)
    fields = _fields(displacement_px, images.shape)
    if not object_mask.any():
        return fields
    rows, columns = np.nonzero(ndimage.binary_dilation(object_mask, iterations=2))
    # The object's surroundings in all exposures, so that each trial reads no more than it needs.
    reach = int(np.ceil(np.nanmax(np.abs(fields)))) + 6
    box = (
        slice(max(rows.min() - reach, 0), rows.max() + reach + 1),
        slice(max(columns.min() - reach, 0), columns.max() + reach + 1),
    )
    part, near, inside = images[:, *box], fields[:, :, *box], object_mask[box]
    sizes = np.sqrt(np.nanmean(near[:, 0] ** 2 + near[:, 1] ** 2, axis=(1, 2)))
    share = (sizes / max(float(sizes.max()), 1e-12))[:, None, None]

    def moved(by: Floats, fields: Floats) -> Floats:
        return np.asarray(fields + np.stack([share * by[0], share * by[1]], axis=1))

    def left(by: Floats) -> float:
        error = error_image(read_along(part, moved(by, near)), matrix)[inside]
        return float(np.mean(np.nan_to_num(error, nan=float(np.max(part)))))

    simplex = np.array([[0.0, 0.0], [0.7, 0.0], [0.0, 0.7]])
    found = optimize.minimize(
        left, [0.0, 0.0], method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 0.02, "maxfev": 80}
    )
    return moved(found.x, fields)


def _fields(displacement_px: ArrayLike, shape: tuple[int, ...]) -> Floats:
    given = np.asarray(displacement_px, dtype=np.float64)
    if given.shape == (shape[0], 2):
        given = given[:, :, None, None]
    if given.ndim != 4 or given.shape[:2] != (shape[0], 2) or given.shape[2:] not in ((1, 1), shape[1:]):
        raise DataError(
            f"displacements of shape {given.shape} for exposures of shape {shape}",
            "give down and right for each exposure, or for each exposure and pixel",
        )
    return np.broadcast_to(given, (shape[0], 2, *shape[1:]))


def _checked(light: ArrayLike, matrix: Floats) -> Floats:
    images = np.asarray(light, dtype=np.float64)
    if images.ndim != 3 or len(images) < 4 or np.shape(matrix) != (len(images), 3):
        raise DataError(
            f"exposures of shape {images.shape} with a matrix of shape {np.shape(matrix)}",
            "give four or more exposures and their measurement matrix: fewer cannot contradict each other",
        )
    return images
