"""A source whose samples tell their own number, for tests of exactness."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hw_mocks.sound_card import AudioSettings
from hw_mocks.sound_card.sample_formats import SampleFormat

BITS = {"int16": 15, "int24": 23, "int32": 31, "float32": 23}


class CounterSource:
    """Sample n holds n mod 32768 on channel 0 and n div 32768 on channel 1, in the uppermost 16 bits of its format.

    Below them, where the format has room, stands a hash of n, so that every bit matters.
    """

    def __init__(
        self, sample_rate_hz: float, sample_format: SampleFormat = "int16", *, clock_drift_ppm: float = 0.0
    ) -> None:
        self.audio = AudioSettings(sample_rate_hz=sample_rate_hz, clock_drift_ppm=clock_drift_ppm)
        self._format = sample_format

    def block(self, first: int, frames: int, t_ns: int) -> NDArray[np.generic]:
        """Samples ``first`` to ``first + frames``, as the sound card's own format has them."""
        whole = self.whole(first + np.arange(frames))
        if self._format == "int16":
            return whole.astype(np.int16)
        if self._format == "float32":
            return (whole / 2.0**23).astype("<f4")
        return whole.astype("<i4")

    def whole(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Values of samples (frames, 2) as integers of the format's width."""
        spare = BITS[self._format] - 15
        low = numbers * 40_503 % 2**spare if spare else np.zeros_like(numbers)
        words = np.stack([numbers & 0x7FFF, numbers >> 15 & 0x7FFF], axis=1)
        return (words << spare) + low[:, None]

    def expected(self, numbers: NDArray[np.int64], captured_as: str) -> NDArray[np.generic]:
        """The same as a recorder should get them."""
        whole = self.whole(numbers)
        if captured_as == "float32":
            return (whole / 2.0 ** BITS[self._format]).astype(np.float32)
        shift = {"int16": 15, "int32": 31}[captured_as] - BITS[self._format]
        return (whole << shift).astype(captured_as)


def numbers_of(samples: NDArray[np.generic]) -> NDArray[np.int64]:
    """Numbers that captured samples (frames, 2) hold."""
    if samples.dtype.kind == "f":
        words = np.floor(samples.astype(np.float64) * 2**15).astype(np.int64)
    else:
        words = samples.astype(np.int64) >> (8 * samples.dtype.itemsize - 16)
    return words[:, 1] * 2**15 + words[:, 0]
