import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CELL_M, CENTRE_HZ, C, ground, rail, relative_db, sinc_profiles

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.radar.ranging import Sweeps, compress
from processing.sar.backprojection import LiveImage, backproject, backproject_reference
from processing.sar.continuous import sweep_motion
from processing.sar.grid import HeightMapGrid, ImageGrid, PolarGrid
from processing.sar.interpolation import INTERPOLATOR_TAPS, tap_weights
from processing.sar.quality import carrier_of, point_response
from processing.sar.segments import filter_error_db, segment_polynomials

NARROW = ground(np.arange(-2, 2, 0.05), np.arange(7, 11, 0.1))
"""As fine as an image of the rail is: offsets within a patch of pixels are float32 here."""


def profiles_of(targets, antenna, *, centre_hz, bandwidth_hz, first_m, bins, oversampling=4, pairs=None, start_m=None):
    """Unweighted point echoes of unit amplitude: ``sinc((r - R) / cell) exp(-j 4 pi fc R / c)``, R half the path."""
    cell = C / (2 * bandwidth_hz)
    axis = first_m + cell / oversampling * np.arange(bins)
    pairs = (AntennaPair(),) if pairs is None else pairs
    starts = np.zeros(len(antenna)) if start_m is None else start_m
    values = np.zeros((len(pairs), len(antenna), bins), dtype=complex)
    for c, pair in enumerate(pairs):
        for target in targets:
            away = sum(
                np.linalg.norm(antenna + np.array(end) - np.array(target), axis=1)
                for end in (pair.transmit_m, pair.receive_m)
            )
            half = away[:, None] / 2
            values[c] += np.sinc((axis + starts[:, None] - half) / cell) * np.exp(-4j * np.pi * centre_hz / C * half)
    names = ("HH", "HV", "VH", "VV")[: len(pairs)]
    return RangeProfiles(
        values,
        axis,
        antenna,
        names,
        centre_hz,
        bandwidth_hz,
        "rectangular",
        True,
        start_m=start_m,
        pairs=None if len(pairs) == 1 and pairs[0] == AntennaPair() else pairs,
    )


def circle(count=40, radius=30.0, height=10.0):
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, height)])


def bent(count=31):
    x = np.linspace(-0.75, 0.75, count)
    return np.column_stack([x, 0.03 * np.cos(3 * x), 0.01 * np.sin(5 * x)])


@pytest.mark.parametrize("interpolator", ["linear", "cubic", "lagrange4", "sinc8"])
@pytest.mark.parametrize(
    ("antenna", "grid", "first_m"),
    [
        (bent(), NARROW, -8.0),
        (circle(), ImageGrid(np.arange(-1, 1, 0.06), np.arange(-1, 1, 0.06), 0.0), 20.0),
    ],
)
def test_kernel_follows_the_reference_on_any_track(antenna, grid, first_m, interpolator):
    places = [(0.3, 8.0, -1.069), (-1.0, 9.5, -1.069)] if first_m < 0 else [(0.2, -0.4, 0.0), (-0.5, 0.3, 0.0)]
    data = profiles_of(places, antenna, centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, first_m=first_m, bins=120)
    kernel = backproject(data, grid, interpolator=interpolator)
    plain = backproject_reference(data, grid, interpolator=interpolator)
    # Float32 sums and phasors, 1e-7; offsets of at most 4e-6 turns at the very worst pixel.
    assert relative_db(kernel, plain) < -118


@pytest.mark.parametrize("interpolator", ["linear", "cubic", "lagrange4", "sinc8"])
@pytest.mark.parametrize("range_m", [0.1, 10.0, 1e3, 1e6])
def test_arithmetic_is_exact_from_a_hand_to_an_orbit_away(range_m, interpolator):
    # A tenth of a metre: the antenna is nearer than a patch is wide; 1000 km: 30 million turns of phase at 5 GHz.
    length = min(0.04, 0.5 * range_m) if range_m < 1 else 0.03 * range_m
    antenna = np.column_stack([np.linspace(-length / 2, length / 2, 25), np.full(25, -range_m), np.zeros(25)])
    step = 0.002 if range_m < 1 else 0.05
    grid = ImageGrid(step * np.arange(-20, 21), step * np.arange(-16, 17) + 0.02, 0.0)
    data = profiles_of(
        [(step * 3.3, 0.02, 0.0)],
        antenna,
        centre_hz=5e9,
        bandwidth_hz=0.5e9,
        first_m=range_m - 12.0,
        bins=400,
        start_m=np.linalg.norm(antenna, axis=1) - range_m,
    )
    kernel = backproject(data, grid, interpolator=interpolator)
    plain = backproject_reference(data, grid, interpolator=interpolator)
    assert np.isfinite(plain).all()
    assert relative_db(kernel, plain) < -100


