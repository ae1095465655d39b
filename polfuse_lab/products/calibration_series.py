"""The targets of a calibration series, looked at one after the other in its session."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.radar.health import CLIPPED, FULL
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import SeriesTarget
from polfuse_lab.products.calibration_inputs import FocusedImage, TargetSpec
from polfuse_lab.products.calibration_targets import (
    NUMERICAL_FLOOR,
    TargetView,
    by_channel,
    expected_scattering,
    judge,
    unseen,
)
from polfuse_lab.products.ranging import range_profiles
from polfuse_lab.products.standing import usable_records
from polfuse_lab.products.visits import targets, visits
from polfuse_lab.session import Session
from processing.calibration.budget import mean_sd
from processing.calibration.distortion import CHANNELS
from processing.calibration.noise import noise_floor
from processing.calibration.offset import TargetPeak, locate_target
from processing.calibration.rcs import to_dbsm
from processing.calibration.target_checks import GOOD, Verdict, average_repeats
from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.radar.ranging import full_scale
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

STEPS_M = (0.05, 0.05)
"""Pixels (x, y) around a target, m: so small that a parabola through three of them finds the peak within 2 mm."""
BESIDE_M = 3.0
"""How far beyond the search radius a brighter echo is looked for, which tells that the target stands elsewhere, m."""
ELSEWHERE_DB = 6.0
"""By which an echo elsewhere must be stronger to be taken for the target in a wrong place."""
LEAST_ELSEWHERE_DB = 15.0
"""Above the noise, for an echo elsewhere to be named: the highest of a thousand pixels of noise stands at 9 dB."""
NOISE_CELLS = 15
"""Range cells over which noise is estimated where sweeps do not tell it."""


def look_at_series(
    session: Session,
    focused: FocusedImage,
    *,
    radius_m: float,
    min_snr_db: float,
    sky: Path | str | None = None,
    near_field: bool = False,
) -> Iterator[TargetView]:
    """Look at each target of a calibration series in turn, as the image to be calibrated was made.

    Args:
        session: of a plan of kind ``calibration_series``.
        focused: the image to be calibrated: waveform, window, pattern compensation and ground.
        radius_m: how far from its stated place a target's peak may be, m.
        min_snr_db: least peak over noise, dB.
        sky: session of the clear sky, whose mean profile (coupling between the antennas) is taken off.
        near_field: whether targets are expected as physical optics has them at their distance.

    Yields:
        One view for each target, in the series' order, with its verdict.

    Raises:
        PolfuseError: the session is no calibration series, or its radar differs from the image's.
    """
    series = targets(session)
    if not series:
        raise PolfuseError(
            "is no calibration series",
            where=str(session.path),
            advice="collect with a plan of kind 'calibration_series', or state targets that stand in the image",
        )
    waveform = session.waveform
    if (waveform.centre_hz, waveform.bandwidth_hz) != (focused.centre_hz, focused.bandwidth_hz):
        raise PolfuseError(
            f"was recorded at {waveform.centre_hz / 1e9:g} GHz with {waveform.bandwidth_hz / 1e6:g} MHz, the image at "
            f"{focused.centre_hz / 1e9:g} GHz with {focused.bandwidth_hz / 1e6:g} MHz",
            where=str(session.path),
            advice="calibrate with a series from the same radar settings",
        )
    empty = None if sky is None else range_profiles(sky, range_compensated=False, **_same_profiles(focused))
    for target in series:
        yield _look(session, focused, target, radius_m, min_snr_db, empty, near_field)


def _look(
    session: Session,
    focused: FocusedImage,
    target: SeriesTarget,
    radius_m: float,
    min_snr_db: float,
    empty: RangeProfiles | None,
    near_field: bool,
) -> TargetView:
    """One target; whatever is wrong with it is told by its verdict."""
    nothing = np.full((2, 2), np.nan + 0j)
    spec = replace(TargetSpec.of(target), near_field=near_field)
    groups: dict[int, list[int]] = {}
    for position, visit in visits(session).items():
        if visit.target == target.name:
            groups.setdefault(visit.repeat, []).append(position)
    try:
        clipped = _clipped(session, {position for group in groups.values() for position in group})
    except PolfuseError as error:
        return unseen(spec, nothing, Verdict(False, error.what, error.advice))
    peaks: list[tuple[TargetPeak, Complexes, Floats]] = []
    expected = nothing
    try:
        for group in groups.values():
            profiles = _profiles(session, focused, frozenset(group), empty)
            seen = replace(focused, antenna_m=profiles.antenna_m)
            expected = expected_scattering(seen, spec)
            if clipped > CLIPPED:
                return unseen(
                    spec,
                    expected,
                    Verdict(
                        False,
                        f"the beat is saturated ({100 * clipped:.1f} % of its samples at full scale)",
                        "turn the gain down, or move the target further away, and record it again",
                    ),
                    clipped=clipped,
                )
            peaks.append(find_target(seen, profiles, spec, expected, radius_m, min_snr_db))
    except DataError as error:
        return unseen(spec, expected, Verdict(False, error.what, error.advice), clipped=clipped)
    except PolfuseError as error:
        return unseen(spec, expected, Verdict(False, error.what, error.advice), clipped=clipped)
    view = average_views(spec, expected, peaks)
    view = replace(view, clipped=clipped)
    return view.refused(judge(view)) if view.whole else view.refused(_incomplete(view))


def _clipped(session: Session, positions: set[int]) -> float:
    """Largest share of the beat's samples at full scale in a record."""
    worst = 0.0
    for record in usable_records(session, positions=positions):
        beat = record.samples[:, record.sync.beat_channel].astype(np.float64) / full_scale(record.samples.dtype)
        worst = max(worst, float(np.mean(np.abs(beat) >= FULL)))
    return worst


