import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_recordings import C, Point, recording

from processing.errors import DataError
from processing.radar.beat import TriangleFm, beat, sync
from processing.radar.ranging import (
    WINDOWS,
    Sweeps,
    average,
    compress,
    compress_reference,
    cut_sweeps,
    full_scale,
    range_axis,
    remove_coupling,
    unambiguous_range_m,
    window_weights,
)
from processing.radar.sync import find_sync

RATE, RAMP, CENTRE, BANDWIDTH = 48_000.0, 960.25, 2.4e9, 80e6
CELL = C / (2 * BANDWIDTH)
AXIS = range_axis(BANDWIDTH, 120.0)
WAVEFORM = {"centre_hz": CENTRE, "bandwidth_hz": BANDWIDTH}


def one_sweep(range_m, amplitude=1.0, first=0.3, ramp=RAMP):
    """Closed form of the up-ramp's beat of one point."""
    t = (np.arange(int(ramp) + 1) + first - ramp / 2) / RATE
    slope, tau = BANDWIDTH / (ramp / RATE), 2 * range_m / C
    beat = (np.conj(amplitude) * np.exp(1j * (2 * np.pi * tau * (CENTRE + slope * t) - np.pi * slope * tau**2))).real
    return Sweeps(beat[None], np.array([first]), ramp, RATE, np.zeros(1))


def envelope(window, cells):
    """The window's transform at a distance in cells, by the midpoint rule (error (pi cells / 20,000)^2 / 24)."""
    x = (np.arange(20_000) + 0.5) / 20_000 - 0.5
    shape = window_weights(window, x, 1e9)
    return (shape * np.cos(2 * np.pi * cells * x)).sum() / shape.sum()


def leakage(window, range_m):
    """Bound on the relative error at a point's range: its mirror image, and the mean that is taken off."""
    cells = range_m / CELL
    return abs(envelope(window, 2 * cells)) + 2 * envelope(window, cells) ** 2


@pytest.mark.parametrize("window", WINDOWS)
@pytest.mark.parametrize("range_m", [2 * CELL, 2.4 * CELL, 3.7 * CELL, 9.1, 17.77, 30.0, 61.803, 99.9])
def test_amplitude_and_phase_are_those_of_the_closed_form(window, range_m):
    amplitude = 0.7 * np.exp(1.1j)
    profile = compress_reference(one_sweep(range_m, amplitude), np.array([range_m]), window=window, **WAVEFORM)[0, 0]
    expected = amplitude * np.exp(-4j * np.pi * CENTRE * range_m / C)
    # Beyond leakage: sums stand for integrals over 960 samples, exact for Hann, to the ramp's cut ends for the others.
    discrete = 1e-6 if window == "hann" else 1.0 / RAMP
    assert abs(profile / expected - 1) < leakage(window, range_m) * 1.001 + discrete


def test_what_the_mirror_image_does_near_two_cycles_per_ramp():
    # Hann: W(4) + 2 W(2)^2 with W(x) <= 1 / (pi x (x^2 - 1)): 1.1 % at worst, -39 dB.
    errors = []
    for cells in np.linspace(2.0, 3.0, 41):
        profile = compress_reference(one_sweep(cells * CELL), np.array([cells * CELL]), **WAVEFORM)[0, 0]
        errors.append(abs(profile * np.exp(4j * np.pi * CENTRE * cells * CELL / C) - 1))
    assert max(errors) < 0.011
    # Within one cell of zero no profile can tell the point from its image: the docstring warns of it.
    near = compress_reference(one_sweep(0.6 * CELL), np.array([0.6 * CELL]), **WAVEFORM)[0, 0]
    assert abs(near * np.exp(4j * np.pi * CENTRE * 0.6 * CELL / C) - 1) > 0.1


