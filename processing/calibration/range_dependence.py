"""Distortion that changes with range: antennas leak differently under other angles of depression.

The same targets at several distances give R and T at several ranges; between them each element is taken as a straight
line in range, and beyond the nearest and the farthest as constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.calibration.distortion import CHANNELS, Complexes, Distortion
from processing.errors import DataError


@dataclass(frozen=True)
class RangeDistortion:
    """Distortion at increasing slant ranges."""

    range_m: tuple[float, ...]
    distortions: tuple[Distortion, ...]

    def __post_init__(self) -> None:
        ranges = np.asarray(self.range_m, dtype=np.float64)
        if not len(ranges) or len(ranges) != len(self.distortions) or not (np.isfinite(ranges).all()):
            raise DataError(
                f"{len(ranges)} ranges for {len(self.distortions)} distortions", "give a finite range for each"
            )
        if not (np.diff(ranges) > 0).all():
            raise DataError(f"ranges {self.range_m} do not increase", "give each range once, the nearest first")

    def at(self, range_m: float) -> Distortion:
        """R and T at one range.

        Raises:
            DataError: an undefined range.
        """
        if not np.isfinite(range_m):
            raise DataError(f"the range is {range_m}", "give a finite one")
        stacked = np.stack([np.stack([d.receive, d.transmit]) for d in self.distortions]).reshape(len(self.range_m), 8)
        parts = [
            np.interp(range_m, self.range_m, column.real) + 1j * np.interp(range_m, self.range_m, column.imag)
            for column in stacked.T
        ]
        receive, transmit = np.asarray(parts).reshape(2, 2, 2)
        return Distortion(receive.astype(np.complex128), transmit.astype(np.complex128))

    def remove(self, image: ArrayLike, range_m: ArrayLike, channels: Sequence[str] = CHANNELS) -> Complexes:
        """Take the distortion off an image row by row.

        Args:
            image: (channels, rows, ...) complex.
            range_m: (rows,) slant range of each row, m.
            channels: names of the first axis.

        Returns:
            Same shape complex128; see :meth:`processing.calibration.distortion.Distortion.remove`.

        Raises:
            DataError: as that, or another number of ranges than rows.
        """
        values = np.asarray(image, dtype=np.complex128)
        ranges = np.asarray(range_m, dtype=np.float64)
        if values.ndim < 2 or ranges.shape != values.shape[1:2]:
            raise DataError(f"{ranges.size} ranges for an image of shape {values.shape}", "give one for each row")
        if len(self.distortions) == 1:
            return self.distortions[0].remove(values, channels)
        rows = [self.at(float(r)).remove(values[:, i], channels) for i, r in enumerate(ranges)]
        return np.stack(rows, axis=1)

    def noise_after(
        self, noise: ArrayLike, range_m: ArrayLike, channels: Sequence[str] = CHANNELS
    ) -> NDArray[np.float64]:
        """Noise power (channels, rows) once the distortion is taken off; arguments as in :meth:`remove`."""
        power = np.asarray(noise, dtype=np.float64)
        rows = [
            self.at(float(r)).noise_after(power[:, i], channels)
            for i, r in enumerate(np.asarray(range_m, dtype=np.float64))
        ]
        return np.stack(rows, axis=1)
