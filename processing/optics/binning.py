"""Frames at display size: means of square blocks of pixels, and how much of each block is saturated.

Light adds, so Stokes parameters of the means are the means of the Stokes parameters (thesis 2.9 to 2.11 are linear).
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

Floats = NDArray[np.float32]


def bin_factor(shape: tuple[int, int], rows: int, columns: int) -> int:
    """Smallest whole number by which both sides are divided so that the image is at most ``rows`` x ``columns``."""
    return max(1, -(-shape[0] // rows), -(-shape[1] // columns))


def bin_frame_reference(
    image: NDArray[np.unsignedinteger], factor: int, saturation_counts: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Plain float64 definition of :func:`bin_frame`; same arguments and results, in float64."""
    rows, columns = _check(image, factor)
    blocks = image[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    return blocks.astype(np.float64).mean(axis=(1, 3)), (blocks >= saturation_counts).mean(axis=(1, 3))


def bin_frame(image: NDArray[np.unsignedinteger], factor: int, saturation_counts: int) -> tuple[Floats, Floats]:
    """Mean counts of each block, and the share of its pixels that is saturated.

    Args:
        image: (rows, columns) unsigned counts of at most 32 bits; what is left over at the right and below is left out.
        factor: side of a block, pixels.
        saturation_counts: counts at and above which a pixel is saturated.

    Returns:
        Means and shares (0 to 1), each (rows // factor, columns // factor) float32.

    Raises:
        DataError: not an image of unsigned counts, or smaller than one block.
    """
    rows, columns = _check(image, factor)
    mean, share = np.empty((rows, columns), np.float32), np.empty((rows, columns), np.float32)
    _bin(np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("=")), factor, saturation_counts, mean, share)
    return mean, share


def _check(image: NDArray[np.unsignedinteger], factor: int) -> tuple[int, int]:
    if image.ndim != 2 or not np.issubdtype(image.dtype, np.unsignedinteger):
        raise DataError(f"a frame is {image.dtype} of shape {image.shape}", "give rows and columns of raw counts")
    if factor < 1 or min(image.shape) < factor:
        raise DataError(f"a frame of shape {image.shape} has no blocks of {factor}", "give a smaller factor, from 1 up")
    return image.shape[0] // factor, image.shape[1] // factor


@numba.njit(cache=True, nogil=True)
def _bin(image: NDArray[np.unsignedinteger], factor: int, saturation: int, mean: Floats, share: Floats) -> None:
    rows, columns = mean.shape
    scale = 1.0 / (factor * factor)
    sums, counts = np.empty(columns, np.uint64), np.empty(columns, np.uint32)
    for row in range(rows):
        sums[:] = 0
        counts[:] = 0
        for line in range(row * factor, (row + 1) * factor):
            at = 0
            for column in range(columns):
                total, full = np.uint64(0), np.uint32(0)
                for _ in range(factor):
                    value = image[line, at]
                    total += value
                    full += np.uint32(value >= saturation)
                    at += 1
                sums[column] += total
                counts[column] += full
        for column in range(columns):
            mean[row, column] = np.float32(sums[column] * scale)
            share[row, column] = np.float32(counts[column] * scale)