def test_two_antennas_see_half_the_path():
    pairs = (
        AntennaPair((0.2, 0.0, 0.1), (-0.3, 0.1, 0.0)),
        AntennaPair((0.2, 0.0, 0.1), (0.4, 0.0, -0.2)),
        AntennaPair((0.2, 0.0, 0.1), (-0.3, 0.1, 0.0)),
    )
    place = (0.5, 8.5, -1.069)
    data = profiles_of(
        [place], bent(), centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, first_m=-8.0, bins=120, pairs=pairs
    )
    at_target = backproject(data, ground([place[0]], [place[1]]), interpolator="sinc16")[:, 0, 0]
    # Closed form: every pulse adds its whole amplitude with no phase left. Sixteen taps at four bins a cell: 3e-7.
    np.testing.assert_allclose(at_target, 1.0, atol=3e-6)
    kernel, plain = backproject(data, NARROW), backproject_reference(data, NARROW, interpolator="sinc8")
    assert relative_db(kernel, plain) < -118
    # Control: taken for one antenna in the middle the phases are wrong.
    alone = backproject(replace(data, pairs=None), ground([place[0]], [place[1]]))[:, 0, 0]
    assert (np.abs(alone - 1) > 0.1).all()


def test_first_ranges_of_their_own_serve_tracks_that_come_from_afar():
    antenna = np.column_stack([np.linspace(-200, 200, 33), np.full(33, -500.0), np.full(33, 100.0)])
    start = np.linalg.norm(antenna, axis=1) - 510.0
    common = {"centre_hz": 5e9, "bandwidth_hz": 0.3e9}
    own = profiles_of([(1.0, 2.0, 0.0)], antenna, first_m=500.0, bins=170, start_m=start, **common)
    whole = profiles_of([(1.0, 2.0, 0.0)], antenna, first_m=480.0, bins=800, **common)
    grid = ImageGrid(np.arange(-2, 4, 0.2), np.arange(0, 4, 0.2), 0.0)
    # Interpolation falls on other places between bins: twice the filter's error, -94 dB.
    assert relative_db(backproject(own, grid), backproject(whole, grid)) < -88
    # Offsets within a patch up to the bound of float32, a tenth of it in the mean, and the polynomials' fit, -121 dB.
    assert relative_db(backproject(own, grid), backproject_reference(own, grid, interpolator="sinc8")) < -110


def test_heights_and_polar_coordinates_are_places_like_others():
    data = profiles_of(
        [(0.3, 8.0, -0.5)], bent(), centre_hz=CENTRE_HZ, bandwidth_hz=BANDWIDTH_HZ, first_m=-8.0, bins=120
    )
    x, y = np.linspace(-2, 2, 21), np.linspace(7, 10, 19)
    height = -1 + 0.3 * np.sin(x)[None, :] * np.cos(y)[:, None]
    height[3, 5] = np.nan
    hilly = backproject(data, HeightMapGrid(x, y, height))[0]
    assert np.isnan(hilly[3, 5])
    assert np.isfinite(np.delete(hilly.ravel(), 3 * 21 + 5)).all()
    polar = PolarGrid(np.linspace(0.5, 12, 24), np.radians(np.linspace(-40, 40, 17)), -1.0)
    fan = backproject(data, polar)[0]
    # Nearer than the height above the plane there is no ground.
    np.testing.assert_array_equal(np.isnan(fan), np.broadcast_to(polar.range_m[:, None] < 1.0, fan.shape))
    for row, column in ((0, 0), (9, 20), (18, 10)):
        alone = backproject(data, ImageGrid(x[[column]], y[[row]], float(height[row, column])))[0, 0, 0]
        assert hilly[row, column] == pytest.approx(alone, abs=2e-6)
    for row, column in ((3, 2), (12, 8), (23, 16)):
        away = np.sqrt(polar.range_m[row] ** 2 - 1)
        here = ImageGrid(*([away * f(polar.angle_rad[column])] for f in (np.sin, np.cos)), -1.0)
        assert fan[row, column] == pytest.approx(backproject(data, here)[0, 0, 0], abs=2e-6)


