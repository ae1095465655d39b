"""Sphere, cylinder and disc; the radar equation; the beam of a can: against published closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar

from processing.calibration import canonical as ca
from processing.calibration import radar_equation as eq
from processing.calibration.rcs import plate_amplitude, sphere_rcs
from processing.errors import DataError
from processing.radar.waveguide_antenna import TM01, circular_waveguide_pattern, pattern_difference_db
from processing.scene.model import Reflector
from processing.scene.radar_response import reflector_scattering

WAVELENGTH = 0.125


def radius(size: float) -> float:
    """Radius of k r = size."""
    return size * WAVELENGTH / (2 * np.pi)


def test_sphere_from_rayleigh_to_optics() -> None:
    # Ruck et al. 3.2: 9 (k r)^4 pi r^2 for small spheres (next term of order (k r)^2), its first maximum 3.655 pi r^2
    # at k r = 1.03, pi r^2 in the limit: relative error 1 / (2 k r)^2, once creeping waves, which fall as
    # exp(-2.2 (k r)^(1/3)), have died out.
    small = 0.01
    assert ca.sphere_mie_rcs(radius(small), WAVELENGTH) == pytest.approx(
        9 * small**4 * sphere_rcs(radius(small)), rel=2 * small**2
    )
    best = minimize_scalar(
        lambda size: -ca.sphere_mie_rcs(radius(size), WAVELENGTH) / sphere_rcs(radius(size)), bounds=(0.8, 1.3)
    )
    assert best.x == pytest.approx(1.03, abs=0.01)
    assert -best.fun == pytest.approx(3.655, abs=0.005)
    assert ca.sphere_mie_rcs(radius(800), WAVELENGTH) == pytest.approx(sphere_rcs(radius(800)), rel=1e-6)


def test_phase_of_a_large_sphere_is_that_of_its_front() -> None:
    # A specular point at distance R - r, positive as a plate's; Luneberg-Kline: the next term is 1 / (2 k r) rad.
    size = 200.0
    front = ca.sphere_amplitude(radius(size), WAVELENGTH) * np.exp(-2j * size)
    assert np.angle(front) == pytest.approx(0, abs=1 / size)
    assert abs(front) == pytest.approx(np.sqrt(np.pi) * radius(size), rel=1e-3)


@given(st.floats(1e-3, 300.0))
@settings(max_examples=30, deadline=None)
def test_sphere_is_finite_at_every_size(size: float) -> None:
    ratio = ca.sphere_mie_rcs(radius(size), WAVELENGTH) / sphere_rcs(radius(size))
    assert 0 < ratio < 3.66


def test_cylinder_by_modes_from_thin_to_thick() -> None:
    # Balanis, Advanced Engineering Electromagnetics, chapter 11, for k r -> 0: along the axis
    # sigma_2D = pi lambda / 2 / ln^2(0.8905 k r), across it 9 pi lambda (k r)^4 / 8; sigma = 2 L^2 / lambda sigma_2D.
    length, size = 2.0, 1e-3
    s = ca.cylinder_scattering(radius(size), length, WAVELENGTH)
    per_2d = 2 * length**2 / WAVELENGTH
    # J0 / (J0 - j Y0) with Y0 = 2 / pi ln(0.8905 k r) large, not infinite: 1 / (1 + (pi / 2 / ln)^2).
    log = np.log(0.8905 * size)
    thin = np.pi * WAVELENGTH / 2 / log**2 / (1 + (np.pi / 2 / log) ** 2)
    assert abs(s[0, 0]) ** 2 == pytest.approx(per_2d * thin, rel=1e-3)
    assert abs(s[1, 1]) ** 2 == pytest.approx(per_2d * 9 * np.pi * WAVELENGTH * size**4 / 8, rel=1e-3)
    # Thick: thesis Table 2.5 for both polarizations, 2 pi r L^2 / lambda.
    thick = ca.cylinder_scattering(radius(2000), length, WAVELENGTH)
    np.testing.assert_allclose(
        np.abs(np.diag(thick)) ** 2, 2 * np.pi * radius(2000) * length**2 / WAVELENGTH, rtol=1e-4
    )
    assert np.abs(thick[0, 1]) < 1e-6 * abs(thick[0, 0])
    # Positive as a plate's, its front nearer by the radius.
    assert np.angle(thick[0, 0] * np.exp(-4000j)) == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("tilt", [0.0, 0.05, -0.3])
def test_tilted_cylinder_of_modes_is_physical_optics_when_thick(tilt: float) -> None:
    modes = ca.cylinder_scattering(radius(3000), 0.3, WAVELENGTH, 0.0, tilt)
    optics = ca.cylinder_rcs(radius(3000), 0.3, WAVELENGTH, tilt)
    np.testing.assert_allclose(np.abs(np.diag(modes)) ** 2, optics, rtol=1e-4)


@given(st.floats(-np.pi, np.pi), st.floats(0.01, 20.0))
def test_cylinder_turns_with_its_axis(orientation: float, size: float) -> None:
    # S in a basis turned by the orientation is diagonal; span stays.
    level = ca.cylinder_scattering(radius(size), 1.0, WAVELENGTH)
    turned = ca.cylinder_scattering(radius(size), 1.0, WAVELENGTH, orientation)
    c, s = np.cos(orientation), np.sin(orientation)
    rotation = np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(rotation @ turned @ rotation.T, level, atol=1e-12)
    np.testing.assert_array_equal(turned, turned.T)


def test_disc() -> None:
    # 4 pi A^2 / lambda^2 on the normal; first null of 2 J1(x) / x at x = 3.8317; a square of the same area has the same
    # maximum.
    r = 0.4
    area = np.pi * r**2
    assert ca.disc_amplitude(r, 0.0, WAVELENGTH) == pytest.approx(np.sqrt(4 * np.pi) * area / WAVELENGTH)
    null = np.arcsin(3.8317059702 * WAVELENGTH / (4 * np.pi * r))
    assert ca.disc_amplitude(r, null, WAVELENGTH) == pytest.approx(0, abs=1e-9)
    side = np.sqrt(area)
    assert ca.disc_amplitude(r, 0.0, WAVELENGTH) == pytest.approx(float(plate_amplitude(side, side, 0, 0, WAVELENGTH)))
    assert ca.disc_amplitude(r, 2.0, WAVELENGTH) == 0
    # At grazing cos(90 degrees) is 6e-17.
    assert ca.disc_amplitude(r, np.pi / 2, WAVELENGTH) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf")])
def test_sizes_of_round_targets_must_be_positive(wrong: float) -> None:
    for call in (
        lambda: ca.sphere_amplitude(wrong, WAVELENGTH),
        lambda: ca.cylinder_rcs(0.1, wrong, WAVELENGTH),
        lambda: ca.cylinder_scattering(wrong, 1.0, WAVELENGTH),
        lambda: ca.disc_amplitude(wrong, 0.0, WAVELENGTH),
    ):
        with pytest.raises(DataError, match="positive"):
            call()


def test_what_the_series_cannot_do_is_refused() -> None:
    with pytest.raises(DataError, match="beyond the Mie series"):
        ca.sphere_amplitude(1e6, WAVELENGTH)
    with pytest.raises(DataError, match="along the cylinder's axis"):
        ca.cylinder_scattering(0.1, 1.0, WAVELENGTH, 0.0, np.pi / 2)


def test_sphere_in_a_scene_looks_alike_from_everywhere() -> None:
    ball = Reflector("ball", "sphere", (0.0, 8.0, -1.0), 0.3)
    s = reflector_scattering(ball, np.array([[-1.0, 0, 0], [2.0, 0, 0.5]]), WAVELENGTH)
    np.testing.assert_allclose(s, ca.sphere_amplitude(0.15, WAVELENGTH) * np.broadcast_to(np.eye(2), (2, 2, 2)))


RADAR = {"transmit_w": 1.0, "aperture_m2": 0.0078, "wavelength_m": WAVELENGTH, "loss": 2.0}


def test_radar_equation() -> None:
    # Thesis 5.8 by hand: 1 W, 78 cm^2, 12.5 cm, loss 2, 1000 m^2 at 3.66 m.
    by_hand = 1.0 * 0.0078**2 * 1000 / (4 * np.pi * WAVELENGTH**2 * 2 * 3.66**4)
    assert eq.received_power(1000.0, 3.66, **RADAR) == pytest.approx(by_hand, rel=1e-12)


@given(st.floats(1e-6, 1e6), st.floats(0.1, 1e4))
def test_rcs_from_power_is_the_inverse(rcs: float, range_m: float) -> None:
    power = eq.received_power(rcs, range_m, **RADAR)
    assert eq.rcs_from_power(power, range_m, **RADAR) == pytest.approx(rcs, rel=1e-12)
    # A compensated echo does not tell its range.
    flat = power * eq.range_compensation(range_m, "point", 3.0)
    assert flat == pytest.approx(float(eq.received_power(rcs, 3.0, **RADAR)), rel=1e-12)


def test_clutter_falls_with_the_third_power_of_range() -> None:
    # Ground of sigma0 in a cell lambda R / 2 L wide: RCS grows as R, echoes fall as R^3.
    range_m = np.array([2.0, 4.0, 20.0])
    echoes = eq.received_power(0.01 * range_m, range_m, **RADAR)
    np.testing.assert_allclose(np.ptp(echoes * eq.range_compensation(range_m, "clutter")) / echoes[0], 0, atol=1e-12)


def test_noise_and_its_equivalents() -> None:
    # k T B at 290 K: -204 dBW/Hz, the figure of every handbook.
    assert 10 * np.log10(eq.noise_power(1.0)) == pytest.approx(-203.975, abs=1e-3)
    assert eq.noise_power(1e3, 3.0) / eq.noise_power(1.0) == pytest.approx(1e3 * 10**0.3)
    # 1 m^2 in a cell of 1.5 by 0.5 m at grazing: -10 log10(0.75); at 60 degrees depression the cell is twice as long.
    level = eq.noise_equivalent_sigma0_db(1.0, 1000.0, 0.0, 1.5, 0.5)
    assert level == pytest.approx(-10 * np.log10(0.75))
    steep = eq.noise_equivalent_sigma0_db(1.0, 1000.0, 1000.0 * np.sin(np.pi / 3), 1.5, 0.5)
    assert steep == pytest.approx(level - 10 * np.log10(2))
    assert np.isnan(eq.noise_equivalent_sigma0_db(1.0, 0.5, 1.0, 1.5, 0.5))


def test_radar_equation_at_its_ends() -> None:
    with pytest.raises(DataError, match="range"):
        eq.received_power(1.0, 0.0, **RADAR)
    with pytest.raises(DataError, match="range"):
        eq.rcs_from_power(1.0, np.array([1.0, np.nan]), **RADAR)
    with pytest.raises(DataError, match="transmit_w"):
        eq.received_power(1.0, 1.0, **{**RADAR, "transmit_w": 0.0})
    with pytest.raises(DataError, match="no compensation"):
        eq.range_compensation(1.0, "sea")  # type: ignore[arg-type]
    with pytest.raises(DataError, match="negative"):
        eq.range_compensation(-1.0)
    assert eq.range_compensation(0.0) == 0
    with pytest.raises(DataError, match="bandwidth_hz"):
        eq.noise_power(0.0)


def half_power_deg(diameter: float, plane: float) -> float:
    def level(angle: float) -> float:
        return float(circular_waveguide_pattern(angle, plane, diameter, WAVELENGTH)) ** 2 - 0.5

    return 2 * float(np.degrees(brentq(level, 1e-3, 1.5)))


def test_beam_of_a_can() -> None:
    # Balanis, Antenna Theory, Table 12.2: half-power beams of a TE11 aperture 29.2 lambda / a (E-plane) and
    # 37.0 lambda / a (H-plane) degrees for wide ones; 8 wavelengths: the small-angle figures have 1 % left.
    diameter = 8 * WAVELENGTH
    assert half_power_deg(diameter, 0.0) == pytest.approx(29.2 / 4, rel=0.02)
    assert half_power_deg(diameter, np.pi / 2) == pytest.approx(37.0 / 4, rel=0.02)
    # The thesis's can (9.94 cm, 5.2) is said to have 70 degrees; the aperture's planes give 68 and 81.
    assert half_power_deg(0.0994, 0.0) == pytest.approx(68.3, abs=0.1)
    assert half_power_deg(0.0994, np.pi / 2) == pytest.approx(81.4, abs=0.1)
    # And it lets TM01 through, which thesis 5.3 forbids: cut-off at 2.405 / k.
    assert np.pi * 0.0994 / WAVELENGTH > TM01


def test_beam_of_a_can_is_smooth_and_ends_at_90_degrees() -> None:
    wide = 8 * WAVELENGTH
    # Across the zero of the H-plane's denominator, x = 1.841.
    zero = np.arcsin(1.841183781340659 * WAVELENGTH / (np.pi * wide))
    angles = zero + np.array([-1e-6, 0.0, 1e-6])
    values = circular_waveguide_pattern(angles, np.pi / 2, wide, WAVELENGTH)
    np.testing.assert_allclose(values, values[1], rtol=1e-4)
    assert circular_waveguide_pattern(0.0, 0.3, wide, WAVELENGTH) == pytest.approx(1)
    assert circular_waveguide_pattern(2.0, 0.3, wide, WAVELENGTH) == 0
    # cos^n with the stated beamwidth meets the can's pattern at its half-power angle, by definition.
    half = np.radians(half_power_deg(0.0994, 0.0)) / 2
    assert pattern_difference_db(half, 0.0, 0.0994, WAVELENGTH, 2 * half) == pytest.approx(0, abs=1e-9)
    with pytest.raises(DataError, match="no wave"):
        circular_waveguide_pattern(0.0, 0.0, 0.05, WAVELENGTH)
    with pytest.raises(DataError, match="positive"):
        circular_waveguide_pattern(0.0, 0.0, -0.1, WAVELENGTH)
