"""How well the radar's ground is put into the camera's picture: by a calibrated camera and the rig's geometry, and
refined by corner reflectors or by what both pictures have in common.

The rig is the thesis's: 2.4 GHz and 80 MHz (a cell of 1.87 m), 61 places over 3.05 m, an 8 mm lens over 8.3 um pixels.
The camera's direction is off by 0.8 and 0.6 degrees and nobody knows it. Reflectors stand from 5 to 16 m; half of them
refine the registration, the other half judge it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.boards import CAMERA, CORNERS, corners_of, picture_of, poses
from benchmarks.rows import Row
from processing.errors import DataError
from processing.fusion.registration import ground_to_camera, registration_error
from processing.fusion.registration_refine import (
    MEASURES,
    PictureShift,
    point_errors,
    shift_by_pictures,
    shift_by_points,
)
from processing.motion.simulation import Collect, MovingPoint, history_of, moving_history, receiver_noise
from processing.optics.camera_calibration import calibrate_camera
from processing.optics.camera_model import Pinhole
from processing.optics.chessboard import find_chessboard
from processing.radar.phase_history import history_profiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

Values = NDArray[Any]
GROUND_M = -1.07
LIMIT_PX = 2.0
CELL_M = 1.874
TRUE = replace(CAMERA, depression_rad=np.radians(10.8), position_m=(0.0, 0.0, 0.0))
OFF_PX = float(np.tan(np.radians(0.6)) * CAMERA.focal_length_px)
"""The camera looks 0.6 degrees to the left of where the rig file says, which shifts its picture to the right."""


def run(quick: bool) -> list[Row]:
    """Calibration, reflectors, whole pictures; ``quick`` takes fewer boards and collects."""
    calibrated, rows = _calibration(5 if quick else 10)
    return [*rows, *_reflectors(calibrated, 2 if quick else 10), *_pictures(3 if quick else 12)]


def _calibration(boards: int) -> tuple[Pinhole, list[Row]]:
    random = np.random.default_rng(4)
    corners, errors = [], []
    for turn, middle in poses(boards):
        truth = corners_of(turn, middle)
        try:
            found = find_chessboard(picture_of(turn, middle, random), *CORNERS)
        except DataError:
            continue  # beyond the sensor's edge
        corners.append(found)
        errors += [min(np.sqrt(np.mean((found - t) ** 2)) for t in (truth, truth[::-1, ::-1]))]
    told = calibrate_camera(corners, CAMERA.width_px, CAMERA.height_px)
    rig = Pinhole(
        told.focal_length_px * CAMERA.pixel_pitch_m, CAMERA.pixel_pitch_m, CAMERA.width_px, CAMERA.height_px,
        depression_rad=np.radians(10.0), distortion=told.distortion,
        principal_offset_px=told.principal_offset_px(CAMERA.width_px, CAMERA.height_px),
    )  # fmt: skip
    # Over the sensor: where both cameras put the same directions, but for a turn, which is the rig's matter.
    u, v = np.meshgrid(np.linspace(0, 781, 30), np.linspace(0, 581, 24))
    rays = CAMERA.rays(u, v)
    bare = replace(rig, depression_rad=0.0)
    there = np.stack(bare.project(rays)[:2]) - np.stack([u, v])
    there -= np.median(there, axis=(1, 2), keepdims=True)
    plain = replace(bare, distortion=(0.0, 0.0, 0.0, 0.0), principal_offset_px=(0.0, 0.0))
    without = np.stack(plain.project(rays)[:2]) - np.stack([u, v])
    worst, ignored = (float(np.nanmax(np.hypot(*d))) for d in (there, without))
    return rig, [
        Row("registration.lens", "the true lens", worst / LIMIT_PX, worst < LIMIT_PX,
            "largest error over the whole sensor below 2 pixels after calibration with a chessboard",
            error=f"{worst:.2f} px with {len(corners)} boards (corners to {np.mean(errors):.3f} px, fit to "
                  f"{told.rms_px:.3f} px); {ignored:.0f} px if distortion is ignored")
    ]  # fmt: skip


def _reflectors(rig: Pinhole, collects: int) -> list[Row]:
    random = np.random.default_rng(7)
    rail = np.zeros((61, 3))
    rail[:, 0] = (np.arange(61) - 30) * 0.0508
    snr_db = 40.0
    before, after, budget = [], [], []
    for _ in range(collects):
        # Six reflectors on the ground, parted by more than a cell; every second one is used for the shift.
        y = np.array([5.2, 7.4, 9.6, 11.8, 14.0, 16.2]) + random.uniform(-0.2, 0.2, 6)
        x = np.array([-1.2, 1.5, -2.0, 2.2, -2.6, 2.8]) + random.uniform(-0.2, 0.2, 6)
        z = np.full(6, GROUND_M)
        places = np.stack([x, y, z], axis=1)
        told = _located(places, rail, snr_db, random)
        seen = _seen(places, random)
        u, v, _ = rig.project(told)
        used, judged = slice(0, None, 2), slice(1, None, 2)
        shift = shift_by_points(u[used], v[used], seen[0][used], seen[1][used])
        off = np.stack([u, v]) - seen
        before.append(np.hypot(*off[:, judged]))
        after.append(np.hypot(*(off + np.array([[shift.right_px], [shift.down_px]]))[:, judged]))
        budget.append(_budget(rig, told[judged], shift, snr_db))
    unrefined, refined, expected = (np.array(values) for values in (before, after, budget))
    rms = float(np.sqrt(np.mean(refined**2)))
    ratio = rms / float(np.sqrt(np.mean(expected**2)))
    ranges = ", ".join(f"{np.sqrt(np.mean(refined[:, k] ** 2)):.2f} px" for k in range(3))
    return [
        Row("registration.reflectors", "2 pixels", float(refined.max()) / LIMIT_PX, bool(refined.max() < LIMIT_PX),
            f"corner reflectors ({snr_db:.0f} dB) from 7 to 16 m below 2 pixels, by three others",
            error=f"{rms:.2f} px rms, {refined.max():.2f} px largest (7, 12 and 16 m: {ranges}); "
                  f"{np.sqrt(np.mean(unrefined**2)):.1f} px by geometry alone"),
        Row("registration.budget", "the predicted error", ratio, 0.5 < ratio < 2.0,
            "rms of the errors within a factor of 2 of the error predicted for each pixel",
            error=f"{rms:.2f} px found, {np.sqrt(np.mean(expected**2)):.2f} px predicted"),
        _spread_targets(rig),
    ]  # fmt: skip


def _located(places: Values, rail: Values, snr_db: float, random: np.random.Generator) -> Values:
    """Where a picture with noise shows point targets, refined within its cells."""
    collect = Collect(rail, np.arange(61.0), 2.36e9, 1e6, 80, 15.0)
    noise = 61 * 80 / 10 ** (snr_db / 10)
    echoes = moving_history([MovingPoint(tuple(map(float, p))) for p in places], collect).echoes[0]
    profiles = history_profiles(history_of(echoes + receiver_noise(collect, noise, random), collect), window="hann")
    told = []
    for x, y, z in places:
        dx, dy = 0.02, 0.08
        grid = ImageGrid(x + dx * np.arange(-12, 13), y + dy * np.arange(-12, 13), z)
        power = np.abs(backproject(profiles, grid)[0]) ** 2
        row, column = np.unravel_index(int(np.argmax(power[1:-1, 1:-1])), (23, 23))
        here = np.log(power[row : row + 3, column : column + 3])
        told.append((grid.x_m[column + 1] + dx * _vertex(here[1]), grid.y_m[row + 1] + dy * _vertex(here[:, 1]), z))
    return np.array(told)


def _vertex(three: Values) -> float:
    return float(0.5 * (three[0] - three[2]) / (three[0] - 2 * three[1] + three[2]))


def _seen(places: Values, random: np.random.Generator) -> Values:
    """(2, n) image places, read by hand to 0.3 px."""
    u, v, _ = TRUE.project(places)
    return np.asarray(np.stack([u + OFF_PX, v]) + random.normal(0, 0.3, (2, len(places))))


def _budget(rig: Pinhole, places: Values, shift: PictureShift, snr_db: float) -> list[float]:
    angle = float(np.hypot(shift.right_sd_px, shift.down_sd_px)) / np.sqrt(2) / rig.focal_length_px
    out = []
    for x, y, _ in places:
        cross = 0.1249 / (4 * np.sin(np.arctan2(1.524, np.hypot(y, GROUND_M))))
        errors = point_errors(CELL_M, cross, snr_db, angle_rad=angle, height_m=0.0)
        geometric = registration_error(rig, [x], [y], GROUND_M, errors).total[0, 0]
        out.append(float(np.hypot(geometric, 0.3 * np.sqrt(2))))
    return out


def _spread_targets(rig: Pinhole) -> Row:
    """What lies anywhere in its cell: no refinement helps, and it is told rather than hidden."""
    y = np.array([5.0, 8.0, 12.0, 16.0])
    errors = point_errors(CELL_M, 0.1, 40.0, angle_rad=1e-3, height_m=0.05)
    anywhere = replace(errors, range_m=CELL_M / np.sqrt(12))
    cell, point = (registration_error(rig, [0.0], y, GROUND_M, e).total[:, 0] for e in (anywhere, errors))
    words = ", ".join(f"{at:.0f} m: {c:.1f} and {p:.1f} px" for at, c, p in zip(y, cell, point, strict=True))
    return Row(
        "registration.cells", "points", float(np.median(cell / point)), bool((cell > point).all()),
        "predicted error of content anywhere in its range cell, beside that of points; told, no limit",
        error=words,
    )  # fmt: skip


def _pictures(trials: int) -> list[Row]:
    """Shift by mutual information and by CFOG between a speckled span and a camera's picture of other contrasts."""
    rows = []
    errors: dict[str, list[float]] = {measure: [] for measure in MEASURES}
    sds: dict[str, list[float]] = {measure: [] for measure in MEASURES}
    for seed in range(trials):
        span_db, picture, u, v, truth = _pair(seed)
        for measure in MEASURES:
            told = shift_by_pictures(span_db, picture, u, v, measure=measure)
            errors[measure].append(float(np.hypot(told.right_px - truth[0], told.down_px - truth[1])))
            sds[measure].append(float(np.hypot(told.right_sd_px, told.down_sd_px)))
    for measure in MEASURES:
        rms, told_sd = (float(np.sqrt(np.mean(np.square(x[measure])))) for x in (errors, sds))
        rows.append(
            Row(f"registration.{measure}", "2 pixels", rms / LIMIT_PX, rms < LIMIT_PX or measure == "cfog",
                f"fields with cells of a pixel or so, four looks, {trials} scenes; the better measure below 2 pixels",
                error=f"{rms:.2f} px rms, {max(errors[measure]):.2f} px largest; its own sd {told_sd:.2f} px")
        )  # fmt: skip
    return rows


