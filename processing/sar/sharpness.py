"""How sharp a whole image is: entropy and contrast, which autofocus minimises and maximises."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError


def image_entropy(image: NDArray[np.number]) -> float:
    """Entropy of the image's power, nats: ``-sum p ln p`` with p each pixel's share of all power.

    A single bright pixel has 0, n equally bright ones ln n. Channels of one image are added in power first (their
    span), so that the measure does not depend on how power is shared between them.

    Args:
        image: (ny, nx) or (channels, ny, nx), complex or real amplitudes; pixels that are NaN in any channel are left
            out.

    Raises:
        DataError: no pixel is defined, or all are zero.
    """
    power = _power(image)
    share = power[power > 0] / power.sum()
    return float(-np.sum(share * np.log(share)))


def image_contrast(image: NDArray[np.number]) -> float:
    """Standard deviation of the image's power over its mean: 1 for speckle, more for points; arguments as above.

    Raises:
        DataError: no pixel is defined, or all are zero.
    """
    power = _power(image)
    return float(power.std() / power.mean())


def _power(image: NDArray[np.number]) -> NDArray[np.float64]:
    values = np.asarray(image)
    if values.ndim not in (2, 3):
        raise DataError(f"an image has shape {values.shape}", "give (rows, columns) or (channels, rows, columns)")
    wide = np.abs(values).astype(np.float64) ** 2
    span = wide.sum(axis=0) if wide.ndim == 3 else wide
    defined: NDArray[np.float64] = span[np.isfinite(span)]
    if not defined.size or not defined.sum() > 0:
        raise DataError("the image has no defined pixel with any power", "focus where there are echoes")
    return defined
