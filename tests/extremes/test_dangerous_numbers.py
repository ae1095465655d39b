"""Where formulas cancel, divide by nothing or lose digits: held against sixty digits over the whole range of inputs.

The largest errors stand in docs/numerics.md; each bound here is a few times what was found.
"""

from __future__ import annotations

import math
from decimal import Decimal

import numpy as np
import pytest
from exact import PI, cos, exact, relative, sin

from processing.calibration.canonical import sphere_mie_rcs
from processing.calibration.radar_equation import range_compensation, rcs_from_power, received_power
from processing.calibration.rcs import (
    dihedral_rcs,
    from_dbsm,
    plate_rcs,
    square_trihedral_rcs,
    to_dbsm,
    triangular_trihedral_rcs,
)
from processing.errors import DataError
from processing.fusion.separability import bayes_bounds, jeffries_matusita
from processing.optics import fresnel, stokes_vectors
from processing.optics.debias import debias
from processing.polarimetry.averaging import window_average
from processing.polarimetry.eigen import hermitian_eigen_of
from processing.polarimetry.entropy_bias import entropy_of
from processing.polarimetry.h_a_alpha import h_a_alpha
from processing.radar.antenna import one_way_gain
from processing.radar.beat import beat_of_ranges
from processing.radar.can import TE11, guide_wavelength_m
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.grid import ImageGrid
from processing.sar.resolution import point_resolution

EPS = np.finfo(np.float64).eps
RIGHT_ANGLES = [math.radians(d) for d in (0.0, 45.0, 90.0, 135.0, 180.0)]
NEAR_RIGHT_ANGLES = [
    angle for right in RIGHT_ANGLES for angle in (right, math.nextafter(right, -9), math.nextafter(right, 9))
]


def test_debiasing_where_signal_or_noise_vanishes() -> None:
    worst = 0.0
    for p in (1e-300, 1e-150, 1e-30, 1e-8, 1e-3, 0.5, 1.0, 7.0, 1e3, 1e8, 1e150):
        for b2 in (1e-300, 1e-20, 1e-4, 1.0, 1e6, 1e300):
            x, y = exact(p), exact(b2)
            ratio = x * x / y
            # p - b^2 (1 - exp(-p^2/b^2)) / (2 p); the series where sixty digits would cancel
            true = x / 2 + ratio * x / 4 if ratio < Decimal("1e-25") else x - y * (1 - (-ratio).exp()) / (2 * x)
            worst = max(worst, relative(float(debias(p, b2)), true))
    assert worst < 4 * EPS
    assert float(debias(0.0, 1.0)) == 0.0
    assert float(debias(0.3, 0.0)) == 0.3


@pytest.mark.parametrize("angle", NEAR_RIGHT_ANGLES)
def test_angles_of_polarization_at_right_angles_and_an_ulp_beside(angle: float) -> None:
    state = stokes_vectors.linear(angle, 0.7)
    found = float(stokes_vectors.aop(state))
    assert abs(math.remainder(found - angle, math.pi)) < 4 * EPS * max(abs(angle), 1)
    assert -math.pi / 2 < found <= math.pi / 2
    assert float(stokes_vectors.dolp(state)) == pytest.approx(0.7, rel=2 * EPS)


def test_bayes_bounds_do_not_cancel() -> None:
    worst = 0.0
    for distance in (0.0, 1e-300, 1e-17, 1e-9, 0.1, 1.0, 9.93, 30.0, 100.0, 300.0):
        b = exact(distance)
        overlap = (-2 * b).exp()
        # 1 - sqrt(1 - x) = x / (1 + sqrt(1 - x)); digits of 1 - x are lost beyond sixty only
        lower = overlap / (1 + (1 - overlap).sqrt()) / 2
        bounds = bayes_bounds(distance)
        worst = max(worst, relative(bounds.lower, lower), relative(bounds.upper, (-b).exp() / 2))
        series = 2 * b if distance < 1e-20 else 2 * (1 - (-b).exp())
        worst = max(worst, relative(jeffries_matusita(distance), series.sqrt()))
    assert worst < 8 * EPS


