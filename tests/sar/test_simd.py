import numpy as np
import pytest
from numba import njit

from processing import simd
from processing.simd import (
    INDEX_BITS,
    fma,
    gather,
    largest,
    load,
    log2_parts,
    lookup16,
    lookup32,
    maximum,
    minimum,
    rint,
    smallest,
    splat,
    sqrt,
    store,
    times_power_of_two,
    to_float32,
    to_float64,
    where_positive,
)


@njit
def arithmetic(a, b, out):
    x, y = load(a, 0), load(b, 0)
    store(out, 0, (x + y) * x - (-y) / x)
    store(out, 16, fma(x, y, splat(np.float32(2))))
    store(out, 32, to_float32(sqrt(to_float64(x))))
    store(out, 48, rint(x))
    store(out, 64, minimum(x, y))
    store(out, 80, maximum(x, y))
    store(out, 96, where_positive(y - x, x, y))


def test_vectors_compute_as_numpy_does():
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.1, 9, (2, 16)).astype(np.float32)
    out = np.zeros(112, np.float32)
    arithmetic(a, b, out)
    # Float32 arithmetic with the same roundings, but for fma, which may round once: half a unit in the last place.
    np.testing.assert_array_equal(out[:16], (a + b) * a - (-b) / a)
    np.testing.assert_allclose(out[16:32], a * b + np.float32(2), rtol=1.2e-7)
    np.testing.assert_array_equal(out[32:48], np.sqrt(a.astype(np.float64)).astype(np.float32))
    np.testing.assert_array_equal(out[48:64], np.rint(a))
    np.testing.assert_array_equal(out[64:80], np.minimum(a, b))
    np.testing.assert_array_equal(out[80:96], np.maximum(a, b))
    np.testing.assert_array_equal(out[96:], np.where(b > a, a, b))


@njit
def ends(a, out):
    out[0], out[1] = smallest(load(a, 0)), largest(load(a, 0))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_ends_of_a_vector_are_found(kind):
    a, out = np.random.default_rng(2).normal(size=16).astype(kind), np.zeros(2, kind)
    ends(a, out)
    assert tuple(out) == (a.min(), a.max())


@njit
def parts(a, out):
    e, m = log2_parts(load(a, 0))
    store(out, 0, e)
    store(out, 16, m)
    store(out, 32, times_power_of_two(m, e))
    store(out, 48, times_power_of_two(m, e - splat(np.float32(200))))


def test_exponents_and_mantissas_make_the_number_again():
    a = np.geomspace(1e-30, 1e30, 16).astype(np.float32)
    out = np.zeros(64, np.float32)
    parts(a, out)
    assert (out[16:32] >= np.float32(np.sqrt(0.5))).all()
    assert (out[16:32] <= np.float32(np.sqrt(2))).all()
    np.testing.assert_array_equal(out[32:48], a)
    # Below the smallest normal number there is 0.
    assert (out[48:][a < 1e20] == 0).all()


@njit
def looked_up(table, places, out):
    bits = load(places, 0) + splat(INDEX_BITS)
    store(out, 0, gather(table, 3, bits))
    if simd.PERMUTES:
        store(out, 16, lookup16(table, 3, bits))
        store(out, 32, lookup32(table, 3, bits + load(places, 0)))


def test_lookups_in_registers_read_what_memory_holds():
    rng = np.random.default_rng(1)
    table, places = rng.normal(size=64).astype(np.float32), rng.permutation(16).astype(np.float32)
    out = np.zeros(48, np.float32)
    looked_up(table, places, out)
    np.testing.assert_array_equal(out[:16], table[3 + places.astype(int)])
    if not simd.PERMUTES:
        pytest.skip("this processor has no permutes of sixteen numbers")
    np.testing.assert_array_equal(out[16:32], table[3 + places.astype(int)])
    np.testing.assert_array_equal(out[32:], table[3 + 2 * places.astype(int)])