def moving_sweeps(antenna, velocity, target, ramp_s, rate_hz, centre_hz, bandwidth_hz):
    """The beat of a moving platform from first principles: the delay is solved for at every sample."""
    count = round(ramp_s * rate_hz)
    t = (np.arange(count) + 0.5) / rate_hz - ramp_s / 2
    delay = np.full((len(antenna), count), 0.0)
    for _ in range(5):
        back = np.linalg.norm(antenna[:, None] + velocity * t[:, None] - target, axis=-1)
        out = np.linalg.norm(antenna[:, None] + velocity * (t - delay)[..., None] - target, axis=-1)
        delay = (out + back) / C
    slope = bandwidth_hz / ramp_s
    beat = np.cos(2 * np.pi * delay * (centre_hz + slope * t) - np.pi * slope * delay**2)
    return Sweeps(beat, np.full(len(antenna), 0.5), float(count), rate_hz, np.arange(len(antenna)) * ramp_s)


@pytest.mark.parametrize(
    ("centre_hz", "bandwidth_hz", "ramp_s", "speed", "distance"),
    [(2.4e9, 80e6, 0.02, 0.5, 30.0), (10e9, 150e6, 1e-3, 30.0, 400.0)],
)
def test_motion_within_sweeps_is_modelled_where_it_matters(centre_hz, bandwidth_hz, ramp_s, speed, distance):
    # A trolley and an aircraft with FMCW radars that look 50 degrees ahead, so that they close on the target.
    target = np.array([distance * np.tan(np.radians(50)), distance, 0.0])
    x = np.arange(-15, 16) * 0.2 * C / centre_hz
    antenna = np.column_stack([x, np.zeros((31, 2))])
    velocity = np.array([speed, 0.0, 0.0])
    reach = np.linalg.norm(target)
    rate = round(16 * bandwidth_hz * reach / C) / ramp_s
    sweeps = moving_sweeps(antenna, velocity, target, ramp_s, rate, centre_hz, bandwidth_hz)
    axis = reach + C / (2 * bandwidth_hz) / 8 * np.arange(-120, 121)
    values = compress(sweeps, axis, centre_hz=centre_hz, bandwidth_hz=bandwidth_hz)
    data = RangeProfiles(
        values[None],
        axis,
        antenna,
        ("HH",),
        centre_hz,
        bandwidth_hz,
        velocity_m_s=np.tile(velocity, (31, 1)),
        ramp_s=ramp_s,
    )
    decided = sweep_motion(data)
    assert decided.modelled
    grid = ImageGrid(target[:1], target[1:2], 0.0)
    modelled, still = (backproject(data, grid, motion=motion)[0, 0, 0] for motion in ("auto", "still"))
    # Within 1 degree; amplitude within the quadratic phase left out and the beat's mirror image, which is far away.
    assert abs(np.degrees(np.angle(modelled))) < 1.0
    assert abs(modelled) == pytest.approx(1.0, abs=0.01)
    assert abs(still - modelled) > 3 * abs(modelled - 1)
    assert abs(still - modelled) < 10 ** (decided.still_error_db / 20)
    plain = backproject_reference(data, grid, interpolator="sinc8")[0, 0, 0]
    assert modelled == pytest.approx(plain, abs=1e-5)