def test_guide_wavelength_down_to_the_cut_off() -> None:
    wavelength = 0.1249
    limit = TE11 * wavelength / math.pi
    worst = 0.0
    for over in (1e-9, 1e-6, 1e-3, 0.1, 10.0, 1e6):
        diameter = limit * (1 + over)
        ratio = exact(TE11) * exact(wavelength) / (PI * exact(diameter))
        true = exact(wavelength) / (1 - ratio * ratio).sqrt()
        # The cut-off's own rounding is multiplied by 1 / (2 (1 - ratio)) there: no formula can do better.
        worst = max(worst, relative(guide_wavelength_m(diameter, wavelength), true) / (1 + 1 / over))
    assert worst < 4 * EPS


def test_beat_from_a_tenth_of_a_metre_to_a_thousand_kilometres() -> None:
    worst = 0.0
    speed = exact(SPEED_OF_LIGHT_M_S)
    for bandwidth in (1e3, 80e6, 10e9):
        for away in (0.1, 3.66, 1e3, 1e6):
            slope = bandwidth / 0.02
            for frequency in (2.4e9 - bandwidth / 8, 2.4e9, 10e9):
                tau = 2 * exact(away) / speed
                true = cos(2 * PI * tau * exact(frequency) - PI * exact(slope) * tau * tau)
                found = beat_of_ranges([frequency], [slope], [away], [1.0])[0]
                turns = float(tau * exact(frequency))
                worst = max(worst, abs(float(exact(found) - true)) / (2 * math.pi * max(turns, 1) * EPS))
    # Delay and product are rounded once each: in turns that is an eps of their number, 1e-8 turns at 1000 km.
    assert worst < 2.0


def test_corners_seen_along_their_edges_axes_and_an_ulp_beside() -> None:
    """Zero along an edge or wall, continuous across the branches of 5.5, never negative or undefined."""
    azimuths = [angle for angle in NEAR_RIGHT_ANGLES if -1e-9 <= angle <= math.pi / 2 + 1e-9]
    axis = math.asin(1 / math.sqrt(3))
    for azimuth in azimuths:
        for elevation in (*azimuths, axis, math.nextafter(axis, 0)):
            for formula in (square_trihedral_rcs, triangular_trihedral_rcs):
                value = float(formula(1.2, 0.125, azimuth, elevation))
                assert math.isfinite(value)
                assert value >= 0
                inside = 1e-6 < azimuth < math.pi / 2 - 1e-6 and 1e-6 < elevation < math.pi / 2 - 1e-6
                assert inside or value < 1e-25
    best = 12 * math.pi * 1.2**4 / 0.125**2
    assert float(square_trihedral_rcs(1.2, 0.125)) == pytest.approx(best, rel=8 * EPS)
    # The branches meet where the middle cosine is half of the largest: step across it, ulp by ulp.
    elevation = 0.1
    azimuth = math.atan(0.5)
    beside = [
        float(square_trihedral_rcs(1.2, 0.125, a, elevation)) for a in (azimuth - 1e-12, azimuth, azimuth + 1e-12)
    ]
    assert max(beside) / min(beside) - 1 < 1e-11


def test_plates_and_dihedrals_at_the_sincs_middle() -> None:
    """sin x / x from exactly 0 over denormal angles to grazing, against sixty digits."""
    k = 2 * PI / exact(0.125)
    peak = 4 * math.pi / 0.125**2
    for tilt in (0.0, 5e-324, 1e-300, 1e-17, 1e-8, 1e-4, 0.01, 0.3, 1.0, 1.5):
        x = k * sin(exact(tilt))
        sinc = Decimal(1) if abs(x) < Decimal("1e-40") else sin(x) / x
        true = exact(peak) * (cos(exact(tilt)) * sinc) ** 2
        found = float(plate_rcs(1.0, 1.0, 0.125, tilt, 0.0))
        # Side lobes: the error of the argument, some turns of it, counts against the main lobe's level.
        assert abs(float(exact(found) - true)) < 1e-13 * peak
    assert float(dihedral_rcs(1.0, 1.0, 0.125, 5e-324, -5e-324)) == pytest.approx(2 * peak, rel=8 * EPS)


def test_spheres_of_any_size() -> None:
    """Rayleigh's limit below, the optical limit above, no overflow of the functions in between (Mie)."""
    wavelength = 0.125
    for size in (1e-6, 1e-4, 1e-3):
        radius = size * wavelength / (2 * math.pi)
        # Rayleigh, conducting: 9 pi r^2 (k r)^4, corrections of the order (k r)^2.
        assert sphere_mie_rcs(radius, wavelength) == pytest.approx(
            9 * math.pi * radius**2 * size**4, rel=3 * size**2 + 1e-9
        )
    for size in (300.0, 3000.0):
        radius = size * wavelength / (2 * math.pi)
        assert sphere_mie_rcs(radius, wavelength) == pytest.approx(math.pi * radius**2, rel=3 / size)


