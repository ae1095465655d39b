"""Positions added one by one, by the kernel for a few pulses."""

import numpy as np
import pytest
from rail_data import BANDWIDTH_HZ, CENTRE_HZ, ground, relative_db

from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import LiveImage, backproject_reference
from processing.sar.backprojection_kernel import add_pulses
from processing.sar.backprojection_live import FEW, add_few
from processing.sar.grid import HeightMapGrid, ImageGrid, PolarGrid

X, Y = np.linspace(-3, 3, 45), np.linspace(6, 11, 21)
HILLS = -1.0 + 0.2 * np.sin(3 * X)[None, :] * np.cos(2 * Y)[:, None]
HILLS[4, 7] = np.nan

GRIDS = {
    "plane": ground(X, Y),
    "one column": ground([0.4], Y),
    "uneven": ground(np.sort(np.random.default_rng(1).uniform(-3, 3, 37)), Y),
    "hills": HeightMapGrid(X, Y, HILLS),
    "polar": PolarGrid(np.linspace(0.5, 10, 21), np.radians(np.linspace(-40, 40, 45)), -1.069),
    # Pixels of two bins: windows of sixteen bins do not hold sixteen of them, nor do those of thirty-two.
    "coarse": ground(np.linspace(-15, 15, 35), np.linspace(2, 30, 40)),
    "coarser": ground(np.linspace(-25, 25, 17), np.linspace(2, 20, 9)),
}


def noise(pulses, channels=1, *, moving=False, apart=False):
    """Unweighted noise of four bins a cell, which every kind of error shows in."""
    rng = np.random.default_rng(7)
    spectrum = np.zeros((channels, pulses, 512), complex)
    spectrum[..., :128] = rng.normal(size=(channels, pulses, 128)) + 1j * rng.normal(size=(channels, pulses, 128))
    values = np.fft.fft(np.roll(spectrum, -64, axis=-1))[..., :460] / 16
    antenna = np.column_stack([np.linspace(-0.5, 0.5, pulses), np.zeros((pulses, 2))])
    pairs = tuple(AntennaPair((0.1 * c, 0.0, 0.05), (-0.2, 0.0, 0.1 * (c % 2))) for c in range(channels))
    return RangeProfiles(
        values.astype(np.complex64), 0.468 * np.arange(-30, 430), antenna, ("HH", "HV", "VH", "VV")[:channels],
        CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True, pairs=pairs if apart else None,
        velocity_m_s=np.full((pulses, 3), 3.0) if moving else None, ramp_s=0.02 if moving else None,
    )  # fmt: skip


@pytest.mark.parametrize("name", GRIDS)
@pytest.mark.parametrize("beamwidth", [None, 1.2])
def test_a_single_position_is_what_the_reference_has(name, beamwidth):
    data, grid = noise(1, channels=2), GRIDS[name]
    live = LiveImage(grid, interpolator="sinc8", beamwidth_rad=beamwidth, depression_rad=0.3)
    live.add(data)
    plain = backproject_reference(data, grid, interpolator="sinc8", beamwidth_rad=beamwidth, depression_rad=0.3)
    np.testing.assert_array_equal(np.isnan(live.image()), np.isnan(plain))
    # float32 tables, phasors and sums: 1e-7 each; the fit of the filter's polynomials lies 26 dB below -94 dB. With a
    # pattern the noise is divided by its float32 power, to six more roundings.
    assert relative_db(live.image(), plain) < -112


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("apart", [False, True])
def test_motion_and_pairs_of_antennas_are_what_the_reference_has(moving, apart):
    data = noise(2, channels=4, moving=moving, apart=apart)
    live = LiveImage(GRIDS["plane"], beamwidth_rad=1.2, depression_rad=0.3)
    live.add(data)
    plain = backproject_reference(data, GRIDS["plane"], interpolator="sinc8", beamwidth_rad=1.2, depression_rad=0.3)
    assert relative_db(live.image(), plain) < -112


def test_few_and_many_pulses_meet_where_the_kernels_change():
    # The same pulses by either kernel: rounding of float32 sums, 1e-7 each.
    data = noise(FEW + 1, channels=2)
    whole, parts = (LiveImage(GRIDS["plane"]) for _ in range(2))
    whole.add(data)
    for n in range(FEW + 1):
        one = RangeProfiles(
            data.values[:, n : n + 1], data.range_m, data.antenna_m[n : n + 1], data.channels, CENTRE_HZ, BANDWIDTH_HZ,
            "rectangular", True,
        )  # fmt: skip
        parts.add(one)
    assert add_few.signatures
    assert add_pulses.signatures
    assert relative_db(parts.image(), whole.image()) < -115


def test_a_live_image_far_away_in_fine_bins():
    # 10 GHz and 10 km: turns of phase in float64 only; rows of pixels along range, so that patches are columns.
    rng = np.random.default_rng(3)
    antenna = np.array([[10e3, 0.0, 500.0]])
    start = np.linalg.norm(antenna, axis=1) - 60.0
    values = (rng.normal(size=(1, 1, 2000)) + 1j * rng.normal(size=(1, 1, 2000))).astype(np.complex64)
    data = RangeProfiles(values, 0.06 * np.arange(2000), antenna, ("HH",), 10e9, 600e6, "hann", True, start_m=start)
    grid = ImageGrid(np.linspace(-20, 20, 161), np.linspace(-20, 20, 51), 0.0)
    live = LiveImage(grid, interpolator="lagrange4")
    live.add(data)
    plain = backproject_reference(data, grid, interpolator="lagrange4")
    assert np.isfinite(plain).all()
    assert relative_db(live.image(), plain) < -112