def test_motion_too_slow_to_matter_is_left_out():
    data = sinc_profiles([(0.0, 8.0, 0.0)], rail(5), [[1.0]])
    slow = replace(data, velocity_m_s=np.full((5, 3), 1e-5), ramp_s=0.02)
    assert not sweep_motion(slow).modelled
    assert "left out" in sweep_motion(slow).reason
    assert sweep_motion(slow, "moving").modelled
    assert not sweep_motion(data).modelled


@pytest.mark.parametrize("beamwidth", [None, 1.2])
def test_an_image_grows_position_by_position(beamwidth):
    rng = np.random.default_rng(2)
    full = sinc_profiles([(0.3, 8.0, -1.069)], rail(), rng.normal(size=(4, 1)))
    values = full.values.copy()
    values[2, 30:33] = np.nan
    full = replace(full, values=values)
    live = LiveImage(NARROW, beamwidth_rad=beamwidth, depression_rad=0.3)
    for n in rng.permutation(61):
        one = replace(full, values=full.values[:, n : n + 1], antenna_m=full.antenna_m[n : n + 1])
        live.add(one)
        if n == 0:
            assert np.isfinite(live.image()).all()
    at_once = backproject(full, NARROW, beamwidth_rad=beamwidth, depression_rad=0.3)
    # Sums in another order, each rounded to float32: 61 roundings of 6e-8.
    np.testing.assert_allclose(live.image(), at_once, atol=4e-6 * np.abs(at_once).max())
    with pytest.raises(DataError, match="other channels"):
        live.add(replace(full, channels=("a", "b", "c", "d")))


@pytest.mark.parametrize("place", [(-60.0, 9930.0), (0.0, 10000.0), (45.0, 10080.0)])
def test_a_point_is_a_sinc_wherever_it_stands(place):
    # Ten kilometres away and half a degree of aperture: range and cross-range part, each an unweighted band.
    centre, bandwidth = 10e9, 150e6
    antenna = np.column_stack([np.linspace(-44, 44, 111), np.zeros((111, 2))])
    cell = C / (2 * bandwidth)
    data = profiles_of(
        [(*place, 0.0)],
        antenna,
        centre_hz=centre,
        bandwidth_hz=bandwidth,
        first_m=place[1] - 40,
        bins=640,
        oversampling=8,
    )
    grid = ImageGrid(place[0] + 0.4 * np.arange(-40, 41), place[1] + 0.25 * np.arange(-60, 61), 0.0)
    image = backproject(data, grid)[0]
    seen = point_response(image, grid, *place, reach_m=(14.0, 12.0), carrier=carrier_of(antenna, centre))
    # sinc: first side lobe -13.26 dB, -3 dB width 0.8859 of a cell. Across: wavelength R / 2 L (thesis 2.35).
    across = C / centre * place[1] / 2 / (88 * 111 / 110)
    assert seen.y.peak_sidelobe_db == pytest.approx(-13.26, abs=0.1)
    assert seen.y.width_m == pytest.approx(0.8859 * cell, rel=0.01)
    assert seen.x.peak_sidelobe_db == pytest.approx(-13.26, abs=0.1)
    assert seen.x.width_m == pytest.approx(0.8859 * across, rel=0.01)
    at_place = backproject(data, ImageGrid(np.array(place[:1]), np.array(place[1:]), 0.0))[0, 0, 0]
    assert abs(np.degrees(np.angle(at_place))) < 1.0
    assert abs(at_place) == pytest.approx(1.0, abs=1e-4)


def test_runs_repeat_bit_for_bit_and_any_order_of_positions_will_do():
    data = sinc_profiles([(0.3, 8.0, -1.069)], rail(), [[1.0], [0.5j]])
    first, second = (backproject(data, NARROW) for _ in range(2))
    assert first.tobytes() == second.tobytes()
    order = np.random.default_rng(0).permutation(61)
    shuffled = replace(data, values=data.values[:, order], antenna_m=data.antenna_m[order])
    np.testing.assert_allclose(backproject(shuffled, NARROW), first, atol=2e-6)