@pytest.mark.parametrize("window", WINDOWS)
def test_the_fast_path_equals_the_direct_sum(window):
    rng = np.random.default_rng(2)
    sweeps = Sweeps(rng.normal(size=(5, 961)), rng.uniform(size=5), RAMP, RATE, np.zeros(5))
    options = {"window": window, "range_offset_m": 1.37, **WAVEFORM}
    reference = compress_reference(sweeps, AXIS, **options)
    # Chirp-z in float64: rounding grows with log2 of the transform's length (4096) and the window's peak over mean.
    assert np.abs(compress(sweeps, AXIS, **options) - reference).max() < 2e-13


@given(st.floats(0, 0.9999), st.floats(900.0, 999.0))
@settings(max_examples=30, deadline=None)
def test_fractions_of_a_sample_leave_no_trace(first, ramp):
    range_m = 40.0
    profile = compress_reference(one_sweep(range_m, first=first, ramp=ramp), np.array([range_m]), **WAVEFORM)[0, 0]
    error = profile * np.exp(4j * np.pi * CENTRE * range_m / C) - 1
    # Hann at 21 cycles: W(42) = 4e-6, 2 W(21)^2 = 2e-9; a whole sample of error would turn the phase by 0.14 rad.
    assert abs(error) < 6e-6


def test_residual_video_phase_is_taken_off():
    range_m = 800.0
    profile = compress_reference(one_sweep(range_m), np.array([range_m]), **WAVEFORM)[0, 0]
    slope, tau = BANDWIDTH * RATE / RAMP, 2 * range_m / C
    assert np.pi * slope * tau**2 > 0.3  # what would be left
    assert abs(profile * np.exp(4j * np.pi * CENTRE * range_m / C) - 1) < 1e-6


def test_the_envelope_is_real_and_even():
    range_m = 50.0
    away = np.linspace(0, 3 * CELL, 13)
    values = [
        compress_reference(one_sweep(range_m), range_m + side * away, **WAVEFORM)[0]
        * np.exp(4j * np.pi * CENTRE * range_m / C)
        for side in (1, -1)
    ]
    expected = [envelope("hann", cells) for cells in away / CELL]
    for side in values:
        # Off the peak the residual video phase is that of the bin, not of the point: pi K (tau^2 - tau_r^2) = 5e-4.
        assert np.abs(side - expected).max() < 1e-3
    assert np.abs(values[0] - values[1]).max() < 1e-3


def test_range_offset_moves_targets_and_keeps_their_phase():
    range_m, offset = 33.0, 2.6
    sweep = one_sweep(range_m + offset)  # the electronics add their path
    profile = compress(sweep, AXIS, range_offset_m=offset, **WAVEFORM)[0]
    assert abs(AXIS[np.argmax(np.abs(profile))] - range_m) <= (AXIS[1] - AXIS[0]) / 2 + 1e-9
    exact = compress_reference(sweep, np.array([range_m]), range_offset_m=offset, **WAVEFORM)[0, 0]
    assert abs(exact * np.exp(4j * np.pi * CENTRE * range_m / C) - 1) < 1e-4


