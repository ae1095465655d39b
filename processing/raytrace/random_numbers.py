"""Random numbers by counting: each is a function of its path and its place in it, whatever order paths are traced in.

A path's stream is named by a key; number ``d`` of it is a mix of ``key + d * golden`` (SplitMix64: Steele, Lea and
Flood 2014, OOPSLA). So results do not depend on threads, batches or which other paths there are.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_TO_UNIT = 2.0**-53


@numba.njit(cache=True, nogil=True)
def mix(z: np.uint64) -> np.uint64:
    """SplitMix64's finisher: a permutation of 64-bit numbers without visible order."""
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)


@numba.njit(cache=True, nogil=True)
def path_key(seed: int, stream: int, number: int) -> np.uint64:
    """Key of path ``number`` of a stream (a pixel, or a source)."""
    return mix(mix(mix(np.uint64(seed) + _GOLDEN) + np.uint64(stream)) + np.uint64(number))


@numba.njit(cache=True, nogil=True)
def uniform(key: np.uint64, place: int) -> float:
    """Number ``place`` of a path, uniform in [0, 1)."""
    return np.float64(mix(key + np.uint64(place + 1) * _GOLDEN) >> _S11) * _TO_UNIT


def path_keys(seed: int, stream: NDArray[np.integer], number: NDArray[np.integer]) -> NDArray[np.uint64]:
    """:func:`path_key` of arrays, in NumPy."""
    with np.errstate(over="ignore"):
        first = _mixed(np.asarray(np.uint64(seed)) + _GOLDEN)
        return _mixed(_mixed(first + stream.astype(np.uint64)) + number.astype(np.uint64))


def uniforms(keys: NDArray[np.uint64], place: int) -> NDArray[np.float64]:
    """:func:`uniform` of arrays, in NumPy."""
    with np.errstate(over="ignore"):
        mixed = _mixed(keys + np.uint64(place + 1) * _GOLDEN)
    return np.asarray((mixed >> _S11).astype(np.float64) * _TO_UNIT)


def _mixed(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    return z ^ (z >> _S31)