def _same_profiles(focused: FocusedImage) -> dict[str, Any]:
    """Options with which the image's own profiles were made."""
    names = ("window", "oversampling", "max_range_m")
    return {name: focused.ranging[name] for name in names if name in focused.ranging}


def _profiles(
    session: Session, focused: FocusedImage, positions: frozenset[int], empty: RangeProfiles | None
) -> RangeProfiles:
    same: dict[str, Any] = {"range_compensated": True, "positions": positions, **_same_profiles(focused)}
    if empty is None:
        return range_profiles(session, **same)
    return range_profiles(session, coupling="reference", reference=empty, **same)


def find_target(
    focused: FocusedImage,
    profiles: RangeProfiles,
    spec: TargetSpec,
    expected: Complexes,
    radius_m: float,
    min_snr_db: float,
) -> tuple[TargetPeak, Complexes, Floats]:
    """The target's peak in one repeat, with its channels' values and noise in the order of ``CHANNELS``.

    Args:
        focused: as the image to be calibrated, with this repeat's antenna places.
        profiles: of this repeat alone, compensated for range.
        spec: the target as stated.
        expected: (2, 2) its apparent S.
        radius_m: how far from its stated place its peak may be, m.
        min_snr_db: least peak over noise, dB.

    Raises:
        DataError: it is not found, too weak, or stands elsewhere.
    """
    x, y = spec.image_place(focused.z_m)
    along = len(np.unique(profiles.antenna_m[:, 0])) > 1
    wide = radius_m + BESIDE_M
    # From one place alone a target's bearing is not seen: the image is a strip abreast of its stated place.
    columns = x + STEPS_M[0] * np.arange(-np.ceil(wide / STEPS_M[0]), np.ceil(wide / STEPS_M[0]) + 1) if along else None
    rows = y + STEPS_M[1] * np.arange(-np.ceil(wide / STEPS_M[1]), np.ceil(wide / STEPS_M[1]) + 1)
    rows = rows[rows > profiles.resolution_m]
    if len(rows) < 3:
        raise DataError(f"the stated ground range of {spec.y_m:g} m is too near", "place it further away")
    strip = x + 1e-3 * np.arange(-1, 2) if columns is None else columns
    grid = ImageGrid(np.asarray(strip, dtype=np.float64), rows, focused.z_m)
    beamwidth = focused.settings.get("beamwidth_rad")
    depression = float(focused.settings.get("depression_rad", 0.0))
    image = backproject(profiles, grid, weights=focused.window(), beamwidth_rad=beamwidth, depression_rad=depression)
    if columns is None:
        # What hardly changes along x has no peak there; the middle column is given one.
        image = image * np.array([0.999, 1.0, 0.999], dtype=np.float32)
    wanted = by_channel(expected)
    reference = max(range(len(profiles.channels)), key=lambda index: abs(wanted[profiles.channels[index]]))
    shown = replace(focused, x_m=grid.x_m, y_m=grid.y_m)
    noise = _noise(focused, profiles, np.array([x, y, focused.z_m]))
    look: dict[str, Any] = {"reference": reference, "min_snr_db": -np.inf, "gain": shown.range_gain}
    place = f"({x:.2f}, {y:.2f}) m"
    try:
        peak = locate_target(image, grid.x_m, grid.y_m, (x, y), radius_m=radius_m, **look)
    except DataError:
        peak = None
    try:
        brightest = locate_target(image, grid.x_m, grid.y_m, (x, y), radius_m=2 * wide, **look)
    except DataError:
        brightest = None
    floor = noise[reference]
    # Noise grows where the antennas' pattern is compensated for, so an echo elsewhere is judged by the noise there.
    if brightest is not None and to_dbsm(brightest.power / _noise_at(focused, profiles, brightest)[reference]) >= max(
        min_snr_db, LEAST_ELSEWHERE_DB
    ):
        moved = float(np.hypot(brightest.x_m - x, brightest.y_m - y))
        if moved > radius_m and (peak is None or to_dbsm(brightest.power / peak.power) > ELSEWHERE_DB):
            raise DataError(
                f"it is not at its stated place {place}: the strongest echo stands at ({brightest.x_m:.2f}, "
                f"{brightest.y_m:.2f}) m, {moved:.1f} m off",
                "measure its place again, or take away what stands there",
            )
    if peak is None:
        raise DataError(
            f"nothing is seen within {radius_m:.2f} m of its stated place {place}",
            "check that it stands there and looks at the radar",
        )
    snr_db = float(to_dbsm(peak.power / floor))
    if not snr_db >= min_snr_db:
        raise DataError(
            f"it stands only {snr_db:.1f} dB above the noise (at least {min_snr_db:.1f} dB is needed)",
            "use a larger or nearer target, or record more sweeps",
        )
    values, power = np.full(4, np.nan + 0j), np.full(4, np.nan)
    for index, name in enumerate(profiles.channels):
        values[CHANNELS.index(name)] = peak.values[index]
        power[CHANNELS.index(name)] = max(noise[index], NUMERICAL_FLOOR * peak.power)
    return peak, values, power


