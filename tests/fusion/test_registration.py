"""Ground pixels in the camera: projection, sampling, error budget, regions, features."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from processing.errors import DataError
from processing.fusion.features import fused_vector, normalized_components
from processing.fusion.regions import polygon_mask
from processing.fusion.registration import (
    GeometryErrors,
    ground_to_camera,
    registration_error,
    sample_bilinear,
)
from processing.optics.camera_model import Pinhole
from processing.polarimetry.pauli import pauli_vector

# Thesis rig: 8 mm lens, 8.3 um pixels, 782 x 582, 17 degrees down, 3.6576 m * sin 17 above the ground.
CAMERA = Pinhole(0.008, 8.3e-6, 782, 582, (0.0, 0.0, 0.0), float(np.radians(17)))
HEIGHT = 3.6576 * np.sin(np.radians(17))


def test_the_point_where_the_axis_meets_the_ground_is_the_middle_of_the_picture() -> None:
    y = HEIGHT / np.tan(np.radians(17))
    u, v = ground_to_camera(CAMERA, [0.0, 0.5], [y], -HEIGHT)
    assert u[0, 0] == pytest.approx(390.5)
    assert v[0, 0] == pytest.approx(290.5)
    # On the axis's own row, depth is the slant range: du/dx = f / R.
    assert u[0, 1] - u[0, 0] == pytest.approx(0.5 * 0.008 / 8.3e-6 / 3.6576)
    assert v[0, 1] == pytest.approx(290.5)


def test_what_is_behind_or_out_of_frame_is_undefined() -> None:
    u, v = ground_to_camera(CAMERA, [0.0, 40.0], [-3.0, 3.5], -HEIGHT)
    np.testing.assert_array_equal(np.isfinite(u), [[False, False], [True, False]])
    np.testing.assert_array_equal(np.isfinite(v), np.isfinite(u))


@given(st.floats(0, 8), st.floats(0, 5))
def test_bilinear_is_exact_for_a_bilinear_picture(u: float, v: float) -> None:
    rows, columns = np.mgrid[0:6, 0:9].astype(float)
    picture = 2 + 3 * columns - rows + 0.5 * rows * columns
    assert sample_bilinear(picture, u, v) == pytest.approx(2 + 3 * u - v + 0.5 * u * v, abs=1e-9)


def test_bilinear_outside_and_masked() -> None:
    picture = np.arange(12.0).reshape(3, 4)
    picture[1, 2] = np.nan
    u = np.array([-0.6, -0.5, 1.5, 1.0, 3.5, 3.6, np.nan, 2.0])
    v = np.array([0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 0.0, 0.5])
    # Whole pixels are exact; half weight on the NaN at (1, 2) is NaN; half a pixel beyond the border takes its value.
    np.testing.assert_array_equal(
        sample_bilinear(picture, u, v), [np.nan, 0.0, np.nan, 5.0, 11.0, np.nan, np.nan, np.nan]
    )
    with pytest.raises(DataError, match="shape"):
        sample_bilinear(np.zeros(3), 0.0, 0.0)


def monte_carlo(camera: Pinhole, x: float, y: float, z: float, errors: GeometryErrors, n: int) -> float:
    """Root mean square distance in pixels between where a pixel is looked up and where its content is."""
    random = np.random.default_rng(0)
    slant = np.hypot(y, z) + errors.range_m * random.normal(size=n)
    height = z + errors.height_m * random.normal(size=n)
    true = np.stack([x + errors.cross_range_m * random.normal(size=n), np.sqrt(slant**2 - height**2), height], axis=-1)
    u, v, _ = camera.project(true)
    u0, v0, _ = camera.project(np.array([x, y, z]))
    # The camera's own axes turned by small angles about the horizontal and vertical axes of its image.
    a, b = errors.angle_rad * random.normal(size=(2, n))
    local = np.stack([(u - 390.5), (v - 290.5), np.full(n, camera.focal_length_px)], axis=-1)
    up = np.stack(
        [
            local[:, 0],
            local[:, 1] * np.cos(a) - local[:, 2] * np.sin(a),
            local[:, 1] * np.sin(a) + local[:, 2] * np.cos(a),
        ],
        axis=-1,
    )
    both = np.stack(
        [up[:, 0] * np.cos(b) + up[:, 2] * np.sin(b), up[:, 1], -up[:, 0] * np.sin(b) + up[:, 2] * np.cos(b)], axis=-1
    )
    du = 390.5 + camera.focal_length_px * both[:, 0] / both[:, 2] - u0
    dv = 290.5 + camera.focal_length_px * both[:, 1] / both[:, 2] - v0
    return float(np.sqrt(np.mean(du**2 + dv**2)))


@pytest.mark.parametrize("place", [(0.0, 3.5), (0.8, 4.5), (-1.0, 9.0)])
@pytest.mark.parametrize(
    "errors",
    [
        GeometryErrors(0.02, 0.0, 0.0, 0.0),
        GeometryErrors(0.0, 0.03, 0.0, 0.0),
        GeometryErrors(0.0, 0.0, 0.004, 0.0),
        GeometryErrors(0.0, 0.0, 0.0, 0.01),
        GeometryErrors(0.02, 0.03, 0.004, 0.01),
    ],
)
def test_error_budget_is_what_a_monte_carlo_finds(place: tuple[float, float], errors: GeometryErrors) -> None:
    found = registration_error(CAMERA, [place[0]], [place[1]], -HEIGHT, errors).total[0, 0]
    # 20000 draws: relative sd of a rms is 1 / sqrt(2 n) = 0.5 %; second-order terms of these small errors below 1 %.
    assert found == pytest.approx(monte_carlo(CAMERA, *place, -HEIGHT, errors, 20_000), rel=0.03)


def test_error_is_undefined_behind_the_camera() -> None:
    errors = GeometryErrors(0.5, 0.1, 0.01, 0.1)
    total = registration_error(CAMERA, [0.0], [-5.0, 5.0], -HEIGHT, errors).total
    np.testing.assert_array_equal(np.isfinite(total[:, 0]), [False, True])


def test_polygons_agree_with_scikit_image() -> None:
    from skimage.measure import points_in_poly

    x, y = np.linspace(-3, 3, 61) + 0.013, np.linspace(2, 8, 41) + 0.017
    star = np.array([[-2.5, 3], [2.7, 3.4], [-1.0, 7.5], [0.2, 2.2], [1.5, 7.9]])
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    np.testing.assert_array_equal(polygon_mask(star, x, y).ravel(), points_in_poly(grid, star))
    with pytest.raises(DataError, match="three"):
        polygon_mask([[0, 0], [1, 1]], x, y)


def test_normalized_components() -> None:
    k = pauli_vector([1.0, 3.0, 0.0, np.nan], [0.0, 0.0, 0.0, 0.0], [-1.0, 3.0, 0.0, 1.0])
    found = normalized_components(k)
    np.testing.assert_allclose(found[:, :2], [[1, 0], [0, 0], [0, 1]], atol=1e-12)
    assert np.isnan(found[:, 2:]).all()
    # The scene's largest norm is |HH + VV| = 6.
    np.testing.assert_allclose(normalized_components(k, normalization="scene")[:, 0], [2 / 6, 0, 0])
    usable = normalized_components(k, usable=[False, True, True, True])
    assert np.isnan(usable[:, 0]).all()
    with pytest.raises(DataError, match="above the noise"):
        normalized_components(k, usable=[False] * 4)


def test_fused_vector_is_undefined_where_one_part_is() -> None:
    components = np.array([[1.0, 0.6, np.nan], [0.0, 0.0, 0.0], [0.0, 0.8, 1.0]])
    fused = fused_vector(components, [0.3, np.nan, 0.1])
    np.testing.assert_allclose(fused[:, 0], [1.0, 0.0, 0.0, 0.3])
    assert np.isnan(fused[:, 1:]).all()
    with pytest.raises(DataError, match="sample DOLP"):
        fused_vector(components, [0.3])
