"""How to focus: the cheapest method, interpolator, oversampling and precision whose expected error is small enough.

Errors are root mean square over the image, relative to the exact float64 matched filter. Those of back-projection
follow from filter, window and geometry (:mod:`processing.sar.focus_errors`), and so do those of factorized
back-projection (:mod:`processing.sar.factorized_forecast`); those of range migration were measured on point targets in
random geometries (``python -m benchmarks accuracy.focus_planner`` measures all of them again). Times:
:mod:`processing.sar.focus_costs`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.sar.factorized_plan import Settings
from processing.sar.focus_costs import (
    BACKPROJECTION_NS,
    RANGING_NS,
    REFERENCE_NS,
    backprojection_seconds,
    migration_seconds,
    polar_seconds,
)
from processing.sar.focus_errors import ghost_share, predicted_error_db
from processing.sar.grid import ImageGrid
from processing.sar.polar_format_geometry import PolarForecast
from processing.tolerances import check_tolerance

if TYPE_CHECKING:
    from processing.sar.factorized_settings import FactorizedChoice

METHODS = ("auto", "bp", "ffbp", "rma", "pfa", "reference")

OVERSAMPLINGS = (2, 3, 4, 6, 8, 12, 16)
"""Range bins per resolution cell that are chosen from where none is given."""

SAFETY_DB = {"bp": 2.5, "ffbp": 4.0, "rma": 4.5, "pfa": 4.5, "reference": 2.5}
"""How far below the tolerance a method's expected error must be: measured errors exceed it by at most so much."""

MIGRATION_ANGLES_DEG = (40.0, 66.0, 72.0, 77.0, 80.0, 90.0)
"""Largest angles from broadside at which range migration was measured; nothing is promised at grazing angles."""

MIGRATION_ERROR_DB = {
    False: (-72.0, -70.0, -64.0, -57.0, -46.0, 0.0),
    True: (-70.0, -62.0, -50.0, -37.0, -12.0, 0.0),
}
"""Bounds of range migration's error, dB, without and with compensation of the antennas' pattern."""

MIGRATION_TYPICAL_ANGLES_DEG = (48.0, 66.0, 72.0, 77.0, 80.0, 90.0)
MIGRATION_TYPICAL_DB = (-80.0, -76.0, -68.5, -62.5, -49.0, 0.0)
"""Its error as expected at these angles without compensation of the pattern, dB; with it the bound is expected."""

MIGRATION_WINDOW_DB = -10.0
"""By how much a window over the ramp lowers it where nothing but spectral leakage is left, up to the first angle."""

FACTORIZED_TYPICAL_DB = -3.0
"""What is measured of factorized back-projection over the bound that its settings are chosen by, dB: what is expected
where the geometry is not known."""

FACTORIZED_PULSES, FACTORIZED_PIXELS = 192, 2**18
"""Pulses and pixels from which factorized back-projection is chosen of itself; below it hardly pays."""

REFERENCE_FLOOR_DB = -150.0
"""What is left of float64 precision in an image that is stored as complex64."""

PRECISIONS = {
    "bp": "ranges and phases exact to float64, sums in float32",
    "ffbp": "ranges and phases in float64, samples in complex64",
    "rma": "phases in float64, spectra in complex64",
    "pfa": "phases in float64, spectra in complex64",
    "reference": "float64",
}