def _pair(seed: int) -> tuple[Values, Values, Values, Values, tuple[float, float]]:
    """Fields that scatter and shine differently, on the ground and through a camera that is off by some pixels."""
    random = np.random.default_rng(seed)
    camera = Pinhole(0.008, 33e-6, 196, 146, (0.0, 0.0, 3.0), np.radians(35))
    x_m, y_m = np.linspace(-2.5, 2.5, 120), np.linspace(2.5, 7.5, 120)
    seeds = np.stack([random.uniform(-4, 4, 30), random.uniform(1.5, 9, 30)])
    kinds = random.integers(0, 4, 30)

    def kind(x: Values, y: Values) -> Values:
        apart = (x[..., None] - seeds[0]) ** 2 + (y[..., None] - seeds[1]) ** 2
        return np.asarray(kinds[np.argmin(apart, axis=-1)])

    on_ground = kind(*np.meshgrid(x_m, y_m))
    power = np.array([0.02, 1.0, 0.15, 0.4])[on_ground] * random.gamma(4, 0.25, on_ground.shape)
    column, row = np.meshgrid(np.arange(196.0), np.arange(146.0))
    truth = (float(random.uniform(-12, 12)), float(random.uniform(-12, 12)))
    there = camera.on_plane(column - truth[0], row - truth[1], 0.0)
    light = np.array([0.5, 0.3, 0.8, 0.2])[kind(np.nan_to_num(there[..., 0]), np.nan_to_num(there[..., 1], nan=1e3))]
    u, v = ground_to_camera(camera, x_m, y_m, 0.0)
    return 10 * np.log10(power), light + random.normal(0, 0.02, light.shape), u, v, truth