@given(st.lists(st.tuples(st.floats(10, 110), st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=4))
@settings(max_examples=20, deadline=None)
def test_compression_is_linear(points):
    parts = [one_sweep(r, complex(a, b)) for r, a, b in points]
    together = Sweeps(sum(p.beat for p in parts), parts[0].first, RAMP, RATE, np.zeros(1))
    separate = sum(compress(part, AXIS, **WAVEFORM) for part in parts)
    assert np.abs(compress(together, AXIS, **WAVEFORM) - separate).max() < 1e-12


@given(st.permutations(range(6)), st.integers(0, 2**31))
@settings(max_examples=40, deadline=None)
def test_the_average_has_the_same_bits_in_any_order(order, seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(6, 40, 2)).view(np.complex128)[..., 0] * 10.0 ** rng.integers(-8, 8, size=(6, 1))
    assert average(values).tobytes() == average(values[list(order)]).tobytes()
    assert np.allclose(average(values), values.mean(axis=0), rtol=1e-12, atol=1e-12 * np.abs(values).max())


@pytest.mark.parametrize("dtype", [np.int16, np.float32])
def test_a_record_has_the_same_profile_bits_wherever_it_starts(dtype):
    # Two sweeps that differ by half a sample alternate: any four whole ones are the same set.
    points = [Point(20.0), Point(52.0, amplitude=0.02 + 0.05j)]
    profiles = []
    for start in (100.0, 100.0 + 960.5, 100.0 - 1920.5, 140.0):
        samples, _, _ = recording(points, seconds=0.3, start=start, dtype=dtype)
        sweeps = cut_sweeps(samples, find_sync(samples, RATE), count=4, ramp_samples=960.25)
        profiles.append(average(compress(sweeps, AXIS, **WAVEFORM)))
    # starts at 100.0 and 100.0 - 1920.5 see halves in the other order; 140.0 sees other samples of the same sweeps.
    assert profiles[0].tobytes() == profiles[2].tobytes()
    assert profiles[0].tobytes() == profiles[3].tobytes()
    assert np.abs(profiles[0] - profiles[1]).max() < 2e-5  # other fractions of a sample: equal but for rounding


def test_a_whole_recording_gives_range_amplitude_and_phase():
    points = [Point(24.0, amplitude=0.3 * np.exp(0.4j)), Point(60.0, amplitude=-0.05j)]
    samples, _, _ = recording(points, dtype=np.int16, start=77.77)
    sweeps = cut_sweeps(samples, find_sync(samples, RATE))
    profiles = compress_reference(sweeps, np.array([24.0, 60.0]), **WAVEFORM)
    for column, point in enumerate(points):
        expected = point.amplitude * np.exp(-4j * np.pi * CENTRE * point.range_m / C)
        # Edges to 2e-4 sample (phase 2 pi * 32 cycles * 2e-4 / 960), int16 noise 1e-5, side lobes of the other 6e-5.
        assert np.abs(profiles[:, column] - expected).max() < 2e-4


@pytest.mark.parametrize("jitter", [0.2, 3.0])
def test_jitter_of_the_sweeps_is_followed(jitter):
    samples, _, _ = recording([Point(60.0, amplitude=0.3)], jitter=jitter, seconds=1.0)
    sweeps = cut_sweeps(samples, find_sync(samples, RATE), ramp_samples=960.25)
    profiles = compress_reference(sweeps, np.array([60.0]), **WAVEFORM)[:, 0]
    assert np.abs(profiles * np.exp(4j * np.pi * CENTRE * 60.0 / C) / 0.3 - 1).max() < 2e-4


@given(st.floats(0.05, 30.0))
@settings(max_examples=20, deadline=None)
def test_moving_a_target_moves_its_envelope_and_turns_its_phase(away):
    near = compress_reference(one_sweep(30.0), np.array([28.5, 30.0, 32.2]), **WAVEFORM)[0]
    far = compress_reference(one_sweep(30.0 + away), np.array([28.5, 30.0, 32.2]) + away, **WAVEFORM)[0]
    # Side lobes of the image at 32 cycles and above (3e-5), residual video phase across the cell (5e-4 rad).
    assert np.abs(far - near * np.exp(-4j * np.pi * CENTRE * away / C)).max() < 1e-3


def test_cutting_takes_whole_ramps_only_and_counts_them():
    samples, starts, ends = recording([Point(20.0)], dtype=np.int16)
    clock = find_sync(samples, RATE)
    sweeps = cut_sweeps(samples, clock)
    inside = (starts > 24) & (ends < len(samples) - 24)
    assert len(sweeps.beat) == inside.sum()
    assert ((sweeps.first >= 0) & (sweeps.first < 1)).all()
    index = int(np.ceil(starts[inside][1]))
    assert np.array_equal(sweeps.beat[1], samples[index : index + 961, 0] / 32_768)
    assert len(cut_sweeps(samples, clock, count=3).beat) == 3
    with pytest.raises(DataError, match="100 wanted"):
        cut_sweeps(samples, clock, count=100)


def test_windows_have_their_side_lobes():
    # Published: Hann -31.5 dB, rectangular -13.3 dB; Taylor as designed, -35 dB.
    cells = np.arange(1.0, 12.0, 0.05)
    for window, beyond, level in (("hann", 2.0, -31.5), ("rectangular", 1.0, -13.3), ("taylor", 1.6, -35.0)):
        side = max(abs(envelope(window, x)) for x in cells[cells >= beyond])
        assert 20 * np.log10(side) == pytest.approx(level, abs=0.35)


def test_axis_and_limits():
    axis = range_axis(BANDWIDTH, 60.0, 8)
    assert np.allclose(np.diff(axis), CELL / 8)
    assert 60.0 <= axis[-1] < 60.0 + CELL / 8
    # Thesis Table 5.1: 900 m for 80 MHz, 20 ms, 48 kHz.
    assert unambiguous_range_m(80e6, 960) == pytest.approx(900, abs=1)
    assert (full_scale(np.dtype(np.int16)), full_scale(np.dtype(np.float32))) == (32_768.0, 1.0)
    for bad in ((0.0, 10.0, 8), (BANDWIDTH, -1.0, 8), (BANDWIDTH, np.nan, 8), (BANDWIDTH, 10.0, 0)):
        with pytest.raises(DataError):
            range_axis(*bad)
    with pytest.raises(DataError, match="the sample rate allows"):
        compress(one_sweep(20.0), range_axis(BANDWIDTH, 1000.0), **WAVEFORM)
    with pytest.raises(DataError, match="not uniform"):
        compress(one_sweep(20.0), np.array([1.0, 2.0, 4.0]), **WAVEFORM)
    with pytest.raises(DataError, match="unknown window"):
        compress(one_sweep(20.0), AXIS, window="kaiser", **WAVEFORM)


def test_coupling_is_removed_and_undefined_positions_stay_undefined():
    rng = np.random.default_rng(0)
    coupling = rng.normal(size=(2, 1, 30)) + 0j
    targets = rng.normal(size=(2, 5, 30)) + 1j * rng.normal(size=(2, 5, 30))
    targets -= targets.mean(axis=1, keepdims=True)
    assert np.allclose(remove_coupling(targets + coupling), targets)
    assert np.allclose(remove_coupling(targets + coupling, coupling), targets)
    holed = targets + coupling
    holed[1, 2] = np.nan
    result = remove_coupling(holed)
    assert np.isnan(result[1, 2]).all()
    assert np.isfinite(np.delete(result, 2, axis=1)).all()
    assert np.allclose(result[0], targets[0])


def test_the_simulators_beat_and_sync_come_back_as_range_profile():
    # The project's own model of the beat, written apart from this: same amplitude, phase and place.
    fm = TriangleFm(CENTRE, BANDWIDTH, RAMP / RATE, 1920.5 / RATE)
    since = ((np.arange(12_000) - 77.3) % 1920.5) / RATE
    frequency, slope = fm.frequency(since)
    place, scattering = np.array([[3.0, 20.0, -1.0]]), np.array([0.6 * np.exp(0.9j)])
    range_m = float(np.linalg.norm(place))
    voltage = beat(frequency, slope, np.zeros(3), place, scattering)
    samples = np.stack([voltage, sync(fm, since, 3 / RATE)], axis=1)
    sweeps = cut_sweeps(samples, find_sync(samples, RATE))
    values = compress_reference(sweeps, np.array([range_m]), **WAVEFORM)[:, 0]
    expected = scattering[0] / range_m**2 * np.exp(-4j * np.pi * CENTRE * range_m / C)
    # The mirror image (3e-5 here), and instants to 2^-17 sample, a phase of 5e-7.
    assert np.abs(values / expected - 1).max() < leakage("hann", range_m) + 1e-6