@dataclass(frozen=True)
class Task:
    """What is to be focused, as far as the choice depends on it."""

    pixels: int
    pulses: int
    channels: int
    oversampling: float | None
    """Range bins per resolution cell; None where the planner is to choose."""
    wavelength_m: float
    furthest_m: float
    """Largest range in the image."""
    widest_rad: float
    """Largest angle from broadside in the image."""
    residual_m: float | None
    """Root mean square deviation from a straight rail; None where there is no such rail."""
    compensated: bool
    """Whether the antennas' pattern is compensated."""
    window: str = "rectangular"
    """Over the ramp; the rectangular one fills the band to its edges, which is the worst case."""
    oversamplings: tuple[int, ...] = OVERSAMPLINGS
    """To choose from where ``oversampling`` is None."""
    antenna_m: NDArray[np.float64] | None = None
    """(positions, 3) for the ghosts that interpolation leaves; without it all of them are taken to stay."""
    grid: ImageGrid | None = None
    """Likewise."""
    bandwidth_hz: float = 80e6
    """Of the ramp; with the profiles' depth it tells how many bins they have."""
    depth_m: float | None = None
    """Ranges that the profiles hold; None where they begin at 0."""
    moving: bool = False
    """Whether motion within the sweeps is modelled, which back-projection alone does."""
    polar: PolarForecast | None = None
    """What polar format would do; None where it cannot be used."""

    @property
    def cells(self) -> float:
        """Resolution cells of a range profile."""
        depth = self.furthest_m if self.depth_m is None else self.depth_m
        return depth * 2 * self.bandwidth_hz / SPEED_OF_LIGHT_M_S

    @property
    def image_cells(self) -> float:
        """Resolution cells of range in the image as its middle position sees it; infinite where that is not known."""
        if self.antenna_m is None or self.grid is None:
            return math.inf
        x, y = (np.linspace(axis.min(), axis.max(), 9) for axis in (self.grid.x_m, self.grid.y_m))
        middle = np.mean(self.antenna_m, axis=0)
        away = np.sqrt((x - middle[0]) ** 2 + (y[:, None] - middle[1]) ** 2 + (self.grid.z_m - middle[2]) ** 2)
        return max(float(np.ptp(away)) * 2 * self.bandwidth_hz / SPEED_OF_LIGHT_M_S, 1.0)


@dataclass(frozen=True)
class Choice:
    """A way to focus, and why."""

    method: str
    """``"rma"`` (range migration), ``"pfa"`` (polar format), ``"bp"`` (back-projection), ``"ffbp"`` (factorized
    back-projection) or ``"reference"``."""
    interpolator: str
    """Of back-projection; ``"sinc8"`` and ``"kaiser-bessel"`` are the other methods' own."""
    predicted_error_db: float
    seconds: float
    """Expected core time on the core that the tables were measured on, range compression included."""
    reason: str
    oversampling: float = 8.0
    """Range bins per resolution cell."""
    settings_db: float | None = None
    """Tolerance that the settings of factorized back-projection are to be chosen by; None for other methods."""
    considered: tuple[Choice, ...] = ()
    """The other ways, cheapest first."""

    @property
    def precision(self) -> str:
        """Of the arithmetic, in words."""
        return PRECISIONS[self.method]


def backprojection_error_db(interpolator: str, oversampling: float) -> float:
    """Expected error of back-projection of unweighted data where all ghosts stay in the image, dB: the worst case.

    Raises:
        DataError: unknown interpolator, or less than one bin per cell.
    """
    return predicted_error_db(interpolator, oversampling)


def migration_error_db(task: Task, *, bound: bool = False) -> float:
    """Expected error of range migration (or its bound), dB: its own by angle, and that of uneven positions."""
    angle = math.degrees(task.widest_rad)
    if bound or task.compensated:
        own = np.interp(angle, MIGRATION_ANGLES_DEG, MIGRATION_ERROR_DB[task.compensated])
    else:
        own = np.interp(angle, MIGRATION_TYPICAL_ANGLES_DEG, MIGRATION_TYPICAL_DB)
        if task.window != "rectangular" and angle <= MIGRATION_TYPICAL_ANGLES_DEG[0]:
            own += MIGRATION_WINDOW_DB
    uneven = 4 * math.pi / task.wavelength_m * (task.residual_m or 0.0)
    return float(10 * np.log10(10 ** (own / 10) + uneven**2))


