"""Focused amplitudes to scattering amplitudes in sqrt(m^2): the stages ``"calibration"`` and ``"polarimetry"``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibration_inputs import (
    FocusedImage,
    TargetSpec,
    read_focused,
    read_reference,
    sky_noise,
)
from polfuse_lab.products.calibration_methods import ODD_BOUNCE, Region, Solved, scene_phases, solve
from polfuse_lab.products.calibration_result import CalibrationResult, CheckResult
from polfuse_lab.products.calibration_series import look_at_series
from polfuse_lab.products.calibration_targets import (
    TargetView,
    by_channel,
    expected_scattering,
    look_in_image,
    reference_errors,
)
from polfuse_lab.products.calibration_write import write_calibration
from polfuse_lab.products.store import Products, is_products
from polfuse_lab.session import open_session
from processing.calibration.budget import Cause, uncertainty_budget
from processing.calibration.channel_phase import ChannelPhases
from processing.calibration.distortion import CHANNELS, NO_DISTORTION
from processing.calibration.imbalance import crosstalk_db
from processing.calibration.noise import background_by_row
from processing.calibration.offset import AmplitudeMap, locate_target, snr_sd_db, two_point_map
from processing.calibration.polarimetric import calibrate_isolated
from processing.calibration.rcs import accuracy, to_dbsm
from processing.errors import DataError

__all__ = ["CalibrationResult", "CheckResult", "Region", "TargetSpec", "calibrate"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

OnTarget = Callable[[TargetView], None]


def calibrate(
    products_path: Path | str,
    target: TargetSpec | None = None,
    *,
    targets: Sequence[TargetSpec] = (),
    series: Path | str | None = None,
    clutter: Region | None = None,
    sky: Path | str | None = None,
    check: TargetSpec | None = None,
    mode: Literal["offset", "thesis"] = "offset",
    search_radius_m: float = 1.0,
    min_snr_db: float = 10.0,
    reference: Path | str | None = None,
    phase_sd_rad: float = 0.0,
    shift_sd_m: float = 0.0,
    near_field: bool = False,
    draws: int = 1000,
    on_target: OnTarget | None = None,
) -> CalibrationResult:
    """Calibrate the focused image of a products file on reflectors of known RCS.

    A target's expected RCS is its apparent one: the mean of its scattering amplitude over the antenna positions, which
    is what the focused image shows. What is taken off the channels depends on what there is to tell it:

    - one trihedral or plate: imbalance, antennas taken as isolated (crosstalk is reported and left in);
    - three targets that differ (trihedral, dihedral, dihedral at 45 degrees), in the image (``target`` and ``targets``)
      or in a calibration series: imbalance and crosstalk (:mod:`processing.calibration.target_fit`);
    - such a set at each of several ranges: the same for each range, interpolated between them;
    - a trihedral and a region of distributed targets: the same by :mod:`processing.calibration.distributed`.

    With a series, ``target`` may name a trihedral or plate that stands in the image: it then gives the constant and the
    phases of the channels, which were recorded in another run (:mod:`processing.calibration.channel_phase`).

    Mode "offset" applies one constant (thesis 5.9 with slope 1) after the distortion is taken off; mode "thesis" draws
    the straight line of thesis 5.9 through target and noise and leaves the channels as they are.

    Writes stage "calibration" (``scattering`` (C, ny, nx) complex64 sqrt(m^2), ``noise_equivalent_rcs_m2`` (C, ny),
    ``x_m``, ``y_m``) and, with HH, VV and a cross-polarized channel, stage "polarimetry" (``pauli`` (3, ny, nx),
    ``span`` m^2, ``x_m``, ``y_m``).

    Args:
        products_path: products file with stages "ranging" and "focus".
        target: trihedral or plate to calibrate on; may be left out with a series.
        targets: further targets in the image.
        series: session of a calibration series.
        clutter: region of distributed targets in the image.
        sky: session (or products file) of a look at the clear sky with the same settings, for the noise.
        check: another reflector to measure with the calibration.
        mode: see above.
        search_radius_m: how far from its stated place a target's peak may be, m.
        min_snr_db: least peak over background, dB.
        reference: products file with the target's focused image, made with the same settings from a calibration
            series; the target is looked for in ``products_path`` itself where left out.
        phase_sd_rad: standard deviation of the phase between channels recorded one after the other, rad.
        shift_sd_m: standard deviation with which the trolley comes back to a place, m.
        near_field: whether the series' targets are expected as physical optics has them at their distance (those in
            the image say so themselves).
        draws: of the Monte Carlo of the uncertainties.
        on_target: called with each target as it was found and judged.

    Raises:
        PolfuseError: stages or channels that are missing, a reference or series that was made otherwise, targets that
            were refused, or files that cannot be used.
        DataError: a target that is not there, too weak, or returns nothing at its angles.
    """
    tell: OnTarget = on_target or (lambda view: None)
    products = Products(products_path)
    focused = read_focused(products)
    if target is not None:
        _refuse_unsuitable(products.path, target)
    elif series is None:
        raise PolfuseError(
            "no target is stated to calibrate on", where=str(products.path), advice="give a target or a series"
        )
    seen = focused if reference is None else read_reference(Products(reference), focused)
    looks = {"radius_m": search_radius_m, "min_snr_db": min_snr_db}
    inside = [_told(look_in_image(seen, one, **looks), tell) for one in (target, *targets) if one is not None]
    views = inside
    if series is not None:
        sky_session = None if sky is None or is_products(Path(sky)) else sky
        with open_session(series) as session:
            views = [
                _told(view, tell)
                for view in look_at_series(session, focused, sky=sky_session, near_field=near_field, **looks)
            ]
    if target is not None and not inside[0].verdict.ok:
        raise DataError(inside[0].verdict.reason, inside[0].verdict.advice)
    solved = solve(products.path, focused, views, seen=seen, clutter=clutter, phase_sd_rad=phase_sd_rad, draws=draws)
    phases = None
    if series is not None and target is not None:
        phases = scene_phases(focused, inside, solved, shift_sd_m)
        focused_image = focused.image if phases is None else _with_phases(focused, phases)
        solved = _with_constant_of(focused, inside[0], solved, phase_sd_rad, draws)
        views = [*views, *inside]
    else:
        focused_image = focused.image
    noise, noise_source = _noise(focused, sky)
    row = int(np.argmin(np.abs(focused.y_m - solved.reference.y_m)))
    hh = focused.channels.index("HH")
    applied, amplitudes = solved.distortion, AmplitudeMap(1.0, solved.constant_db)
    if mode == "thesis":
        applied = NO_DISTORTION
        at_target = float(abs(solved.reference.values[0]) ** 2)
        amplitudes = two_point_map(at_target, abs(solved.reference.expected[0, 0]) ** 2, float(noise[hh, row]))
    if solved.by_range is not None and mode == "offset":
        slant = np.hypot(focused.y_m, focused.z_m)
        balanced = solved.by_range.remove(focused_image, slant, focused.channels)
        left = solved.by_range.noise_after(noise, slant, focused.channels)
    else:
        balanced = applied.remove(focused_image, focused.channels)
        left = applied.noise_after(noise, focused.channels)
    scattering = amplitudes.scattering(balanced)
    equivalent = 10 ** (amplitudes.rcs_dbsm(left) / 10)
    observed = {name: complex(v) for name, v in zip(CHANNELS, solved.reference.values, strict=True) if np.isfinite(v)}
    co_known = "VV" in observed
    result = CalibrationResult(
        products=products.path,
        method=solved.method,
        constant_db=solved.constant_db,
        constant_sd_db=solved.budget.sd("constant_db"),
        slope=amplitudes.slope,
        target=solved.reference,
        targets=tuple(views),
        expected_dbsm=float(to_dbsm(abs(solved.reference.expected[0, 0]) ** 2)),
        crosstalk_db=crosstalk_db(observed),
        distortion=solved.distortion,
        imbalance_db=solved.distortion.co_db if co_known else float("nan"),
        imbalance_deg=solved.distortion.co_deg if co_known else float("nan"),
        cross_imbalance=solved.cross_ratio,
        noise_source=noise_source,
        noise_equivalent_dbsm=float(to_dbsm(equivalent[hh, row])),
        budget=solved.budget,
        target_errors_db=solved.target_errors_db,
        misfit=solved.misfit,
        clutter=solved.clutter,
        by_range=solved.by_range,
        phases=phases,
        check=None
        if check is None
        else _checked(focused, balanced, amplitudes, check, looks, solved.budget.sd("constant_db")),
    )
    others = [Path(path) for path in (sky, reference, series) if path is not None]
    write_calibration(products, focused, scattering, equivalent, result, others, mode=mode, check=check, sky=sky)
    return result


def _told(view: TargetView, tell: OnTarget) -> TargetView:
    tell(view)
    return view


def _refuse_unsuitable(path: Path, target: TargetSpec) -> None:
    if target.kind not in ODD_BOUNCE:
        raise PolfuseError(
            f"a {target.kind} is no target to calibrate on, for its channels differ",
            where=str(path),
            advice=f"use a {' or a '.join(ODD_BOUNCE)}, and the {target.kind} as --check",
        )


def _with_phases(focused: FocusedImage, phases: ChannelPhases) -> Complexes:
    x, y = focused.x_m[None, :], focused.y_m[:, None]
    sine = x / np.sqrt(x**2 + y**2 + focused.z_m**2)
    rows = [CHANNELS.index(name) for name in focused.channels]
    turned = np.exp(-1j * phases.phases(sine)[rows])
    return np.asarray(focused.image.astype(np.complex128) * turned)


def _with_constant_of(
    focused: FocusedImage, view: TargetView, solved: Solved, phase_sd_rad: float, draws: int
) -> Solved:
    """The constant from the target in the image, the rest from the series."""
    own = calibrate_isolated(
        view.measured(), errors=reference_errors(focused, view.spec, view), phase_sd_rad=phase_sd_rad, draws=draws
    ).budget
    b = solved.budget
    # HH of the target holds crosstalk too, which the series tells.
    through = solved.distortion.apply(view.expected)[0, 0] / view.expected[0, 0]
    constant = own.values["constant_db"] + float(to_dbsm(abs(through) ** 2))
    budget = replace(
        b,
        values={**b.values, "constant_db": constant},
        first_order_sd={**b.first_order_sd, "constant_db": own.first_order_sd["constant_db"]},
        drawn_sd={**b.drawn_sd, "constant_db": own.drawn_sd["constant_db"]},
        interval={**b.interval, "constant_db": own.interval["constant_db"]},
        lines=tuple(replace(line, contributions={**line.contributions, "constant_db": 0.0}) for line in b.lines)
        + tuple(
            replace(
                line,
                cause=f"{line.cause}, target in the image",
                contributions={name: line.contributions.get(name, 0.0) * (name == "constant_db") for name in b.results},
            )
            for line in own.lines
        ),
    )
    return replace(solved, reference=view, constant_db=constant, budget=budget)


def _noise(focused: FocusedImage, sky: Path | str | None) -> tuple[Floats, str]:
    """Noise power by channel and image row, and where it comes from."""
    if sky is not None:
        return sky_noise(sky, focused), f"sky look {Path(sky).name}"
    return background_by_row(focused.image), "background of the image (an upper bound)"


def _checked(
    focused: FocusedImage,
    balanced: Complexes,
    amplitudes: AmplitudeMap,
    check: TargetSpec,
    looks: dict[str, float],
    constant_sd_db: float,
) -> CheckResult:
    expected = by_channel(expected_scattering(focused, check))
    channel = max(focused.channels, key=lambda name: abs(expected[name]))
    peak = locate_target(
        balanced,
        focused.x_m,
        focused.y_m,
        check.image_place(focused.z_m),
        radius_m=looks["radius_m"],
        reference=focused.channels.index(channel),
        min_snr_db=looks["min_snr_db"],
        gain=focused.range_gain,
    )
    measured, truth = float(amplitudes.rcs_dbsm(peak.power)), float(to_dbsm(abs(expected[channel]) ** 2))
    compared = accuracy(measured, truth)
    noise_sd = amplitudes.slope * snr_sd_db(peak.snr_db)
    return CheckResult(
        channel=channel,
        x_m=peak.x_m,
        y_m=peak.y_m,
        rcs_dbsm=measured,
        expected_dbsm=truth,
        error_db=compared.error_db,
        sd_db=float(np.hypot(np.hypot(noise_sd, constant_sd_db), _stated_sd_db(focused, check))),
        thesis_accuracy_percent=compared.thesis_accuracy_percent,
        values=dict(zip(focused.channels, amplitudes.scattering(peak.values).tolist(), strict=True)),
    )


def _stated_sd_db(focused: FocusedImage, check: TargetSpec) -> float:
    """Standard uncertainty of a target's expected RCS from its stated angles, place and edge, dB."""
    errors = reference_errors(focused, check)
    if errors.rcs_dbsm is None:
        return 0.0
    rcs = errors.rcs_dbsm
    causes = [
        Cause("angles", (errors.angle_sd_rad,) * 2, "rad"),
        Cause("position", (errors.position_sd_m,) * 2, "m"),
        Cause("edge", (errors.edge_sd_m,), "m"),
    ]
    return uncertainty_budget(lambda d: rcs(d)[:, None], causes, ("rcs",), draws=500).sd("rcs")
