"""The checksum that HDF5's filter 3 stores behind a chunk (J. G. Fletcher, IEEE Trans. Commun. 30, 1982; 32 bits)."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MODULUS: Final = 65535
_ROW: Final = 1024
"""Words summed at once: sums weighted by place stay whole numbers in float64."""
_ROWS: Final = 32
"""Rows of words at once: they stay in the processor's cache, and no matrix product wakes other threads."""
_WEIGHTS: Final = np.stack([np.ones(_ROW), np.arange(_ROW, dtype=np.float64)], axis=1)


def fletcher32(data: bytes | NDArray[Any]) -> int:
    """Checksum of bytes, or of those of a contiguous array.

    They are taken as big-endian words of 16 bits, a last single byte as if a zero followed. Modulo 65535 exchanging the
    bytes of a word is a product by 256, and so it is of every sum of words: they are summed in the machine's own order,
    by matrix products (twice as fast as HDF5's own loop).
    """
    octets = np.frombuffer(data, dtype=np.uint8)
    words, end = -(-len(octets) // 2), len(octets) // (2 * _ROW) * 2 * _ROW
    rows = octets[:end].view("<u2").reshape(-1, _ROW)
    if end < len(octets):
        last = np.zeros((1, 2 * _ROW), dtype=np.uint8)
        last[0, : len(octets) - end] = octets[end:]
        tables = [(rows, 0), (last.view("<u2"), len(rows))]
    else:
        tables = [(rows, 0)]
    sums = np.zeros((-(-words // _ROW), 2))
    scratch = np.empty((_ROWS, _ROW))
    for table, above in tables:
        for begin in range(0, len(table), _ROWS):
            piece = table[begin : begin + _ROWS]
            scratch[: len(piece)] = piece
            np.matmul(scratch[: len(piece)], _WEIGHTS, out=sums[above + begin : above + begin + len(piece)])
    # Each word counts as often in the second sum as there are words from it to the end.
    left = words - _ROW * np.arange(len(sums))
    first = int(sums[:, 0].sum())
    second = int((left % MODULUS * (sums[:, 0] % MODULUS) - sums[:, 1] % MODULUS).sum())
    # A sum that is a multiple of the modulus, but not zero, is folded to 65535; only zeros have the sum 0.
    nothing = MODULUS if first else 0
    return (second * 256 % MODULUS or nothing) << 16 | (first * 256 % MODULUS or nothing)
