"""Calibration targets against closed forms, the thesis's figures and brute-force apertures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.calibration import rcs
from processing.errors import DataError

FOUR_FEET, WAVELENGTH = 4 * 0.3048, 0.125


def deg(value: float) -> float:
    return float(np.radians(value))


def test_thesis_figures_of_trihedral_and_dihedral() -> None:
    # Thesis 5.5: 30.78 dBsm at azimuth 40, elevation 17, edge 4 ft, 12.5 cm; 5.10: 35.5 dBsm. More digits from the
    # closed forms evaluated by hand in equations 5.5 and 5.10.
    trihedral = rcs.to_dbsm(rcs.square_trihedral_rcs(FOUR_FEET, WAVELENGTH, deg(40), deg(17)))
    assert trihedral == pytest.approx(30.784, abs=5e-4)
    assert round(float(trihedral), 2) == 30.78
    dihedral = rcs.to_dbsm(rcs.dihedral_rcs(FOUR_FEET, FOUR_FEET, WAVELENGTH))
    assert dihedral == pytest.approx(35.507, abs=5e-4)


@pytest.mark.parametrize(
    ("found", "formula"),
    [
        # Thesis Table 2.5 and 5.4, as functions of edge and wavelength.
        (rcs.plate_rcs(2.0, 0.7, 0.1), 4 * np.pi * 2.0**2 * 0.7**2 / 0.1**2),
        (rcs.dihedral_rcs(2.0, 0.7, 0.1), 8 * np.pi * 2.0**2 * 0.7**2 / 0.1**2),
        (rcs.square_trihedral_rcs(0.7, 0.1), 12 * np.pi * 0.7**4 / 0.1**2),
        (rcs.triangular_trihedral_rcs(0.7, 0.1), 4 * np.pi * 0.7**4 / (3 * 0.1**2)),
        (rcs.sphere_rcs(0.3), np.pi * 0.3**2),
    ],
)
def test_maxima(found: float, formula: float) -> None:
    assert found == pytest.approx(formula, rel=1e-12)


def test_doubling_the_edge_gives_sixteen_times_the_rcs() -> None:
    # Thesis 2.3: a^4.
    ratio = rcs.square_trihedral_rcs(1.0, 0.1, 0.6, 0.4) / rcs.square_trihedral_rcs(0.5, 0.1, 0.6, 0.4)
    assert ratio == pytest.approx(16, rel=1e-12)


def brute_force_aperture(azimuth: float, elevation: float, triangular: bool, n: int = 1001) -> float:
    """Aperture of a unit trihedral: rays that hit a face and whose mirror image through the apex hits one too."""
    v = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    e1 = np.cross([0, 0, 1.0], v)
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(v, e1)
    axis = np.linspace(-1.5, 1.5, n)
    a, b = np.meshgrid(axis, axis)

    def hits(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        start = a[..., None] * e1 + b[..., None] * e2
        t = -start / v
        face = np.argmax(t, axis=-1)
        point = start + np.take_along_axis(t, face[..., None], -1) * v
        found = np.zeros(a.shape, dtype=bool)
        for k in range(3):
            p, q = (point[..., i] for i in range(3) if i != k)
            inside = (p >= 0) & (q >= 0) & ((p + q <= 1) if triangular else ((p <= 1) & (q <= 1)))
            found |= (face == k) & inside
        return found

    return float((hits(a, b) & hits(-a, -b)).mean() * 9.0)


@pytest.mark.parametrize("angles", [(40, 17), (45, 35.264), (10, 30), (30, 60), (45, 5)])
@pytest.mark.parametrize("triangular", [False, True])
def test_trihedral_aperture_is_what_rays_find(angles: tuple[float, float], triangular: bool) -> None:
    azimuth, elevation = (deg(angle) for angle in angles)
    amplitude = rcs.triangular_trihedral_amplitude if triangular else rcs.square_trihedral_amplitude
    # S = sqrt(4 pi) A / lambda, so with lambda = sqrt(4 pi) the amplitude is the aperture.
    found = float(amplitude(1.0, azimuth, elevation, np.sqrt(4 * np.pi)))
    expected = brute_force_aperture(azimuth, elevation, triangular)
    # A grid of step h misjudges at most the cells on the outline: about outline * h * 0.5, here below 0.01.
    assert found == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("tilt_deg", [0, 5, 20, 40, 44, 50])
def test_dihedral_aperture_across_the_fold_is_what_rays_find(tilt_deg: float) -> None:
    # Two unit faces along +45 and -45 degrees, fold at the origin: offsets s across the direction of incidence that
    # hit a face, and whose mirror image -s does too.
    tilt = deg(tilt_deg)
    s = np.linspace(-1.5, 1.5, 200_001)
    across = np.array([np.cos(tilt), -np.sin(tilt)])
    reach = [float(np.array([np.sin(a), np.cos(a)]) @ across) for a in (np.pi / 4, -np.pi / 4)]
    hit = ((s >= 0) & (s <= max(reach[0], 0))) | ((s <= 0) & (s >= min(reach[1], 0)))
    width = float((hit & hit[::-1]).mean() * 3.0)
    # With the fold along z, the direction tilts in azimuth; unit fold length, lambda = sqrt(4 pi).
    found = float(rcs.dihedral_amplitude(1.0, 1.0, tilt, 0.0, np.sqrt(4 * np.pi), np.pi / 2))
    assert found == pytest.approx(width, abs=5e-5)


def test_plate_pattern_is_the_physical_optics_integral() -> None:
    # |integral of exp(2 j k r . direction)| over the plate, by the midpoint rule.
    width, height, wavelength, azimuth, elevation = 0.8, 0.5, 0.125, deg(7), deg(-4)
    k = 2 * np.pi / wavelength
    u, v = np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    n = 4000
    x, y = ((np.arange(n) + 0.5) / n - 0.5) * width, ((np.arange(n) + 0.5) / n - 0.5) * height
    integral = np.mean(np.exp(2j * k * u * x)) * np.mean(np.exp(2j * k * v * y)) * width * height
    expected = np.sqrt(4 * np.pi) / wavelength * np.cos(elevation) * np.cos(azimuth) * integral.real
    # The midpoint rule's error is below (2 k u width / n)^2 / 24.
    assert rcs.plate_amplitude(width, height, azimuth, elevation, wavelength) == pytest.approx(expected, rel=1e-5)


@given(st.floats(0.01, 1.55), st.floats(0.01, 1.55))
def test_trihedral_is_the_same_for_any_order_of_its_faces(azimuth: float, elevation: float) -> None:
    x, y, z = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    turned = rcs.square_trihedral_amplitude(1.0, np.arctan2(z, y), np.arcsin(x), 0.1)
    assert turned == pytest.approx(rcs.square_trihedral_amplitude(1.0, azimuth, elevation, 0.1), rel=1e-9)


@pytest.mark.parametrize("amplitude", [rcs.square_trihedral_amplitude, rcs.triangular_trihedral_amplitude])
def test_trihedral_branches_meet(amplitude) -> None:
    azimuth = np.linspace(0.001, np.pi / 2 - 0.001, 4001)
    values = amplitude(1.0, azimuth, 0.3, 0.1)
    # Continuous: steps between neighbours stay as small as a slope of at most 4 a^2 sqrt(4 pi) / lambda allows.
    assert np.abs(np.diff(values)).max() < 4 * np.sqrt(4 * np.pi) / 0.1 * (azimuth[1] - azimuth[0])


@pytest.mark.parametrize("angles", [(-1, 30), (91, 30), (45, -1), (45, 91), (0, 30)])
def test_trihedral_returns_nothing_outside_its_octant(angles: tuple[float, float]) -> None:
    assert rcs.square_trihedral_rcs(1.0, 0.1, deg(angles[0]), deg(angles[1])) == pytest.approx(0, abs=1e-20)


def test_angle_errors_of_the_thesis() -> None:
    # Thesis 5.16 and 5.17 with 5 degrees on both angles: 180.2 and 683.9 m^2, 2.56 dB in quadrature, 3.13 dB summed
    # (evaluated independently from the closed form's derivatives).
    error = rcs.trihedral_angle_error(FOUR_FEET, WAVELENGTH, deg(40), deg(17), deg(5), deg(5))
    assert error.from_azimuth_m2 == pytest.approx(180.2, abs=0.05)
    assert error.from_elevation_m2 == pytest.approx(683.9, abs=0.05)
    assert error.quadrature_db == pytest.approx(2.56, abs=0.005)
    assert error.sum_db == pytest.approx(3.13, abs=0.005)
    with pytest.raises(DataError, match="returns nothing"):
        rcs.trihedral_angle_error(FOUR_FEET, WAVELENGTH, deg(100), deg(17), deg(5), deg(5))


def test_accuracy_both_ways() -> None:
    # Thesis 5.13: 31.05 / 35.5 = 87.46 %; the powers differ by -4.45 dB, a ratio of 35.9 %.
    compared = rcs.accuracy(31.05, 35.5)
    assert compared.thesis_accuracy_percent == pytest.approx(87.46, abs=0.005)
    assert compared.error_db == pytest.approx(-4.45, abs=1e-12)
    assert compared.power_ratio_percent == pytest.approx(35.9, abs=0.05)
    assert np.isnan(rcs.accuracy(1.0, 0.0).thesis_accuracy_percent)


def test_decibels_and_far_field() -> None:
    assert rcs.to_dbsm(0.0) == -np.inf
    assert np.isnan(rcs.to_dbsm(-1.0))
    assert rcs.from_dbsm(rcs.to_dbsm(3.7)) == pytest.approx(3.7, rel=1e-12)
    # 2 D^2 / lambda: 23.8 m for 4 ft at 12.5 cm.
    assert rcs.far_field_m(FOUR_FEET, WAVELENGTH) == pytest.approx(23.8, abs=0.05)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_sizes_must_be_positive(wrong: float) -> None:
    with pytest.raises(DataError, match="positive"):
        rcs.sphere_rcs(wrong)
    with pytest.raises(DataError, match="positive"):
        rcs.square_trihedral_rcs(wrong, 0.1)
    with pytest.raises(DataError, match="positive"):
        rcs.plate_rcs(1.0, 1.0, wrong)


@pytest.mark.parametrize("angles", [(float("nan"), 0.5), (0.5, float("nan")), (float("nan"), -0.5)])
def test_undefined_angles_give_undefined_rcs(angles: tuple[float, float]) -> None:
    assert np.isnan(rcs.square_trihedral_rcs(1.0, 0.1, *angles))
    assert np.isnan(rcs.triangular_trihedral_rcs(1.0, 0.1, *angles))
    assert np.isnan(rcs.plate_rcs(1.0, 1.0, 0.1, *angles))
    assert np.isnan(rcs.dihedral_rcs(1.0, 1.0, 0.1, *angles))


@pytest.mark.parametrize("azimuth", [0, 45, 90, 180, -90])
@pytest.mark.parametrize("elevation", [0, 45, 90, -90])
def test_angles_on_the_edges_are_defined(azimuth: float, elevation: float) -> None:
    a, e = deg(azimuth), deg(elevation)
    largest = 12 * np.pi / 0.1**2
    # Edge-on a corner has no triple bounce; cosines that are zero to 6e-17 only leave parts in 1e30.
    for found in (rcs.square_trihedral_rcs(1.0, 0.1, a, e), rcs.triangular_trihedral_rcs(1.0, 0.1, a, e)):
        inside = (azimuth, elevation) == (45, 45)
        assert (found > 0.1 * largest / 9) if inside else found == pytest.approx(0, abs=1e-20)
    ahead = (azimuth, elevation) == (0, 0)
    assert rcs.plate_rcs(1.0, 1.0, 0.1, a, e) == pytest.approx(4 * np.pi / 0.1**2 if ahead else 0, abs=10)
    for fold in (0, 45, 90):
        double = rcs.dihedral_rcs(1.0, 1.0, 0.1, a, e, deg(fold))
        assert 0 <= double <= 8 * np.pi / 0.1**2 * (1 + 1e-12)