def choices(task: Task, tolerance_db: float = -50.0, method: str = "auto") -> list[Choice]:
    """Everything that can be done, cheapest first; ``method`` is the one asked for.

    Factorized back-projection comes as the tolerance asks; where neither it is asked for nor size makes it pay, its
    error is that of a usual geometry.
    """
    # Its settings build on this module's errors of interpolation.
    from processing.sar.factorized_settings import predicted_seconds, settings_for

    shares: dict[int, float] = {}
    merging: dict[Settings, float] = {}
    offered = []
    for oversampling in task.oversamplings if task.oversampling is None else (task.oversampling,):
        share = _share(task, oversampling, shares)
        bins = oversampling * task.cells
        ranging = 1e-9 * RANGING_NS * bins * task.pulses * task.channels
        for interpolator in BACKPROJECTION_NS:
            error = predicted_error_db(interpolator, oversampling, task.window, share, depth_cells=task.image_cells)
            seconds = backprojection_seconds(
                interpolator, pixels=task.pixels, pulses=task.pulses, channels=task.channels,
                bins=bins, compensated=task.compensated,
            )  # fmt: skip
            offered.append(Choice("bp", interpolator, error, ranging + seconds, "", oversampling))
        if task.moving:
            continue
        if task.residual_m is not None:
            seconds = _migration_seconds(task, bins)
            offered.append(
                Choice("rma", "kaiser-bessel", migration_error_db(task), ranging + seconds, "", oversampling)
            )
        if task.polar is not None and not task.compensated:
            seconds = polar_seconds(
                along=task.polar.along, across=task.polar.across, pulses=task.pulses, pixels=task.pixels,
                channels=task.channels,
            )  # fmt: skip
            offered.append(Choice("pfa", "kaiser-bessel", task.polar.error_db, ranging + seconds, "", oversampling))
        if oversampling >= 2:
            chosen = settings_for(tolerance_db, task.pulses, oversampling)
            known = merging if method == "ffbp" or (method == "auto" and _large(task)) else None
            try:
                error = _factorized_error_db(task, chosen, oversampling, known)
            except DataError:  # no polar grid: the image reaches abreast of the track
                if method == "ffbp":
                    raise
                continue
            seconds = predicted_seconds(chosen, task.pixels, task.pulses, task.channels)
            offered.append(Choice("ffbp", "sinc8", error, ranging + seconds, "", oversampling, tolerance_db))
    return sorted(offered, key=lambda choice: (choice.seconds, choice.predicted_error_db))


def choose(task: Task, tolerance_db: float, method: str = "auto") -> Choice:
    """The cheapest way whose expected error is within the tolerance by a margin; the most exact where none is.

    Plain float64 back-projection is chosen of itself only where nothing else reaches the tolerance and it does.

    Args:
        task: what is to be focused.
        tolerance_db: largest error, dB (negative).
        method: ``"auto"``, or the one to use: ``"rma"``, ``"pfa"``, ``"bp"``, ``"ffbp"``, ``"reference"``.

    Raises:
        DataError: unknown method, a tolerance that is no negative number, less than one bin per cell, an image without
            pixels or pulses, range migration without a straight rail, or polar format where it cannot be used.
    """
    if method not in METHODS:
        raise DataError(f"there is no focusing method {method!r}", f"choose one of {', '.join(METHODS)}")
    check_tolerance(tolerance_db, "image")
    if min(task.pixels, task.pulses, task.channels) < 1:
        raise DataError("there is nothing to focus", "give pixels, pulses and channels")
    offered = choices(task, tolerance_db, method)
    exact = _reference(task)
    if method == "reference":
        return replace(exact, reason="asked for: plain float64 back-projection", considered=tuple(offered))
    fit = [choice for choice in offered if method in ("auto", choice.method)]
    if method == "auto" and not _large(task):
        fit = [choice for choice in fit if choice.method != "ffbp"]
    if not fit:
        what = "positions are not straight enough for range migration"
        if method == "pfa":
            what = (
                "polar format takes images of a plane seen from one side and from afar, without the antennas' pattern"
            )
        if task.moving:
            what = "the antennas moved while they swept, which back-projection alone models"
        raise DataError(
            what, "form a smaller image, or focus by back-projection" if method == "pfa" else "focus by back-projection"
        )
    fitting = [choice for choice in fit if fits(choice, tolerance_db)]
    at = f" at {task.oversampling:g} bins per cell" if task.oversampling is not None else ""
    if fitting:
        best, why = fitting[0], f"cheapest within {tolerance_db:g} dB"
    elif method == "auto" and fits(exact, tolerance_db):
        best, why = exact, f"only float64 reaches {tolerance_db:g} dB"
    else:
        best = min(fit, key=lambda choice: choice.predicted_error_db)
        near = best.predicted_error_db <= tolerance_db
        why = (
            f"nothing on offer stays below {tolerance_db:g} dB{at} by a safe margin: the most exact"
            if near
            else f"nothing on offer reaches {tolerance_db:g} dB{at}: the most exact"
        )
    asked = "" if method == "auto" else f"{method} asked for; "
    others = tuple(choice for choice in offered if choice is not best)
    return replace(best, reason=asked + why, considered=others)


