"""Reflection and backscatter of radar surfaces; rough ground as points; permittivities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from processing.errors import DataError
from processing.raytrace import shapes
from processing.scattering.permittivity import permittivity
from processing.scattering.rough import rough_points, visible
from processing.scattering.surfaces import (
    CONDUCTOR,
    RadarSurface,
    reflection,
    reflection_kernel,
    rough_backscatter,
    table,
)
from processing.scattering.target import radar_target

WAVELENGTH_M = 0.02


@settings(max_examples=50, deadline=None)
@given(
    real=st.floats(1.0, 80.0),
    loss=st.floats(0.0, 40.0),
    rough=st.floats(0.0, 0.005),
    cosine=st.floats(0.0, 1.0),
)
def test_the_kernel_reflects_as_the_definition(real: float, loss: float, rough: float, cosine: float) -> None:
    surface = RadarSurface(complex(real, -loss), rough)
    told = reflection_kernel(table([surface], WAVELENGTH_M)[0], cosine)
    np.testing.assert_allclose(told, [complex(r) for r in reflection(surface, cosine, WAVELENGTH_M)], atol=1e-12)


def test_reflection_by_hand() -> None:
    # Upright off e' = 4: (1 - 2) / (1 + 2); Brewster's angle atan 2 has no p; a lossy medium lags with exp(+j w t).
    s, p = reflection(RadarSurface(4 + 0j), 1.0, WAVELENGTH_M)
    assert complex(s) == pytest.approx(-1 / 3)
    assert complex(p) == pytest.approx(1 / 3)
    assert abs(complex(reflection(RadarSurface(4 + 0j), math.cos(math.atan(2)), WAVELENGTH_M)[1])) < 1e-12
    n = np.sqrt(4 - 3j)
    assert complex(reflection(RadarSurface(4 - 3j), 1.0, WAVELENGTH_M)[0]) == pytest.approx((1 - n) / (1 + n))
    assert [complex(r) for r in reflection(CONDUCTOR, 0.3, WAVELENGTH_M)] == [-1, 1]


def test_roughness_weakens_by_rayleighs_factor() -> None:
    # Ament: exp(-2 (k s cos t)^2) of the amplitude; k s cos t = 0.5 here.
    k = 2 * np.pi / WAVELENGTH_M
    rough = RadarSurface(None, 1.0 / k)
    assert complex(reflection(rough, 0.5, WAVELENGTH_M)[0]).real == pytest.approx(-math.exp(-0.5))


def test_backscatter_has_ohs_limits() -> None:
    """Very rough: hh = vv and hv = 0.23 sqrt(G0) vv; smooth: none. Upright, no polarization is favoured."""
    very = rough_backscatter(RadarSurface(9 + 0j, 0.1), 0.7, WAVELENGTH_M)
    assert very.hh == pytest.approx(very.vv, rel=1e-6)
    # G0 of e' = 9: ((3 - 1) / (3 + 1))^2 = 1/4.
    assert very.hv == pytest.approx(0.23 * 0.5 * very.vv, rel=1e-6)
    s, p = (abs(complex(r)) ** 2 for r in reflection(RadarSurface(9 + 0j), math.cos(0.7), WAVELENGTH_M))
    assert very.vv == pytest.approx(0.7 * math.cos(0.7) ** 3 * (s + p), rel=1e-6)
    assert float(rough_backscatter(RadarSurface(9 + 0j), 0.7, WAVELENGTH_M).vv) == 0
    upright = rough_backscatter(RadarSurface(9 + 0j, 0.001), 0.0, WAVELENGTH_M)
    assert upright.hh == pytest.approx(upright.vv)


def test_permittivities_of_the_recommendation() -> None:
    # P.2040-1: concrete at 10 GHz has 0.0326 10^0.8095 S/m.
    conductivity = 0.0326 * 10**0.8095
    assert permittivity("concrete", 10e9) == pytest.approx(5.31 - 17.98j * conductivity / 10)
    with pytest.raises(DataError):
        permittivity("cheese", 1e9)
    with pytest.raises(DataError):
        permittivity("glass", 1e12)


def test_rough_points_have_the_grounds_powers() -> None:
    surface = RadarSurface(11 - 3j, 0.005)
    target = radar_target(shapes.plate(20.0), [surface], WAVELENGTH_M)
    points = rough_points(target, [surface], (0, -500, 500), 100, seed=3)
    power = np.sum(np.abs(points.amplitudes) ** 2, axis=0) / 400
    told = rough_backscatter(surface, math.pi / 4, WAVELENGTH_M)
    # 40 000 exponentially distributed powers: 0.5 %; the incidence changes by 1 degree over the plate.
    np.testing.assert_allclose(power, [[told.hh, told.hv], [told.hv, told.vv]], rtol=0.04)
    # Freeman and Durden: HH and VV keep step but for the volume's part, of which 1/3.
    a = points.amplitudes
    together = abs(np.mean(a[:, 0, 0] * a[:, 1, 1].conj())) * len(a) / 400
    expected = math.sqrt((told.hh - 3 * told.hv) * (told.vv - 3 * told.hv)) + told.hv
    assert together == pytest.approx(float(expected), rel=0.05)


def test_points_of_a_tilted_plane_are_turned() -> None:
    """A roof that falls to the side has its own horizontal: HH there is in part cross-polarized for the radar."""
    surface = RadarSurface(80 + 0j, 0.0005)
    roof = shapes.plate(5.0).turned(shapes.turn_about((0, 1, 0), math.pi / 4))
    level = shapes.plate(5.0)
    cross = []
    for mesh in (roof, level):
        target = radar_target(mesh, [surface], WAVELENGTH_M)
        a = rough_points(target, [surface], (0, -100, 100), 400, seed=1).amplitudes
        cross.append(np.sum(np.abs(a[:, 0, 1]) ** 2) / np.sum(np.abs(a[:, 1, 1]) ** 2))
    assert cross[0] > 3 * cross[1]


def test_hidden_ground_does_not_scatter() -> None:
    screen = shapes.plate(4.0).moved((0, -2, 2))
    target = radar_target(screen, [CONDUCTOR], WAVELENGTH_M)
    antenna = np.array([0.0, -100.0, 100.0])
    assert visible(target, antenna, np.array([[0.0, 0, 0], [5.0, 0, 0]])).tolist() == [False, True]


@pytest.mark.parametrize("medium", [0.5 + 0j, 4 + 1j, complex("nan")])
def test_impossible_media_are_refused(medium: complex) -> None:
    with pytest.raises(DataError):
        RadarSurface(medium)


def test_impossible_roughness_is_refused() -> None:
    with pytest.raises(DataError):
        RadarSurface(None, -1.0)
    with pytest.raises(DataError):
        rough_backscatter(RadarSurface(4 + 0j, 0.001), 2.0, WAVELENGTH_M)
    surface = RadarSurface(4 + 0j, 0.001)
    target = radar_target(shapes.plate(1.0), [surface], WAVELENGTH_M)
    for density in (0.0, 1e9):
        with pytest.raises(DataError):
            rough_points(target, [surface], (0, -9, 9), density)
