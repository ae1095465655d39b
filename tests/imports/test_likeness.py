import numpy as np
import pytest

from processing.errors import DataError
from processing.radar.likeness import difference, neighbour_difference, repeated

C = 299_792_458.0
LAMBDA = C / 2.4e9
BINS = 40


def profiles(x, targets, noise=0.0, seed=0):
    """Hann-like envelopes with the carrier's phase, from the geometry: independent of the code under test."""
    rng = np.random.default_rng(seed)
    ranges = np.arange(BINS) * 0.94
    values = np.zeros((len(x), BINS), complex)
    for place, amplitude in targets:
        r = np.hypot(np.asarray(x) - place[0], place[1])
        offset = (ranges[None, :] - r[:, None]) / 1.87
        envelope = np.where(abs(offset) < 2, np.cos(np.pi * offset / 4) ** 2, 0)
        values += amplitude * envelope * np.exp(-4j * np.pi * r / LAMBDA)[:, None]
    values += np.sqrt(noise / 2) * (rng.normal(size=values.shape) + 1j * rng.normal(size=values.shape))
    return values, np.full(len(x), noise)


def rail(stops, step=0.0508):
    return (np.asarray(stops) - np.mean(sorted(set(stops)))) * step


TARGETS = [((-1.0, 6.0), 1.0), ((1.5, 14.0), 0.5)]


@pytest.mark.parametrize("noise", [0.0, 1e-4])
@pytest.mark.parametrize("doubled", [1, 5, 17, 39])
def test_a_doubled_stop_is_found(noise, doubled):
    stops = sorted([*range(40), doubled])
    assert repeated(*profiles(rail(stops), TARGETS, noise)) == [doubled + 1]


@pytest.mark.parametrize("count", [40, 41])
@pytest.mark.parametrize("noise", [0.0, 1e-4, 1e-2])
def test_no_doubled_stop_is_made_up(noise, count):
    # A target abreast of the middle: of an even number of stops the two in the middle are mirror images.
    for targets in (TARGETS, [((0.0, 8.0), 1.0)], [((0.0, 30.0), 1.0)]):
        assert repeated(*profiles(rail(range(count)), targets, noise)) == []


def test_noise_alone_tells_nothing():
    values, noise = profiles(rail(range(30)), [], 0.1)
    assert neighbour_difference(values, noise) is None
    assert repeated(values, noise) == []
    assert repeated(values[:2], noise[:2]) == []


def test_noise_is_taken_off_a_difference():
    values, _ = profiles(np.zeros(2000), TARGETS, 0.3)
    # Mean over independent pairs of |n1 - n2|^2 - 2 N: zero within its own scatter (clipped at 0 from below).
    each = [difference(values[k], values[k + 1], 0.6) for k in range(0, 2000, 2)]
    assert np.mean(each) < 0.6 * BINS * 0.1
    assert difference(values[0], values[1]) > 0.4 * BINS * 0.6


def test_shapes_that_do_not_fit_are_refused():
    with pytest.raises(DataError, match="shape"):
        repeated(np.zeros((3, 4), complex), np.zeros(2))
