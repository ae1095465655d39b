"""Polar format against exact back-projection: error over the scene's size, and whether it was foretold."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.rows import Row
from benchmarks.speed_factorized import CENTRE_HZ, PIXEL_M, scene
from processing.radar.phase_history import history_profiles
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.sar.polar_format import polar_format
from processing.sar.polar_format_geometry import polar_forecast, spotlight, usable_radius_m

FACTOR_DB = 6.02
COARSE = 4


def run(quick: bool) -> list[Row]:
    """Scenes of a flight at 8 km and 15 GHz, from small ones to those where wavefronts are no longer straight."""
    return [_scene(side, 300 if quick else 600) for side in ((96, 192) if quick else (128, 256, 512, 1024))]


def _scene(side: int, pulses: int) -> Row:
    history, _ = scene(side, pulses)
    profiles = history_profiles(history, window="rectangular", oversampling=4)
    axis = (np.arange(side) - side / 2) * PIXEL_M
    grid = ImageGrid(axis, axis, 0.0)
    wavelength = SPEED_OF_LIGHT_M_S / CENTRE_HZ
    foretold = polar_forecast(history.antenna_m, grid, wavelength, history.bandwidth_hz)
    assert foretold is not None
    polar_format(profiles, grid)
    begun = time.process_time()
    image = polar_format(profiles, grid)[0]
    own = time.process_time() - begun
    begun = time.process_time()
    backproject(profiles, grid)
    theirs = time.process_time() - begun
    exact = backproject(profiles, ImageGrid(axis[::COARSE], axis[::COARSE], 0.0), interpolator="sinc16")[0]
    seen = image[::COARSE, ::COARSE]
    error = float(20 * np.log10(np.linalg.norm(seen - exact) / np.linalg.norm(exact)))
    radius = usable_radius_m(spotlight(history.antenna_m, grid), 4 * np.pi / wavelength, -50.0)
    told = f"{side * PIXEL_M:.0f} m wide, {pulses} pulses: {own:.3f} s, points within {radius:.0f} m below -50 dB"
    return Row(
        f"accuracy.polar_format {told}",
        "exact back-projection (ours)", theirs / own, bool(abs(error - foretold.error_db) <= FACTOR_DB),
        f"{foretold.error_db:.1f} dB foretold, within a factor of 2", error=round(error, 1),
    )  # fmt: skip
