"""Mean polarization of a region, and whether its error bars hold."""

import math

import numpy as np
import pytest

from processing.errors import DataError
from processing.optics.analyser import measurement_matrix
from processing.optics.regions import region_polarization
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image

STANDARD = tuple(np.radians([0.0, 45.0, 90.0, 135.0]))
TRUE = np.array([3000.0, 3000 * 0.08 * math.cos(1.0), 3000 * 0.08 * math.sin(1.0)])


def measured(
    seed: int,
    of: PolarizerSeries,
    *,
    turn: np.ndarray | float = 0.0,
    gain: np.ndarray | float = 1.0,
    ratio: float | None = None,
    shape: tuple[int, int] = (24, 25),
) -> tuple[np.ndarray, ...]:
    """S0, S1, S2 of a uniform patch, with the errors given."""
    random = np.random.default_rng(seed)
    rows = measurement_matrix(np.array(STANDARD) + turn, ratio or of.extinction_ratio)
    light = (rows @ TRUE) * gain
    counts = random.poisson(light[:, None, None], (4, *shape)) + random.normal(
        0, of.noise.read_noise_counts, (4, *shape)
    )
    image = stokes_image(np.rint(counts), np.zeros(shape, bool), of)
    return image.s0, image.s1, image.s2


def series(**known: float) -> PolarizerSeries:
    sd = known.pop("angle_sd", 0.0)
    return PolarizerSeries(
        STANDARD,
        (1,) * 4,
        (sd,) * 4,
        800.0,
        SensorNoise(5.0, 1.0),
        **{"extinction_relative_sd": 0.0, "intensity_stability": 0.0, **known},  # type: ignore[arg-type]
    )


def test_random_error_bars_hold() -> None:
    # 300 patches; the pulls have sd 1 to within 1 / sqrt(600) = 4 %: four of these.
    of = series()
    mask = np.ones((24, 25), bool)
    regions = [region_polarization(*measured(seed, of), mask, of) for seed in range(300)]
    pulls = [(region.dolp - 0.08) / region.dolp_sd for region in regions]
    assert np.std(pulls) == pytest.approx(1, abs=0.16)
    assert abs(np.mean(pulls)) < 4 / math.sqrt(300)
    aop_pulls = [(region.aop - 0.5) / region.aop_sd for region in regions]
    assert np.std(aop_pulls) == pytest.approx(1, abs=0.16)
    assert regions[0].dolp_systematic_sd == 0
    assert regions[0].pixels == 600


@pytest.mark.parametrize("cause", ["angles", "light", "extinction"])
def test_systematic_error_bars_hold(cause: str) -> None:
    random = np.random.default_rng(9)
    of = {
        "angles": series(angle_sd=0.02),
        "light": series(intensity_stability=0.02),
        "extinction": PolarizerSeries(
            STANDARD,
            (1,) * 4,
            (0.0,) * 4,
            10.0,
            SensorNoise(5.0, 1.0),
            extinction_relative_sd=0.1,
            intensity_stability=0.0,
        ),
    }[cause]
    mask = np.ones((24, 25), bool)
    pulls = []
    for seed in range(300):
        turn = random.normal(0, 0.02, 4) if cause == "angles" else 0.0
        gain = 1 + random.normal(0, 0.02, 4) if cause == "light" else 1.0
        ratio = max(10.0 * (1 + random.normal(0, 0.1)), 5.0) if cause == "extinction" else None
        region = region_polarization(*measured(seed, of, turn=turn, gain=gain, ratio=ratio), mask, of)
        pulls.append((region.dolp - 0.08) / region.dolp_sd)
        assert region.dolp_systematic_sd > 0
    # Pulls of mixed, slightly skewed errors (first order): sd 1 within 4 x 4 % and 5 % for the higher orders.
    assert np.std(pulls) == pytest.approx(1, abs=0.21)


def test_error_bars_are_wide_enough_for_any_seed() -> None:
    # As the simulated rig: drift of the light is allowed for (0.1 %) and does not happen, so that two sigma of a large
    # region's DOLP is never left by chance: the random part is 0.0011 at most, of 0.0024 allowed.
    of = PolarizerSeries(STANDARD, (4,) * 4, (1e-3,) * 4, 800.0, SensorNoise(5.0, 1.0))
    mask = np.ones((100, 100), bool)
    for seed in range(40):
        region = region_polarization(*measured(seed, of, shape=(100, 100)), mask, of)
        assert abs(region.dolp - 0.08) < 2 * region.dolp_sd
        assert region.dolp_sd < 0.002


def test_zero_mark_turns_aop_only() -> None:
    mask = np.ones((24, 25), bool)
    planes = measured(0, series())
    without, with_zero = (region_polarization(*planes, mask, series(zero_sd_rad=sd)) for sd in (0.0, 0.01))
    assert with_zero.aop_sd == pytest.approx(math.hypot(without.aop_sd, 0.01), rel=1e-12)
    assert with_zero.dolp_sd == without.dolp_sd


def test_stokes_are_averaged_not_dolp() -> None:
    # Half the patch polarized along x, half along y: the mean is unpolarized although every pixel has DOLP 0.5.
    s0 = np.full((2, 2), 1e6)
    s1 = np.array([[5e5, -5e5], [5e5, -5e5]])
    region = region_polarization(s0, s1, np.zeros((2, 2)), np.ones((2, 2), bool), series())
    assert region.dolp < region.dolp_sd


def test_undefined_pixels_are_left_out() -> None:
    s0 = np.array([[1e6, np.nan]])
    region = region_polarization(s0, 0.1 * s0, 0 * s0, np.ones((1, 2), bool), series())
    assert region.pixels == 1
    assert region.dolp == pytest.approx(0.1, abs=1e-4)


def test_regions_without_light_are_refused() -> None:
    of = series()
    plane = np.full((2, 2), 1.0)
    with pytest.raises(DataError, match="no defined pixel"):
        region_polarization(plane, plane, plane, np.zeros((2, 2), bool), of)
    with pytest.raises(DataError, match="is lit"):
        region_polarization(-plane, plane, plane, np.ones((2, 2), bool), of)
    with pytest.raises(DataError, match="shape"):
        region_polarization(plane, plane, plane, np.ones((3, 2), bool), of)