def test_radar_equation_over_all_ranges() -> None:
    link = {"transmit_w": 1.0, "aperture_m2": 0.01, "wavelength_m": 0.125}
    for away in (0.1, 1.0, 1e3, 1e6):
        for sigma in (1e-10, 1.0, 1e10):
            power = received_power(sigma, away, **link)
            assert float(rcs_from_power(power, away, **link)) == pytest.approx(sigma, rel=8 * EPS)
            true = exact(0.01) ** 2 * exact(sigma) / (4 * PI * exact(0.125) ** 2 * exact(away) ** 4)
            assert relative(float(power), true) < 8 * EPS
        assert float(range_compensation(away)) == pytest.approx(away**4, rel=4 * EPS)


def test_decibels_of_everything() -> None:
    values = np.array([5e-324, 1e-300, 1e-10, 1.0, 1e10, 1e308])
    np.testing.assert_allclose(from_dbsm(to_dbsm(values[1:])), values[1:], rtol=2e-13)
    assert float(to_dbsm(0.0)) == -math.inf
    assert float(from_dbsm(-math.inf)) == 0.0


def test_fresnel_from_straight_on_to_grazing() -> None:
    """|a| from cos b = 1 to 1e-12 and n from 1 + 1e-9 to 1e4: a_ss by sixty digits, both at most 1."""
    worst = 0.0
    for index in (1 + 1e-9, 1.0003, 1.5, 4.0, 1e4):
        for cosine in (1.0, math.nextafter(1, 0), 0.7, 1e-3, 1e-8, 1e-12):
            a_ss, a_pp = fresnel.amplitudes(index, cosine)
            c, n = exact(cosine), exact(index)
            root = (n * n - (1 - c * c)).sqrt()
            true = (c - root) / (c + root)
            # Relative to 1: what is not reflected is the difference from it.
            worst = max(worst, abs(float(exact(complex(a_ss).real) - true)))
            assert abs(complex(a_pp)) <= 1 + 4 * EPS
    # Next to n = 1 the difference of two near-equal roots is what is reflected: absolute digits count there.
    assert worst < 1e-12


def test_antenna_pattern_at_its_edge() -> None:
    for cosine in (1.0, 1e-300, 0.0, -0.0, -1e-300, -1.0):
        gain = float(one_way_gain(cosine, math.radians(70)))
        assert 0 <= gain <= 1
        assert gain == 0 or cosine > 0


def test_eigenvalues_two_hundred_decibels_apart() -> None:
    """Diagonal by a known rotation: strong, weak and none; entropy and its p ln p at zero."""
    turn = np.linalg.qr(
        np.random.default_rng(3).normal(size=(3, 3)) + 1j * np.random.default_rng(4).normal(size=(3, 3))
    )[0]
    for values in ((1.0, 1.0, 1.0), (1.0, 1e-10, 0.0), (1.0, 1e-10, 1e-20), (1e10, 1.0, 1e-10), (1e-300, 1e-301, 0.0)):
        matrix = (turn * np.array(values)) @ turn.conj().T
        found, vectors = hermitian_eigen_of(matrix[None])
        assert np.abs(np.sort(found[0])[::-1] - values).max() <= 16 * EPS * max(values)
        assert np.abs(vectors[0].conj().T @ vectors[0] - np.eye(3)).max() < 16 * EPS
    assert float(entropy_of([1.0, 1.0, 1.0])) == pytest.approx(1, abs=4 * EPS)
    assert float(entropy_of([1.0, 0.0, 0.0])) == 0
    assert math.isnan(float(entropy_of([0.0, 0.0, 0.0])))
    p = Decimal("1e-20") / (1 + Decimal("1e-20"))
    true = -(p * p.ln() + (1 - p) * (1 - p).ln()) / Decimal(3).ln()
    assert relative(float(entropy_of([1.0, 1e-20, 0.0])), true) < 0.03  # ln(1 - p) of float64: 1 / -ln(p) of it is lost