def test_one_place_is_no_aperture_but_an_image_of_ranges():
    # All positions the same: every pixel shows the profile at its range.
    antenna = np.zeros((7, 3))
    data = sinc_profiles([(0.0, 8.0, 0.0)], antenna, [[1.0]])
    image = backproject(data, ground([0.0, 3.0], np.linspace(7, 9, 9), z=0.0), interpolator="sinc16")[0]
    away = np.hypot(np.array([0.0, 3.0]), np.linspace(7, 9, 9)[:, None])
    expected = np.sinc((away - 8) / CELL_M) * np.exp(4j * np.pi * CENTRE_HZ / C * (away - 8))
    np.testing.assert_allclose(image, expected, atol=3e-6)


def test_images_take_little_memory():
    rng = np.random.default_rng(0)
    values = (rng.normal(size=(1, 512, 1200)) + 1j).astype(np.complex64)
    antenna = np.column_stack([np.linspace(-3, 3, 512), np.zeros((512, 2))])
    data = RangeProfiles(values, 0.1 * np.arange(1200), antenna, ("HH",), CENTRE_HZ, 300e6)
    grid = ImageGrid(np.linspace(-3, 3, 300), np.linspace(5, 20, 100), -1.0)
    backproject(data, NARROW)
    tracemalloc.start()
    try:
        image = backproject(data, grid, interpolator="linear")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # The limit holds for what is allocated beside the profiles that were there before; tables take 16 MB at most.
    assert peak < 16e6 + 2 * values.nbytes + 3 * image.nbytes


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"pairs": (AntennaPair(),) * 2}, "pairs of antennas"),
        ({"pairs": (AntennaPair((0.0, np.nan, 0.0)),)}, "pairs of antennas"),
        ({"start_m": np.zeros(3)}, "starts of ranges"),
        ({"start_m": np.full(5, np.inf)}, "starts of ranges"),
        ({"velocity_m_s": np.zeros((4, 3)), "ramp_s": 0.02}, "velocities"),
        ({"velocity_m_s": np.ones((5, 3))}, "length of the ramp"),
    ],
)
def test_geometry_that_does_not_fit_is_refused(changes, words):
    data = replace(sinc_profiles([(0.0, 8.0, 0.0)], rail(5), [[1.0]]), **changes)
    for method in (backproject, backproject_reference):
        with pytest.raises(DataError, match=words):
            method(data, ground([0.0], [8.0]))


@pytest.mark.parametrize(
    "grid",
    [
        HeightMapGrid(np.zeros(0), np.ones(1), np.zeros((1, 0))),
        HeightMapGrid(np.arange(3.0), np.arange(2.0), np.zeros((3, 2))),
        PolarGrid(np.arange(3.0), np.zeros(0), 0.0),
        PolarGrid(np.arange(3.0), np.zeros(1), np.nan),
        PolarGrid(np.array([1.0, np.inf]), np.zeros(1), 0.0),
    ],
)
def test_grids_without_places_are_refused(grid):
    data = sinc_profiles([(0.0, 8.0, 0.0)], rail(5), [[1.0]])
    for method in (backproject, backproject_reference):
        with pytest.raises(DataError):
            method(data, grid)


@pytest.mark.parametrize("oversampling", [1.0, 2.0, 4.0, 8.0])
@pytest.mark.parametrize("name", INTERPOLATOR_TAPS)
def test_polynomials_between_bins_are_the_filters(name, oversampling):
    fitted = segment_polynomials(name, oversampling)
    w = np.linspace(0, 1, 41)
    weights = tap_weights(name, w, oversampling)
    made = np.vander(w - 0.5, len(fitted), increasing=True) @ fitted
    if name in ("linear", "cubic", "lagrange4", "sinc8"):
        assert len(fitted) in {"linear": (2,), "sinc8": (3, 4, 5)}.get(name, (4,))
        np.testing.assert_allclose(made, weights, atol=1e-14)
    # What counts is their response within the band: 26 dB below the filter's own error; 6 dB for the sampling.
    cycles = np.linspace(-0.5, 0.5, 41) / oversampling
    waves = np.exp(2j * np.pi * np.outer(np.arange(weights.shape[1]), cycles))
    error = 20 * np.log10(np.sqrt(np.mean(np.abs((made - weights) @ waves) ** 2)) + 1e-20)
    assert error < max(filter_error_db(name, oversampling) - 26, -150) + 6
