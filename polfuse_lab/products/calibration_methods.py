"""How a calibration is solved from the targets that were looked at: what there is to tell decides."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibration_inputs import FocusedImage
from polfuse_lab.products.calibration_targets import TargetView, reference_errors
from processing.calibration.budget import Budget
from processing.calibration.channel_phase import ChannelPhases, channel_phases
from processing.calibration.distortion import CHANNELS, Distortion
from processing.calibration.distributed import CrosstalkEstimate, estimate_crosstalk
from processing.calibration.imbalance import CrossRatio, cross_polarized_pixels, cross_ratio, crosstalk_db
from processing.calibration.offset import background_power
from processing.calibration.polarimetric import calibrate_isolated, calibrate_targets
from processing.calibration.range_dependence import RangeDistortion
from processing.calibration.target_checks import Verdict, check_amplitude
from processing.calibration.whitt import roles
from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

Floats = NDArray[np.float64]

ODD_BOUNCE = ("trihedral", "trihedral_triangular", "plate", "sphere")
"""Kinds of target whose S is a multiple of the identity, which the constant needs."""

Method = Literal["isolated", "targets", "quegan", "ainsworth"]


@dataclass(frozen=True)
class Region:
    """A rectangle of the image that holds distributed targets."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    method: Literal["quegan", "ainsworth"] = "quegan"


@dataclass(frozen=True)
class Solved:
    """A solved calibration."""

    method: Method
    reference: TargetView
    """The target that gave the constant."""
    distortion: Distortion
    constant_db: float
    budget: Budget
    cross_ratio: complex | None = None
    misfit: float | None = None
    clutter: CrosstalkEstimate | None = None
    by_range: RangeDistortion | None = None
    """Where whole sets of targets stood at several ranges."""
    target_errors_db: dict[str, float] = field(default_factory=dict)


def solve(
    where: Path,
    focused: FocusedImage,
    views: list[TargetView],
    *,
    seen: FocusedImage,
    clutter: Region | None,
    phase_sd_rad: float,
    draws: int,
) -> Solved:
    """Solve for what the targets tell.

    Args:
        where: products file, for messages.
        focused: the image to be calibrated.
        views: all targets, refused ones as well.
        seen: the image in which the targets stand.
        clutter: region of distributed targets in the image to be calibrated, for crosstalk.
        phase_sd_rad: of channels recorded one after the other.
        draws: of the Monte Carlo.

    Raises:
        PolfuseError: no usable trihedral or plate, or a target that was refused and is needed.
        DataError: targets that do not fit together.
    """
    good = [view for view in views if view.verdict.ok]
    known = [view for view in good if view.whole]
    bad = "; ".join(f"{view.spec.label}: {view.verdict.reason}" for view in views if not view.verdict.ok)
    advice = "; ".join(dict.fromkeys(view.verdict.advice for view in views if not view.verdict.ok))
    reference = next((view for view in good if view.spec.kind in ODD_BOUNCE), None)
    if reference is None:
        raise PolfuseError(
            f"there is no usable trihedral or plate ({bad})"
            if bad
            else "there is no trihedral or plate to calibrate on",
            where=str(where),
            advice=advice or "record one, for the constant",
        )
    planned = roles(np.array([_shape(view) for view in views])) is not None if len(views) >= 3 else False
    enough = len(known) >= 3 and roles(np.array([_shape(view) for view in known])) is not None
    if planned and not enough:
        raise PolfuseError(f"too few targets are left ({bad})", where=str(where), advice=advice)
    if enough:
        return _by_ranges(seen, reference, known, phase_sd_rad, draws)
    if clutter is not None:
        return _by_clutter(focused, seen, reference, clutter, phase_sd_rad, draws)
    ratio = _cross_ratio(focused, reference, known)
    made = calibrate_isolated(
        reference.measured(),
        cross_ratio=ratio,
        errors=reference_errors(seen, reference.spec, reference),
        phase_sd_rad=phase_sd_rad,
        draws=draws,
    )
    return Solved(
        "isolated",
        reference,
        made.distortion,
        made.constant_db,
        made.budget,
        ratio,
        target_errors_db=made.target_errors_db,
    )


def scene_phases(
    focused: FocusedImage, views: list[TargetView], solved: Solved, shift_sd_m: float
) -> ChannelPhases | None:
    """Phases of the image's channels against the series, from targets in the image and its cross-polarized pixels.

    Raises:
        DataError: a target without HH.
    """
    if not all(view.whole for view in views):
        return None
    slant = np.array([np.hypot(np.hypot(view.x_m, view.y_m), focused.z_m) for view in views])
    sds = [solved.budget.sd(name) for name in solved.budget.results if name.startswith("crosstalk_")]
    found = channel_phases(
        np.stack([view.values for view in views]),
        np.stack([view.noise for view in views]),
        np.stack([view.expected for view in views]),
        solved.distortion,
        sine=np.array([view.x_m for view in views]) / slant,
        wavelength_m=focused.wavelength_m,
        shift_sd_m=shift_sd_m,
        crosstalk_sd=float(np.sqrt(2) * max(sds, default=0.0)),
    )
    if (ratio := _scene_cross_ratio(focused, views[0])) is not None:
        # The coherence of HV and VH over n pixels leaves this much of their phase open.
        spread = np.sqrt((1 - ratio.coherence**2) / (2 * ratio.pixels)) / ratio.coherence
        found = found.with_reciprocity(ratio.ratio, solved.distortion, float(max(spread, 1e-3)))
    return found