def fits(choice: Choice, tolerance_db: float) -> bool:
    """Whether a way's expected error is within a tolerance by the method's margin, :data:`SAFETY_DB`."""
    return choice.predicted_error_db <= tolerance_db - SAFETY_DB[choice.method]


def _large(task: Task) -> bool:
    return task.pulses >= FACTORIZED_PULSES and task.pixels >= FACTORIZED_PIXELS


def _factorized_error_db(
    task: Task, chosen: FactorizedChoice, oversampling: float, known: dict[Settings, float] | None
) -> float:
    """Expected error of factorized back-projection: of its mergings, and of reading the profiles.

    That of a usual geometry where the task does not tell its own, or ``known`` (what was found for it) is None.
    """
    from processing.sar.factorized_forecast import merging_error_db

    if task.antenna_m is None or task.grid is None or known is None:
        return chosen.predicted_error_db + FACTORIZED_TYPICAL_DB
    if chosen.settings not in known:
        known[chosen.settings] = merging_error_db(
            task.antenna_m, task.grid, chosen.settings, centre_hz=SPEED_OF_LIGHT_M_S / task.wavelength_m,
            bandwidth_hz=task.bandwidth_hz, window=task.window,
        )  # fmt: skip
    read = backprojection_error_db("sinc8", oversampling)
    return 10 * math.log10(10 ** (known[chosen.settings] / 10) + 10 ** (read / 10))


def _reference(task: Task) -> Choice:
    oversampling = task.oversampling if task.oversampling is not None else max(task.oversamplings)
    share = _share(task, oversampling, {})
    error = predicted_error_db(
        "sinc16", oversampling, task.window, share, floor_db=REFERENCE_FLOOR_DB, depth_cells=task.image_cells
    )
    seconds = 1e-9 * REFERENCE_NS * task.pixels * task.pulses * task.channels
    return Choice("reference", "sinc16", error, seconds, "", oversampling)


def _migration_seconds(task: Task, bins: float) -> float:
    """From the sizes that :mod:`processing.sar.range_migration_plan` would choose, all but for rounding up."""
    k = 4 * math.pi / task.wavelength_m
    sine = math.sin(min(task.widest_rad + 0.2, 0.5 * (task.widest_rad + math.pi / 2)))
    rows = math.sqrt(task.pixels)
    along_x, ahead = 1.3 * task.furthest_m, task.furthest_m
    if task.grid is not None and task.antenna_m is not None:
        rows = task.grid.shape[0]
        along_x = 1.5 * (float(np.ptp(task.grid.x_m)) + float(np.ptp(task.antenna_m[:, 0])))
        ahead = 1.2 * float(np.ptp(task.grid.y_m)) + 24 * SPEED_OF_LIGHT_M_S / (2 * task.bandwidth_hz)
    lines = k * sine * along_x / math.pi
    cosine = max(math.cos(task.widest_rad), 0.1)
    across = 2.8 * task.bandwidth_hz / SPEED_OF_LIGHT_M_S * min(ahead, task.furthest_m) / cosine
    return migration_seconds(
        lines=lines, across=across, rows=rows, columns=max(1.5 * lines, task.pixels / rows), pulses=task.pulses,
        bins=bins, channels=task.channels,
    )  # fmt: skip


def _share(task: Task, oversampling: float, known: dict[int, float]) -> float:
    """Ghosts that stay in the image; sampled for 2, 4, 8 and 16 bins per cell, of which the next below serves."""
    if task.antenna_m is None or task.grid is None:
        return 1.0
    near = max(2, min(16, 2 ** int(math.log2(max(oversampling, 2.0)))))
    if near not in known:
        known[near] = ghost_share(
            task.antenna_m, task.grid, centre_hz=SPEED_OF_LIGHT_M_S / task.wavelength_m,
            bandwidth_hz=task.bandwidth_hz, oversampling=near,
        )  # fmt: skip
    return known[near]