def _noise_at(focused: FocusedImage, profiles: RangeProfiles, peak: TargetPeak) -> Floats:
    return _noise(focused, profiles, np.array([peak.x_m, peak.y_m, focused.z_m]))


def _noise(focused: FocusedImage, profiles: RangeProfiles, place_m: Floats) -> Floats:
    """(channels,) noise power of an image's pixel: from how much the sweeps differ, else from the profiles far away."""
    distance = np.linalg.norm(place_m - profiles.antenna_m, axis=1)
    # The image is sum w g s / sum w g^2 of the profiles s; their noise grows as R^4 with the compensation of range.
    weights = focused.window() * focused.pattern(place_m)
    total = float(np.sum(focused.pulse_weights(place_m)))
    found = np.full(len(profiles.channels), np.nan)
    if profiles.noise is not None:
        found = np.sum(profiles.noise * (weights * distance**2) ** 2, axis=1) / total**2
    if not np.isfinite(found).all() or not (found > 0).all():
        floor = noise_floor(
            profiles.values, profiles.range_m, window_m=NOISE_CELLS * profiles.resolution_m, range_compensated=True
        )
        at = np.array([np.interp(distance.mean(), profiles.range_m, row) for row in floor])
        found = np.where(np.isfinite(found) & (found > 0), found, at * np.sum(weights**2) / total**2)
    return np.asarray(found)


def average_views(
    spec: TargetSpec, expected: Complexes, peaks: list[tuple[TargetPeak, Complexes, Floats]]
) -> TargetView:
    """Mean of the repeats. Channels that differ from repeat to repeat by more than their noise count as that noisy.

    Args:
        spec: the target as stated.
        expected: (2, 2) its apparent S.
        peaks: of the repeats, by :func:`find_target`.
    """
    measured = np.array([values for _, values, _ in peaks])
    noise = np.mean([power for _, _, power in peaks], axis=0) / len(peaks)
    known = np.isfinite(measured).all(axis=0)
    mean, amplitude_sd = np.full(4, np.nan + 0j), 0.0
    if known.any():
        mean[known], turned = average_repeats(measured[:, known])
        if len(turned) > 1:
            # What all channels share is the target's placing; what they do not share is noise.
            shared = turned @ mean[known].conj() / np.sum(np.abs(mean[known]) ** 2)
            amplitude_sd = mean_sd(to_dbsm(np.abs(shared) ** 2))
            left = turned - shared[:, None] * mean[known]
            freedom = (len(turned) - 1) * max(int(known.sum()) - 1, 1)
            ratio = float(np.sum(np.abs(left) ** 2 / noise[known]) / len(turned)) / freedom
            noise = noise * max(1.0, ratio)
    reference = int(np.nanargmax(np.abs(mean))) if known.any() else 0
    snr_db = float(to_dbsm(np.abs(mean[reference]) ** 2 / noise[reference]))
    x, y = (float(np.mean([getattr(peak, axis) for peak, _, _ in peaks])) for axis in ("x_m", "y_m"))
    return TargetView(spec, expected, GOOD, mean, noise, x, y, snr_db, len(peaks), amplitude_sd)


def _incomplete(view: TargetView) -> Verdict:
    missing = [name for name, value in zip(CHANNELS, view.values, strict=True) if not np.isfinite(value)]
    if {"HH", "VV"} & set(missing):
        return Verdict(False, f"channel {', '.join(missing)} is missing", "record it again with all channels")
    return GOOD