def test_matrices_without_power_or_with_one_scatterer_have_no_anisotropy() -> None:
    planes = np.zeros((9, 1, 3))
    planes[0, 0, 1] = 1.0  # a single mechanism
    planes[[0, 5, 8], 0, 2] = 1e-200  # noise-like, far below any unit
    made = h_a_alpha(planes)
    assert np.isnan(made[:, 0, 0]).all()
    assert made[0, 0, 1] == 0
    assert made[0, 0, 2] == pytest.approx(1, abs=1e-12)


def test_a_strong_pixel_leaves_no_trace_beside_its_window() -> None:
    """200 dB: running sums would leave 1e20 * eps, 43 dB above the neighbours."""
    planes = np.zeros((9, 5, 40))
    planes[[0, 5, 8]] = 1.0
    planes[:, 2, 10] *= 1e20
    made = window_average(planes, 5)
    np.testing.assert_allclose(made[[0, 5, 8], :, 13:], 1.0, rtol=1e-12)


def profiles_of(target: np.ndarray, antenna: np.ndarray, centre_hz: float, bandwidth_hz: float) -> RangeProfiles:
    """A point's exact profiles at eight bins a cell, phases counted in whole turns first."""
    cell = SPEED_OF_LIGHT_M_S / (2 * bandwidth_hz)
    away = np.linalg.norm(target - antenna, axis=1)
    first = float(away.min()) - 24 * cell
    range_m = first + cell / 8 * np.arange(round((float(away.max()) + 24 * cell - first) / (cell / 8)))
    envelope = np.sinc((range_m - away[:, None]) / cell)
    turns = 2 * away * centre_hz / SPEED_OF_LIGHT_M_S
    values = envelope * np.exp(-2j * np.pi * (turns - np.rint(turns)))[:, None]
    return RangeProfiles(
        values[None], range_m, antenna, ("HH",), centre_hz, bandwidth_hz, "rectangular", range_compensated=True
    )


@pytest.mark.parametrize("bandwidth_hz", [1e3, 80e6, 10e9])
@pytest.mark.parametrize("away_m", [0.1, 10.0, 1e3, 1e6])
@pytest.mark.parametrize("positions", [1, 33])
def test_focus_at_any_range_bandwidth_and_aperture(bandwidth_hz: float, away_m: float, positions: int) -> None:
    """The kernel's arithmetic against plain float64 on the same profiles: -100 dB whatever the range."""
    centre_hz = 20e9 if bandwidth_hz > 1e9 else 2.4e9
    length = min(0.3 * away_m, 50.0)
    x = np.linspace(-length / 2, length / 2, positions) if positions > 1 else np.zeros(1)
    antenna = np.column_stack([x, np.zeros((positions, 2))])
    target = np.array([0.0, away_m, 0.0])
    profiles = profiles_of(target, antenna, centre_hz, bandwidth_hz)
    step = SPEED_OF_LIGHT_M_S / centre_hz / 4
    grid = ImageGrid(np.arange(-4, 5) * step, away_m + np.arange(-4, 5) * min(step, away_m / 40), 0.0)
    image = backproject(profiles, grid)[0]
    reference = backproject_reference(profiles, grid)[0]
    assert np.isfinite(reference).all()
    error = np.linalg.norm(image - reference) / np.linalg.norm(reference)
    assert 20 * math.log10(error + 1e-300) < -100


def test_resolution_of_any_bandwidth_and_aperture() -> None:
    """Finite or infinite, never NaN or a warning; the small-angle form where it holds, to 1 %."""
    for bandwidth in (1e3, 80e6, 1e9):
        for away in (1.0, 1e3, 1e6):
            for length in (0.0, 1e-3 * away, 0.2 * away):
                x = np.linspace(-length / 2, length / 2, 65) if length else np.zeros(1)
                antenna = np.column_stack([x, np.zeros((len(x), 2))])
                try:
                    found = point_resolution(antenna, (0.0, away, 0.0), centre_hz=2.4e9, bandwidth_hz=bandwidth)
                except DataError:
                    continue
                assert not math.isnan(found.x_m)
                assert found.slant_m > 0
                if length == 1e-3 * away:
                    # -3 dB of a sinc is 0.8859 of the cell R lambda / 2L; 65 positions fill 65 steps, not 64; and a
                    # band of 42 % weighs its short waves more: 0.4 %.
                    wavelength = SPEED_OF_LIGHT_M_S / 2.4e9
                    assert found.x_m == pytest.approx(0.8859 * wavelength * away / (2 * length * 65 / 64), rel=0.005)