def _shape(view: TargetView) -> NDArray[np.complex128]:
    """S of a target in its stated orientation, of size 1; from its kind alone where it was refused before."""
    if view.spec.kind == "dihedral":
        c, s = np.cos(2 * view.spec.fold_rad), np.sin(2 * view.spec.fold_rad)
        return np.array([[c, s], [s, -c]], dtype=np.complex128)
    return np.eye(2, dtype=np.complex128)


def _by_ranges(
    seen: FocusedImage, reference: TargetView, known: list[TargetView], phase_sd_rad: float, draws: int
) -> Solved:
    """Fit the targets of each range alone where they suffice, else all at once."""
    cell = SPEED_OF_LIGHT_M_S / (2 * seen.bandwidth_hz)
    groups: list[list[TargetView]] = []
    for view in sorted(known, key=lambda item: item.y_m):
        if groups and view.y_m - groups[-1][-1].y_m < cell:
            groups[-1].append(view)
        else:
            groups.append([view])
    whole = all(
        len(group) >= 3
        and roles(np.array([_shape(view) for view in group])) is not None
        and any(view.spec.kind in ODD_BOUNCE for view in group)
        for group in groups
    )
    if len(groups) < 2 or not whole:
        return _by_targets(seen, reference, known, phase_sd_rad, draws)
    solved = []
    for group in groups:
        own = reference if reference in group else next(view for view in group if view.spec.kind in ODD_BOUNCE)
        solved.append(_by_targets(seen, own, group, phase_sd_rad, draws))
    main = next(item for item in solved if item.reference is reference)
    ranges = tuple(float(np.hypot(np.mean([view.y_m for view in group]), seen.z_m)) for group in groups)
    return replace(
        main,
        by_range=RangeDistortion(ranges, tuple(item.distortion for item in solved)),
        target_errors_db={name: error for item in solved for name, error in item.target_errors_db.items()},
    )


def _by_targets(
    seen: FocusedImage, reference: TargetView, known: list[TargetView], phase_sd_rad: float, draws: int
) -> Solved:
    """Fit all targets; those whose RCS does not fit the constant are refused."""
    made = calibrate_targets(
        [view.measured() for view in known],
        reference=known.index(reference),
        errors=reference_errors(seen, reference.spec, reference),
        phase_sd_rad=phase_sd_rad,
        draws=draws,
    )
    assert made.fit is not None
    for view in known:
        error = made.target_errors_db[view.spec.label]
        # Both angles' errors count, the reference's within the constant's.
        sd = float(np.hypot(made.budget.sd("constant_db"), view.amplitude_sd_db))
        size = float(np.linalg.norm(view.expected) ** 2)
        verdict: Verdict = check_amplitude(size * 10 ** (error / 10), size, sd)
        if not verdict.ok:
            raise DataError(f"{view.spec.label} is refused: {verdict.reason}", verdict.advice)
    return Solved(
        "targets",
        reference,
        made.distortion,
        made.constant_db,
        made.budget,
        made.distortion.receive_gain / made.distortion.transmit_gain,
        made.fit.misfit,
        target_errors_db=made.target_errors_db,
    )


def _by_clutter(
    focused: FocusedImage, seen: FocusedImage, reference: TargetView, region: Region, phase_sd_rad: float, draws: int
) -> Solved:
    if set(focused.channels) != set(CHANNELS) or not reference.whole:
        raise DataError("distributed targets tell crosstalk from all four channels only", "collect HH, HV, VH and VV")
    image = focused.image[[focused.channels.index(name) for name in CHANNELS]]
    mask = (
        (focused.x_m[None, :] >= min(region.x_m))
        & (focused.x_m[None, :] <= max(region.x_m))
        & (focused.y_m[:, None] >= min(region.y_m))
        & (focused.y_m[:, None] <= max(region.y_m))
    )
    found = estimate_crosstalk(image, method=region.method, mask=mask)
    cleaned = found.without_crosstalk(reference.values)
    distortion = found.distortion(complex(cleaned[3] / cleaned[0]))
    made = calibrate_isolated(
        replace(reference.measured(), values=cleaned),
        cross_ratio=found.cross_ratio,
        errors=reference_errors(seen, reference.spec, reference),
        phase_sd_rad=phase_sd_rad,
        draws=draws,
    )
    return Solved(
        region.method,
        reference,
        distortion,
        made.constant_db,
        made.budget,
        found.cross_ratio,
        clutter=found,
        target_errors_db=made.target_errors_db,
    )


def _cross_ratio(focused: FocusedImage, reference: TargetView, known: list[TargetView]) -> complex | None:
    """HV over VH of a dihedral at about 45 degrees, or else of cross-polarized pixels."""
    turned = [view for view in known if view.spec.kind == "dihedral" and abs(np.sin(2 * view.spec.fold_rad)) > 0.5]
    if turned:
        return complex(turned[0].values[1] / turned[0].values[2])
    found = _scene_cross_ratio(focused, reference)
    return None if found is None else found.ratio


def _scene_cross_ratio(focused: FocusedImage, reference: TargetView) -> CrossRatio | None:
    """HV over VH of the image's pixels that crosstalk does not explain; None where there are too few."""
    if set(focused.channels) != set(CHANNELS) or not reference.whole:
        return None
    image = {name: focused.image[index] for index, name in enumerate(focused.channels)}
    leak = crosstalk_db(dict(zip(CHANNELS, reference.values.tolist(), strict=True)))
    background = {name: background_power(image[name]) for name in ("HV", "VH")}
    return cross_ratio(image["HV"], image["VH"], cross_polarized_pixels(image, leak, background))
