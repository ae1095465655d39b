"""Phasors of the kernels, and the kernel on processors without permutes."""

import os
import subprocess
import sys

import numpy as np
from numba import njit

from processing.sar.phasors import turned, turned_exactly
from processing.simd import INDEX_BITS, add_pairs, flip_odd, load, splat, store, store_whole


@njit
def phasors(angles, out):
    for n in range(0, len(angles), 16):
        c, s = turned(load(angles, n))
        store(out, 4 * n, c)
        store(out, 4 * n + 16, s)
        c, s = turned_exactly(load(angles, n))
        store(out, 4 * n + 32, c)
        store(out, 4 * n + 48, s)


def test_phasors_are_within_their_bounds():
    # Half turns for the short series (their bound 1.2e-6 and float32 rounding), turns up to a half for the exact one.
    halves = np.linspace(-300, 300, 16 * 2000).astype(np.float32)
    out = np.empty(4 * len(halves), np.float32)
    phasors(halves, out)
    parts = out.reshape(-1, 4, 16)
    angle = np.pi * halves.astype(np.float64).reshape(-1, 16)
    np.testing.assert_allclose(parts[:, 0], np.cos(angle), atol=1.4e-6)
    np.testing.assert_allclose(parts[:, 1], np.sin(angle), atol=1.4e-6)
    turns = np.linspace(-0.5, 0.5, 16 * 2000).astype(np.float32)
    phasors(turns, out)
    angle = 2 * np.pi * turns.astype(np.float64).reshape(-1, 16)
    np.testing.assert_allclose(parts[:, 2], np.cos(angle), atol=2e-7)
    np.testing.assert_allclose(parts[:, 3], np.sin(angle), atol=2e-7)


@njit
def pieces(numbers, flipped, whole, pairs):
    store(flipped, 0, flip_odd(load(numbers, 0), load(numbers, 0) + splat(INDEX_BITS)))
    add_pairs(pairs, 1, load(numbers, 0), -load(numbers, 0))


@njit
def whole_numbers(numbers, whole):
    store_whole(whole, 1, load(numbers, 0))


def test_signs_pairs_and_whole_numbers():
    numbers = np.arange(-7, 9).astype(np.float32)
    flipped, whole, pairs = np.empty(16, np.float32), np.zeros(18, np.int64), np.ones(34, np.float32)
    pieces(numbers, flipped, whole, pairs)
    np.testing.assert_array_equal(flipped, numbers * np.where(numbers % 2 == 1, -1, 1))
    np.testing.assert_array_equal(pairs[1:33:2], 1 + numbers)
    np.testing.assert_array_equal(pairs[2:33:2], 1 - numbers)
    assert pairs[0] == pairs[33] == 1
    whole_numbers(np.arange(-7, 9) * 2.0**40, whole)
    np.testing.assert_array_equal(whole[1:17], np.arange(-7, 9) * 2**40)
    assert whole[0] == whole[17] == 0


SCRIPT = """
import numpy as np
from processing import simd
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.grid import ImageGrid
assert not simd.PERMUTES
rng = np.random.default_rng(5)
values = (rng.normal(size=(1, 31, 160)) + 1j * rng.normal(size=(1, 31, 160))).astype(np.complex64)
antenna = np.column_stack([np.linspace(-0.75, 0.75, 31), np.zeros((31, 2))])
profiles = RangeProfiles(values, 0.23 * np.arange(160), antenna, ("HH",), 2.4e9, 80e6)
grid = ImageGrid(np.linspace(-5, 5, 37), np.linspace(8, 20, 33), -1.0)
made = backproject(profiles, grid, interpolator="lagrange4")
plain = backproject_reference(profiles, grid, interpolator="lagrange4")
print(20 * np.log10(np.linalg.norm(made - plain) / np.linalg.norm(plain)))
"""


def test_processors_without_permutes_give_the_reference_too():
    # Compiled for AVX2 without AVX-512: lookups become gathers. float32 rounding as for the permutes.
    features = "+sse2,+sse3,+ssse3,+sse4.1,+sse4.2,+avx,+avx2,+fma,+cmov,+popcnt"
    told = {**os.environ, "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": features}
    made = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=110, check=True, env=told
    )
    assert float(made.stdout) < -110
